"""A driven arm with a sensor of the outside: the arm says where the tip is, the outside what was seen."""

import json
import re
import struct
import threading
import time

import numpy as np
import plain_igtl
import pytest
from arm_process import ArmProcess
from plain_igtl import PlainClient

from sim.episode.setup import build_setup
from sim.live.arm.tcp_controller import TcpController
from sim.live.igtl.link import LinkSettings
from sim.live.service import ServiceSettings
from sim.running.fields import config_of
from sim.running.live.serving import Serving, serve
from sim.running.parts import make_parts

pytest.importorskip("pyigtl")


def told_of(body):
    return json.loads(body[4 : 4 + struct.unpack(">H", body[2:4])[0]])


def true_tip(config, arm):
    """Where the tip is by the arm's own word, shape (4, 4) [m]; no other client may be there."""
    parts = make_parts(config)
    chain = build_setup(
        parts.scenario, parts.arm, parts.map_settings, probe=parts.probe
    ).positioner.search.chain
    with TcpController("127.0.0.1", arm.port) as controller:
        tip, T = chain.forward(controller.state().q[None]), np.eye(4)
    T[:3, :3], T[:3, 3] = tip.R_world_tip[0], tip.tips_m[0]
    return T


def test_readings_from_outside_count_from_where_the_arm_is(tmp_path) -> None:
    arm, told, done = ArmProcess("--error-mrad", 1), [], []
    (tmp_path / "case.toml").write_text('base = "sphere"\nscore_spacing_m = 0.012\n')
    config = config_of(scenario=str(tmp_path / "case.toml"), tip_speed_mm_s=1000.0)
    serving = Serving(
        folder=tmp_path / "out", link=LinkSettings(port=0), service=ServiceSettings(), n_steps=1,
        controller=("127.0.0.1", arm.port),
    )  # fmt: skip
    thread = threading.Thread(target=lambda: done.append(serve(config, serving, told.append)))
    thread.start()
    deadline = time.monotonic() + 120.0
    while not (found := [match for line in told if (match := re.search(r"listening at [\d.]+:(\d+)", line))]):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    client = PlainClient(int(found[0][1]))
    # Who says where the tip is beside the arm is refused, and told so with the next decision.
    T_other = np.eye(4)
    client.socket.sendall(plain_igtl.transform("Tip", T_other))
    wanted = plain_igtl.matrix_of(client.wait_for("SoundingProposed")[1])
    _, body = client.wait_for(
        "SoundingTip",
        lambda body: np.linalg.norm(plain_igtl.matrix_of(body)[:3, 3] - wanted[:3, 3]) < 4.0,
    )
    tip = plain_igtl.matrix_of(body)
    # The tip may still be on its last millimetres: the reading is sent once it rests.
    while not np.array_equal(newest := plain_igtl.matrix_of(client.wait_for("SoundingTip")[1]), tip):
        tip = newest
    away = np.random.default_rng(0).uniform([-8.0, -8.0, 2.0], [8.0, 8.0, 60.0], (300, 3))
    places = away @ tip[:3, :3].T + tip[:3, 3]
    client.socket.sendall(plain_igtl.points("Points", places, ["free"] * 300))
    _, body = client.wait_for("SoundingDecision", lambda body: told_of(body)["sensed"] == 1)
    assert told_of(body)["refused"] == {"unknown": 1}
    client.close()
    thread.join(timeout=60.0)
    assert done == [1]
    with np.load(tmp_path / "out" / "events" / "00001.npz") as event:
        # By a milliradian a joint the true tip is off the proposed one, and it is the true one that counts.
        off_mm = np.linalg.norm(tip[:3, 3] - wanted[:3, 3])
        assert 0.01 < off_mm < 4.0
        assert len(event["points_m"]) > 0
        np.testing.assert_allclose(event["T_world_probe"], true_tip(config, arm), atol=1e-9)
    record = arm.record()
    assert record["longest_unheard_s"] <= 0.1
    arm.close()
