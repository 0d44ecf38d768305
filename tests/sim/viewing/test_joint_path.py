"""The timed path of the joints as a file: what others read in it is what the run recorded."""

from __future__ import annotations

import csv
import json
import shutil

import mujoco
import numpy as np
import pytest
from shared_runs import N_ARM_ACTIONS

from sim.cli.command_line import main
from sim.record.recording import read_recording
from sim.record.trajectories import read_motions


@pytest.fixture
def run(arm_run, tmp_path):
    return shutil.copytree(arm_run, tmp_path / "run")


def test_the_table_takes_the_tip_where_the_run_had_it(run, tmp_path, capsys) -> None:
    out = tmp_path / "new folder" / "joints.csv"
    assert main(["replay", str(run), "--joints", str(out)]) == 0
    assert f"joints to {out}" in capsys.readouterr().out
    with out.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = [name for name in rows[0] if name.endswith("_rad")]
    assert names == [f"joint{i}_rad" for i in range(1, 8)]
    time_s = np.array([float(row["time_s"]) for row in rows])
    assert time_s[0] == 0.0
    assert (np.diff(time_s) > 0.0).all()
    assert time_s[-1] == pytest.approx(json.loads((run / "summary.json").read_text())["procedure_s"])
    recording = read_recording(run)
    model = recording.scene.model
    data = mujoco.MjData(model)
    begin_s = 0.0
    for step, motion in read_motions(run).items():
        # Half way through the motion, and where it ends, which holds until the sensing is over.
        for index in (len(motion.time_s) // 2, len(motion.time_s) - 1):
            at_s = begin_s + motion.time_s[index]
            row = int(np.argmin(np.abs(time_s - at_s)))
            assert time_s[row] == pytest.approx(at_s, abs=1e-9)
            assert int(rows[row]["step"]) == step
            data.qpos[:] = [float(rows[row][name]) for name in names]
            mujoco.mj_kinematics(model, data)
            np.testing.assert_allclose(data.site("probe_tip").xpos, motion.tips_m[index], atol=1e-9)
        begin_s += motion.motion_s + recording.sensing_s
    assert int(rows[-1]["step"]) == N_ARM_ACTIONS


def test_the_message_says_the_same_as_the_table(run, tmp_path) -> None:
    table, message = tmp_path / "joints.csv", tmp_path / "joints.json"
    for out in (table, message):
        assert main(["replay", str(run), "--joints", str(out)]) == 0
    trajectory = json.loads(message.read_text())
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert set(trajectory) == {"header", "joint_names", "points"}
    assert len(trajectory["points"]) == len(rows)
    for row, point in zip(rows, trajectory["points"], strict=True):
        assert set(point) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
        assert point["positions"] == [float(row[f"{name}_rad"]) for name in trajectory["joint_names"]]
        at = point["time_from_start"]
        assert 0 <= at["nanosec"] < 1_000_000_000
        assert at["sec"] + 1e-9 * at["nanosec"] == pytest.approx(float(row["time_s"]), abs=1e-8)


def test_a_path_that_nobody_looked_at_is_not_written(run, tmp_path, capsys) -> None:
    config = json.loads((run / "config.json").read_text())
    config["options"]["motion"] = "none"
    (run / "config.json").write_text(json.dumps(config))
    out = tmp_path / "joints.csv"
    assert main(["replay", str(run), "--joints", str(out)]) == 2
    assert "nobody looked at the way between" in capsys.readouterr().err
    assert not out.exists()


def test_other_kinds_of_file_are_refused(run, capsys) -> None:
    assert main(["replay", str(run), "--joints", "path.yaml"]) == 2
    assert "must end with .csv or .json" in capsys.readouterr().err
