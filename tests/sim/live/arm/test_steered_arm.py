"""An arm in another process, over a connection that delays and loses: where it goes, and what is believed of it."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_process import ArmProcess

from sim.episode.moving.motion import ProcedureStoppedError
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.errors import FieldError, UsageError
from sim.live.address import arm_address
from sim.live.arm.controller import ControllerError, Status
from sim.live.arm.steered_motion import SteeredMotion
from sim.live.arm.tcp_controller import TcpController
from sim.live.arm.timed_path import PathRefusedError, TimedPath
from sim.world.motion.settings import MotionSettings
from sim.world.scene.arm import ArmModel

ROOT = Path(__file__).resolve().parents[4]
SCENARIO = 'base = "sphere"\nn_poses = 300\nscore_spacing_m = 0.012\n'


@pytest.fixture(scope="module")
def setup():
    return build_setup(replace(SCENARIOS["sphere"], score_spacing_m=0.012), ArmModel())


@pytest.fixture
def bad_line():
    """An arm whose connection delays, jitters and loses, and whose joints are off by up to a milliradian."""
    process = ArmProcess("--delay-ms", 4, "--jitter-ms", 8, "--lost", 0.1, "--error-mrad", 1)
    yield process
    process.close()


def reached_pose(setup, number=0):
    """A pose that the arm reaches."""
    return [pose for pose in range(0, 3000, 150) if setup.positioner.reach(pose).is_reached][number]


def is_within(record, setup):
    chain = setup.positioner.search.chain
    assert (np.array(record["lowest"]) >= chain.low).all()
    assert (np.array(record["highest"]) <= chain.high).all()


def test_the_tip_is_where_the_arm_truly_got_to(setup, bad_line) -> None:
    data, pose = setup.scene.new_data(), reached_pose(setup)
    with TcpController("127.0.0.1", bad_line.port) as controller:
        steered = SteeredMotion(setup, controller, MotionSettings(tip_speed_m_s=1.0, approach_speed_m_s=0.2))
        steered.begin(data)
        motion = steered.move(data, pose)
        assert motion.is_done
        true_q = controller.state().q
    chain = setup.positioner.search.chain
    np.testing.assert_array_equal(data.qpos[chain.columns], true_q)
    tip = chain.forward(true_q[None])
    np.testing.assert_allclose(data.site(setup.scene.tip_site).xpos, tip.tips_m[0], atol=1e-12)
    # A milliradian at each of seven joints, on levers of at most a metre: off, by less than 3 mm, and it is told.
    wanted = setup.positioner.reach(pose).q[chain.columns]
    assert 1e-5 < np.abs(true_q - wanted).max() <= 1.0001e-3
    off_m = np.linalg.norm(tip.tips_m[0] - chain.forward(wanted[None]).tips_m[0])
    assert motion.tracking_error_m == pytest.approx(off_m, abs=1e-9)
    assert (np.diff(motion.time_s) > 0.0).all()
    record = bad_line.record()
    is_within(record, setup)
    assert record["longest_unheard_s"] <= 0.1


def test_a_path_beyond_the_controllers_limits_is_never_sent(setup, bad_line) -> None:
    with TcpController("127.0.0.1", bad_line.port) as controller:
        steered = SteeredMotion(setup, controller, MotionSettings(tip_speed_m_s=1.0))
        slow = replace(controller.limits, speed=np.full(7, 0.05))
        controller.limits = slow
        steered = SteeredMotion(setup, controller, MotionSettings(tip_speed_m_s=1.0))
        data = setup.scene.new_data()
        steered.begin(data)
        with pytest.raises(PathRefusedError, match=r"a second, and may at 0\.05"):
            steered.move(data, reached_pose(setup))
        assert controller.state().goal == 0
        # The controller has limits of its own, and refuses what was not checked.
        q = controller.state().q
        wild = TimedPath(
            names=controller.names,
            time_s=np.array([0.0, 10.0]),
            q=np.stack([q, q + 4.0]),
            speed=np.zeros((2, 7)),
        )
        refused = controller.follow(wild)[-1]
    assert refused.status is Status.REFUSED
    assert "would go to" in refused.text
    assert bad_line.record()["lowest"] == bad_line.record()["highest"]


def test_another_arm_is_not_driven(setup, bad_line) -> None:
    with TcpController("127.0.0.1", bad_line.port) as controller:
        controller.names = ("shoulder", "elbow")
        with pytest.raises(ControllerError, match="drives the joints shoulder, elbow"):
            SteeredMotion(setup, controller, MotionSettings())


def test_an_arm_that_is_told_to_stop_rests_on_its_way_and_goes_on_later(setup, bad_line) -> None:
    data, pose, seen = setup.scene.new_data(), reached_pose(setup), []

    def watch(q):
        seen.append(q)
        return len(seen) < 40

    with TcpController("127.0.0.1", bad_line.port) as controller:
        steered = SteeredMotion(setup, controller, MotionSettings(), watch)
        steered.begin(data)
        with pytest.raises(ProcedureStoppedError, match=r"stopped.*told to stop") as caught:
            steered.move(data, pose)
        rested = controller.state()
        assert rested.status is Status.STOPPED
        assert (rested.speed == 0.0).all()
        # What it did until then is kept, and the state of the scene is where it rests.
        assert len(caught.value.motion.time_s) >= 30
        np.testing.assert_array_equal(data.qpos[setup.positioner.search.chain.columns], rested.q)
        again = SteeredMotion(setup, controller, MotionSettings())
        again.begin(data)
        assert again.move(data, pose).is_done
    assert bad_line.record()["longest_unheard_s"] <= 0.1


class CutLine:
    """A relay between a client and a controller, which can be cut and joined again."""

    def __init__(self, port):
        self._server, self._to = socket.create_server(("127.0.0.1", 0)), port
        self.port, self._ends, self.n_joined = self._server.getsockname()[1], [], 0
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        while True:
            try:
                near = self._server.accept()[0]
                far = socket.create_connection(("127.0.0.1", self._to))
            except OSError:
                return
            self._ends, self.n_joined = [near, far], self.n_joined + 1
            for a, b in ((near, far), (far, near)):
                threading.Thread(target=self._pass_on, args=(a, b), daemon=True).start()

    def _pass_on(self, a, b):
        try:
            while chunk := a.recv(1 << 16):
                b.sendall(chunk)
        except OSError:
            pass
        for each in (a, b):
            each.close()

    def cut(self):
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self):
        self.cut()
        self._server.close()


def test_a_line_that_is_cut_stops_the_arm_and_it_goes_on_when_the_line_is_back(setup, bad_line) -> None:
    line, data, pose = CutLine(bad_line.port), setup.scene.new_data(), reached_pose(setup)
    cuts, seen = [60, 150], []

    def watch(q):
        seen.append(q)
        if cuts and len(seen) > cuts[0]:
            cuts.pop(0)
            line.cut()
        return True

    with TcpController("127.0.0.1", line.port, patience_s=60.0) as controller:
        steered = SteeredMotion(setup, controller, MotionSettings(), watch)
        steered.begin(data)
        motion = steered.move(data, pose)
    line.close()
    assert motion.is_done
    assert line.n_joined == 3
    record = bad_line.record()
    assert record["n_stops"] >= 2
    assert record["longest_unheard_s"] <= 0.1
    is_within(record, setup)


class Serve:
    """`sounding serve` with an arm, in a process of its own."""

    def __init__(self, folder, controller, *options):
        (folder / "case.toml").write_text(SCENARIO)
        command = ["serve", "--scenario", folder / "case.toml", "--out", folder / "out", "--port", 0]
        command += ["--arm", "default", "--controller", controller.address, "--simulate", "--sensing-s", 0.05]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sim.cli", *map(str, (*command, *options))],
            cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    def until(self, pattern):
        lines = []
        for line in self.process.stdout:
            lines.append(line)
            if found := re.search(pattern, line):
                return found
        raise AssertionError(lines)

    def kill(self):
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()


def test_a_killed_program_stops_the_arm_and_a_restart_goes_on_from_the_belief_on_disk(
    tmp_path, setup
) -> None:
    arm = ArmProcess()
    try:
        first = Serve(tmp_path, arm)
        pose = first.until(r"^1 sensed.*next pose (\d+)")[1]
        time.sleep(0.5)  # most likely on its way to the next pose; the laws hold wherever it is
        first.kill()
        record = arm.record()
        deadline = time.monotonic() + 60.0
        while arm.record()["is_moving"]:
            assert time.monotonic() < deadline
        assert record["longest_unheard_s"] <= 0.1
        second = Serve(tmp_path, arm, "--steps", 2)
        second.until(r"going on after 1 actions")
        assert second.until(r"^1 sensed.*next pose (\d+)")[1] == pose
        second.until(r"^2 sensed")
        assert second.process.wait(timeout=120.0) == 0
        second.process.stdout.close()
        record = arm.record()
        is_within(record, setup)
        assert record["longest_unheard_s"] <= 0.1
        with np.load(tmp_path / "out" / "events" / "00002.npz") as event:
            T = event["T_world_probe"]
            place_m = setup.workspace.positions_m[int(event["pose_index"])]
        # The simulated arm without an error ends where it was sent, as near as the inverse kinematics is.
        assert np.linalg.norm(T[:3, 3] - place_m) < 1e-3
    finally:
        arm.close()


def test_a_controller_that_is_not_there_or_not_understood_is_told(tmp_path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(ControllerError, match="cannot be reached"):
        TcpController("127.0.0.1", port, patience_s=0.0)
    with (
        socket.create_server(("127.0.0.1", 0)) as silent,
        pytest.raises(ControllerError, match="nothing of use"),
    ):
        TcpController("127.0.0.1", silent.getsockname()[1], patience_s=0.2)
    for said in (b"hello\n", b"[1]\n", json.dumps({"op": "arm", "joint_names": [1]}).encode() + b"\n"):
        with socket.create_server(("127.0.0.1", 0)) as odd:
            threading.Thread(target=lambda: odd.accept()[0].sendall(said), daemon=True).start()  # noqa: B023
            with pytest.raises(ControllerError, match="is not understood"):
                TcpController("127.0.0.1", odd.getsockname()[1])


def test_an_address_that_is_none_and_an_arm_without_controller_are_told() -> None:
    from sim.cli.command_line import parse_command

    assert arm_address("arm://here", "controller") == ("here", 18950)
    with pytest.raises(FieldError, match=r"arm://127\.0\.0\.1:18950"):
        arm_address("igtl://127.0.0.1", "controller")
    for words in (["--arm", "default"], ["--controller", "arm://127.0.0.1"]):
        with pytest.raises(UsageError, match="do not go together"):
            parse_command(["serve", *words])
    with pytest.raises(FieldError, match="timed paths"):
        parse_command(["serve", "--arm", "default", "--controller", "arm://127.0.0.1", "--motion", "servo"])
