"""The MCAP recording, read back with Foxglove's reader, holds the run: every state, every map, every curve."""

import csv

import mujoco
import numpy as np
import pytest

import sounding
from sim.cli.command_line import main
from sim.record.poses import read_poses
from sim.record.recording import read_recording, set_state
from sim.viewing.ros_definitions import KINDS, definition

reader = pytest.importorskip("mcap_ros2.reader")


FREE = {"scenario": "sphere", "arm": "none", "report": False, "show_progress": False}


@pytest.fixture(scope="module")
def topics(arm_run, tmp_path_factory):
    """The messages of the arm's run."""
    return topics_of(arm_run, tmp_path_factory.mktemp("mcap") / "deep" / "run.mcap")


def topics_of(run, file):
    """The messages of a run by topic, with their times [s]."""
    assert main(["view", str(run), "--mcap", str(file)]) == 0
    found = {}
    for message in reader.read_ros2_messages(str(file)):
        row = (message.log_time_ns / 1e9, message.ros_msg, message.schema.name)
        found.setdefault(message.channel.topic, []).append(row)
    return found


def place_of(message):
    return [message.pose.position.x, message.pose.position.y, message.pose.position.z]


def test_the_tip_and_the_joints_are_where_the_run_had_them(arm_run, topics) -> None:
    recording = read_recording(arm_run)
    states = np.vstack([motion.states for motion in recording.motions.values()])
    tips_m = np.vstack([motion.tips_m for motion in recording.motions.values()])
    assert len(topics["/tip"]) == len(topics["/joint_states"]) == len(states)
    np.testing.assert_allclose([place_of(message) for _, message, _ in topics["/tip"]], tips_m, atol=1e-6)
    data, scene = recording.scene.new_data(), recording.scene
    for (_, tip, _), (_, joints, _), state in list(
        zip(topics["/tip"], topics["/joint_states"], states, strict=True)
    )[:: len(states) // 20]:
        set_state(scene, data, state)
        np.testing.assert_allclose(joints.position, state[: len(joints.name)], atol=1e-12)
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, data.site(scene.tip_site).xmat)
        told = tip.pose.orientation
        # A quaternion and its negative are one turn.
        assert abs(turn @ [told.w, told.x, told.y, told.z]) == pytest.approx(1.0, abs=1e-9)
    times_s = [time_s for time_s, *_ in topics["/tip"]]
    assert (np.diff(times_s) >= 0.0).all()


def test_each_action_has_its_pose_map_and_curves(arm_run, topics) -> None:
    with (arm_run / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    sensed = np.array([place_of(message) for _, message, _ in topics["/sensed"]])
    wanted = [[float(row[f"position_{axis}_m"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(
        sensed, wanted, atol=1e-3
    )  # the pose, which the arm reaches within a millimetre
    np.testing.assert_allclose(
        [message.data for _, message, _ in topics["/auprc"]], [float(row["auprc"]) for row in rows], rtol=1e-6
    )
    ends_s = np.cumsum([float(row["procedure_s"]) for row in rows])
    np.testing.assert_allclose([time_s for time_s, *_ in topics["/sensed"]], ends_s, atol=1e-6)
    assert len(topics["/map"]) == len(rows)
    last = topics["/map"][-1][1]
    values = np.frombuffer(bytes(last.data), "<f4").reshape(-1, 4)
    with np.load(arm_run / "map.npz") as arrays:
        probability = arrays["probability"][arrays["is_inside"]]
    # The history keeps log-odds in steps of 0.05, which is at most 0.6 % of probability.
    assert len(values) == pytest.approx(int((probability >= 0.1).sum()), abs=2 + 0.05 * len(values))
    assert values[:, 3].max() == pytest.approx(probability.max(), abs=0.01)


def test_the_tip_ends_where_it_sensed_in_the_drawn_organ_although_that_lay_elsewhere(tmp_path) -> None:
    run = tmp_path / "run"
    off = {"registration_mm": 12.0, "registration_deg": 5.0}
    sounding.run_episode(**FREE, **off, motion="none", planner="random", steps=2, out=str(run))
    topics, recording = topics_of(run, tmp_path / "run.mcap"), read_recording(run)
    n_states = [len(motion.states) for motion in recording.motions.values()]
    ends = np.cumsum(n_states) - 1
    for end, (_, sensed, _) in zip(ends, topics["/sensed"], strict=True):
        tip = topics["/tip"][end][1]
        np.testing.assert_allclose(place_of(tip), place_of(sensed), atol=1e-6)
        told, wanted = (
            np.array([getattr(each.pose.orientation, name) for name in "wxyz"]) for each in (tip, sensed)
        )
        assert abs(told @ wanted) == pytest.approx(1.0, abs=1e-9)


def test_a_sweep_tells_every_reading_at_its_time(sweep_run, tmp_path) -> None:
    run = sweep_run
    topics, recording = topics_of(run, tmp_path / "run.mcap"), read_recording(run)
    steps, T_world_probe = read_poses(run, "readings.csv")
    with (run / "readings.csv").open() as file:
        times_s = [float(row["time_s"]) for row in csv.DictReader(file)]
    assert len(steps) > 2
    sensed = np.array([place_of(message) for _, message, _ in topics["/sensed"]])
    np.testing.assert_allclose(sensed, T_world_probe[:, :3, 3], atol=1e-9)
    wanted_s = [recording.begins_s[step] + time_s for step, time_s in zip(steps, times_s, strict=True)]
    np.testing.assert_allclose([time_s for time_s, *_ in topics["/sensed"]], wanted_s, atol=1e-6)


def test_the_surfaces_are_those_of_the_anatomy(arm_run, topics) -> None:
    ((time_s, message, kind),) = topics["/surfaces"]
    assert (time_s, kind) == (0.0, "visualization_msgs/msg/MarkerArray")
    with np.load(arm_run / "anatomy.npz") as arrays:
        corners = arrays["organ_vertices_m"][arrays["organ_faces"]].reshape(-1, 3)
    organ = next(marker for marker in message.markers if marker.ns == "organ")
    np.testing.assert_allclose([[point.x, point.y, point.z] for point in organ.points], corners, atol=1e-12)
    assert organ.type == 11
    assert {marker.ns for marker in message.markers} >= {"organ", "tumour 1"}


def test_definitions_hold_every_type_that_they_name() -> None:
    for kind in KINDS:
        text = definition(kind)
        named = {line.split()[0].removesuffix("[]") for line in text.splitlines() if "/" in line.split()[0]}
        assert named == {line[5:] for line in text.splitlines() if line.startswith("MSG: ")}


def test_bad_options_and_a_missing_extra_are_told(arm_run, tmp_path, capsys, monkeypatch) -> None:
    assert main(["view", str(arm_run), "--mcap", str(tmp_path / "run.bag")]) == 2
    assert "must end with .mcap" in capsys.readouterr().err
    both = ["--mcap", str(tmp_path / "run.mcap"), "--rerun", str(tmp_path / "run.rrd")]
    assert main(["view", str(arm_run), *both]) == 2
    monkeypatch.setitem(__import__("sys").modules, "mcap_ros2.writer", None)
    assert main(["view", str(arm_run), *both[:2]]) == 2
    assert "[mcap]'" in capsys.readouterr().err
