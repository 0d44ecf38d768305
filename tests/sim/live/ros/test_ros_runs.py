"""Whole runs on a rosbridge stand-in: a served session, an arm's path, and an episode that is shown."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from arm_paths import path

from sim.errors import FieldError
from sim.live.arm.messages import path_of, trajectory_of
from sim.live.igtl.link import LinkSettings
from sim.live.ros.link import MAP, PATH, PROPOSED, SURFACES, TIP, RosLink
from sim.live.service import ServiceSettings
from sim.running.fields import config_of, recorded
from sim.running.live.serving import Serving, serve
from sim.running.output import output_of
from sim.running.parts import make_parts
from sim.running.run_episode import record_episode

pytest.importorskip("pyigtl")
SCENARIO = 'organ = "{}"\norgan_unit = "m"\nn_poses = 200\nscore_spacing_m = 0.008\nn_tumours = 1\n'


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(folder / "ball.stl")
    (folder / "ball.toml").write_text(SCENARIO.format(folder / "ball.stl"))
    return str(folder / "ball.toml")


def test_a_served_session_is_on_the_topics(scenario, tmp_path, bridge) -> None:
    config = config_of(scenario=scenario, arm="none", motion="none", steps=3)
    serving = Serving(
        folder=tmp_path / "out", link=LinkSettings(port=0), service=ServiceSettings(), simulates=True, speed=0.0,
        n_steps=3, ros=("127.0.0.1", bridge.port),
    )  # fmt: skip
    assert serve(config, serving, lambda text: None) == 3
    with np.load(tmp_path / "out" / "map.npz") as arrays:
        n_shown = int((arrays["probability"] >= 0.1).sum())
    # What was sent last may still be on its way: the first map, and one after each action.
    bridge.wait_for(lambda own: own.counts[MAP] == own.counts[SURFACES] == 4)
    assert n_shown > 0
    assert bridge.latest[MAP]["width"] == n_shown
    assert {PROPOSED, TIP} <= bridge.latest.keys()


def test_an_episode_is_shown_and_its_record_stays_the_same(scenario, tmp_path, bridge) -> None:
    texts = []
    for name, live in (("plain", None), ("shown", f"ws://127.0.0.1:{bridge.port}")):
        config = config_of(scenario=scenario, arm="none", steps=2, report=False, live=live)
        parts = make_parts(config)
        output = replace(output_of(config, parts, recorded(config)), folder=tmp_path / name)
        record_episode(parts, output, show_progress=False)
        texts.append((tmp_path / name / "poses.csv").read_text())
    assert texts[0] == texts[1]
    bridge.wait_for(lambda own: {TIP, MAP, SURFACES} <= own.latest.keys())


def test_a_path_that_an_arm_is_sent_is_a_joint_trajectory(bridge) -> None:
    with RosLink("127.0.0.1", bridge.port) as link:
        link.publish_path(trajectory_of(path()))
        bridge.wait_for(lambda own: PATH in own.latest)
    assert bridge.advertised[PATH] == "trajectory_msgs/JointTrajectory"
    taken = path_of(bridge.latest[PATH])
    np.testing.assert_array_equal(taken.q, path().q)
    assert taken.names == ("a", "b")


@pytest.mark.parametrize("address", ["ws://", "ws://here:99999", "http://127.0.0.1:9090"])
def test_an_address_that_is_none_is_told_before_anything_runs(address) -> None:
    with pytest.raises(FieldError, match="must be an address such as"):
        config_of(live=address)
