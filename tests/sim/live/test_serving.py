"""`sounding serve`: an independent client in another process, a kill in the middle, and a simulated probe."""

import csv
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import plain_igtl
import pytest
import trimesh
from plain_igtl import PlainClient

from sim.episode.setup import build_setup
from sim.errors import FieldError, UsageError
from sim.live.igtl.link import LinkSettings
from sim.live.service import ServiceSettings
from sim.running.fields import config_of, recorded
from sim.running.live.serving import Serving, serve
from sim.running.output import output_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode, record_episode
from sim.world.sensing.cone_sensor import ConeSensor

pytest.importorskip("pyigtl")
ROOT = Path(__file__).resolve().parents[3]
SCENARIO = """
organ = "{organ}"
n_poses = 200
score_spacing_m = 0.008
n_tumours = 2
tumour_diameter_range_m = [0.012, 0.02]
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """The file of a scenario whose organ is a ball of 50 mm."""
    folder = tmp_path_factory.mktemp("ball")
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(folder / "ball.stl")
    (folder / "ball.toml").write_text(SCENARIO.format(organ=folder / "ball.stl") + 'organ_unit = "m"\n')
    return folder / "ball.toml"


class Server:
    """`sounding serve` in a process of its own."""

    def __init__(self, scenario, out):
        command = ["serve", "--scenario", scenario, "--out", out, "--port", "0"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sim.cli", *map(str, command)], cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        self.lines = []
        for line in self.process.stdout:
            self.lines.append(line)
            if found := re.search(r"listening at 127\.0\.0\.1:(\d+)", line):
                self.client = PlainClient(int(found[1]))
                return
        raise AssertionError(self.lines)

    def decision(self, n_sensed):
        """What is decided after so many actions."""
        _, body = self.client.wait_for("SoundingDecision", lambda body: _told(body)["sensed"] == n_sensed)
        return _told(body)

    def sense(self):
        """Report a reading from the proposed pose, free but for a corner."""
        T_tip = plain_igtl.matrix_of(self.client.wait_for("SoundingProposed")[1])
        away = np.random.default_rng(0).uniform([-8.0, -8.0, 2.0], [8.0, 8.0, 60.0], (300, 3))
        places = away @ T_tip[:3, :3].T + T_tip[:3, 3]
        groups = ["tumour" if x > 3.0 and z > 30.0 else "free" for x, _, z in away]
        self.client.socket.sendall(plain_igtl.transform("Tip", T_tip))
        self.client.socket.sendall(plain_igtl.points("Points", places, groups))

    def kill(self):
        """End it as a crash would."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()
        self.client.close()


def _told(body):
    return json.loads(body[4 : 4 + struct.unpack(">H", body[2:4])[0]])


def test_a_kill_loses_nothing_and_the_same_command_goes_on(scenario, tmp_path):
    first = Server(scenario, tmp_path / "out")
    first.decision(0)
    first.sense()
    before = first.decision(1)
    first.kill()
    second = Server(scenario, tmp_path / "out")
    after = second.decision(1)
    assert any("going on after 1 actions" in line for line in second.lines)
    assert (after["pose"], after["confidence"]) == (before["pose"], before["confidence"])
    second.sense()
    assert second.decision(2)["pose"] != after["pose"]
    second.kill()
    assert sorted(file.name for file in (tmp_path / "out" / "events").glob("*.npz")) == [
        "00001.npz",
        "00002.npz",
    ]


def test_a_simulated_probe_senses_what_an_episode_senses(scenario, tmp_path):
    config = config_of(scenario=str(scenario), arm="none", motion="none", seed=5, steps=4)
    serving = Serving(
        folder=tmp_path / "out", link=LinkSettings(port=0), service=ServiceSettings(), simulates=True, speed=0.0,
        n_steps=4,
    )  # fmt: skip
    told = []
    assert serve(config, serving, told.append) == 4
    parts = make_parts(config)
    episode = make_episode(parts, build_setup(parts.scenario, None, parts.map_settings))
    expected = list(episode.steps(4))
    for number, step in enumerate(expected, start=1):
        with np.load(tmp_path / "out" / "events" / f"{number:05d}.npz") as event:
            assert event["pose_index"] == step.pose_index
            # The tip is shifted to the pose, not put there, which rounds; so its points do.
            np.testing.assert_allclose(event["points_m"], step.reading.points_m, atol=1e-9)
            np.testing.assert_array_equal(event["is_occupied"], step.reading.is_occupied)
    assert any("4 sensed" in line for line in told)


class SaysHowSure:
    """A sensor that says how far its labels can be believed, and sees nothing in its second reading."""

    n_readings = 0

    def sense(self, state, rng):
        reading = ConeSensor().sense(state, rng)
        SaysHowSure.n_readings += 1
        if SaysHowSure.n_readings == 2:
            return reading.part(np.zeros(len(reading.points_m), dtype=bool))
        n = len(reading.points_m)
        return replace(reading, log_odds=np.where(reading.is_occupied, 0.5, -0.5), weight=np.full(n, 0.25))


def test_what_a_sensor_says_of_its_labels_is_learnt_and_a_pose_without_a_point_is_declined(
    scenario, tmp_path
):
    config = config_of(
        scenario=str(scenario), arm="none", motion="none", seed=5, sensor=f"{__name__}:SaysHowSure"
    )
    serving = Serving(
        folder=tmp_path / "out", link=LinkSettings(port=0), service=ServiceSettings(), simulates=True, speed=0.0,
        n_steps=3,
    )  # fmt: skip
    SaysHowSure.n_readings = 0
    assert serve(config, serving, lambda text: None) == 3
    events = []
    for number in range(1, 5):
        with np.load(tmp_path / "out" / "events" / f"{number:05d}.npz") as arrays:
            events.append({name: arrays[name] for name in arrays.files})
    assert ["reason" in event for event in events] == [False, True, False, False]
    assert "saw nothing" in str(events[1]["reason"])
    assert all(np.all(np.abs(events[i]["log_odds"]) == 0.5) for i in (0, 2, 3))
    assert all(np.all(events[i]["weight"] == 0.25) for i in (0, 2, 3))
    # Readings of a simulation and of a patient do not mix.
    with pytest.raises(UsageError, match=r"other values of `simulate` \(True then, False now\)"):
        serve(config, replace(serving, simulates=False), lambda text: None)


def test_a_port_that_cannot_be_had_leaves_no_session(scenario, tmp_path):
    config = config_of(scenario=str(scenario), arm="none", motion="none")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        link = LinkSettings(port=taken.getsockname()[1])
        serving = Serving(folder=tmp_path / "out", link=link, service=ServiceSettings())
        with pytest.raises(UsageError, match="port"):
            serve(config, serving, lambda text: None)
    assert not (tmp_path / "out").exists()


class Forgets:
    """A sensor without a reading."""

    def sense(self, state, rng):
        del state, rng


def test_a_simulated_probe_whose_sensor_fails_ends_the_session_with_its_error(scenario, tmp_path):
    config = config_of(scenario=str(scenario), arm="none", motion="none", sensor=f"{__name__}:Forgets")
    serving = Serving(
        folder=tmp_path / "out",
        link=LinkSettings(port=0),
        service=ServiceSettings(),
        simulates=True,
        speed=0.0,
    )
    with pytest.raises(ValueError, match=r"Forgets\.sense returned None"):
        serve(config, serving, lambda text: None)


def test_a_run_is_shown_as_it_happens_and_its_record_stays_the_same(scenario, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    setup, tips = None, []
    for name, live in (("plain", None), ("shown", f"igtl://127.0.0.1:{port}")):
        config = config_of(scenario=str(scenario), arm="none", steps=3, report=False, live=live)
        parts = make_parts(config)
        setup = setup or build_setup(parts.scenario, None, parts.map_settings)
        output = replace(output_of(config, parts, recorded(config)), folder=tmp_path / name)
        watching = threading.Thread(target=lambda: tips.append(seen_tip(port)))
        if live:
            watching.start()
        record_episode(parts, output, setup=setup, show_progress=False)
        if live:
            watching.join()
    rows, configs = (
        [(tmp_path / name / file).read_text() for name in ("plain", "shown")]
        for file in ("poses.csv", "config.json")
    )
    assert rows[0] == rows[1]
    assert configs[0] == configs[1]
    (tip,) = tips
    tables = csv.DictReader(rows[0].splitlines())
    tips_lps_m = np.array(
        [[float(row[f"T_organ_probe_position_{axis}_m"]) for axis in "xyz"] for row in tables]
    )
    # The client saw one of the run's contacts, in RAS millimetres and single precision.
    off_mm = np.linalg.norm(tips_lps_m * [-1e3, -1e3, 1e3] - tip[:3, 3], axis=1)
    assert off_mm.min() < 1e-3


def seen_tip(port):
    """The first pose of the tip that a server shows which is still to come."""
    deadline = time.monotonic() + 60.0
    while True:
        try:
            client = PlainClient(port)
        except ConnectionRefusedError:
            assert time.monotonic() < deadline
            time.sleep(0.01)
            continue
        tip = plain_igtl.matrix_of(client.wait_for("SoundingTip")[1])
        client.close()
        return tip


@pytest.mark.parametrize("address", ["127.0.0.1:18944", "igtl://", "igtl://here:99999", "http://127.0.0.1"])
def test_an_address_that_is_none_is_told_before_anything_runs(address):
    with pytest.raises(FieldError, match=r"igtl://127\.0\.0\.1:18944"):
        config_of(live=address)
