"""Replay: from recorded states alone, as a table and as a real MP4."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from shared_runs import N_ARM_ACTIONS

from sim.cli.command_line import main


@pytest.fixture
def run(arm_run, tmp_path):
    """A recorded run; its arm stood beside the organ, and a replay puts it there."""
    return shutil.copytree(arm_run, tmp_path / "run")


def test_a_replay_agrees_with_what_was_recorded(run, capsys, monkeypatch) -> None:
    def never(*_arguments, **_more):
        raise AssertionError("a replay solves nothing")

    monkeypatch.setattr("sim.world.ik.search.IkSearch.search", never)
    monkeypatch.setattr("sim.world.ik.kinematics.Kinematics.solve", never)
    assert main(["replay", str(run)]) == 0
    text = capsys.readouterr().out
    assert text.count("as recorded") == N_ARM_ACTIONS
    total_s = json.loads((run / "summary.json").read_text())["procedure_s"]
    assert (
        f"{N_ARM_ACTIONS} actions, procedure {total_s:.1f} s, of which sensing {2 * N_ARM_ACTIONS}.0 s"
        in text
    )


def test_a_changed_state_is_noticed(run, capsys) -> None:
    file = run / "motion" / "00002.npz"
    arrays = dict(np.load(file))
    arrays["states"][5, 0] += 0.01
    np.savez(file, **arrays)
    assert main(["replay", str(run)]) == 0
    assert "off by up to" in capsys.readouterr().out


def test_the_video_is_an_mp4_of_the_whole_procedure(run, tmp_path) -> None:
    av = pytest.importorskip("av")
    out = tmp_path / "replay.mp4"
    size = ["--width-px", "160", "--height-px", "120"]
    assert main(["replay", str(run), "--video", str(out), "--fps", "10", "--speed", "8", *size]) == 0
    assert out.read_bytes()[4:8] == b"ftyp"
    total_s = json.loads((run / "summary.json").read_text())["procedure_s"]
    with av.open(str(out)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert container.streams.video[0].average_rate == 10
    assert len(frames) == int(total_s * 10 / 8 + 1e-9) + 1
    assert frames[0].shape == (120, 160, 3)
    assert (np.abs(frames[0].astype(int) - frames[-1]) > 40).any()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["replay.mp4", "run"]


def test_a_missing_extra_is_named(run, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    assert main(["replay", str(run), "--video", str(tmp_path / "x.mp4")]) == 2
    assert "[video]'" in capsys.readouterr().err


def test_broken_recordings_are_one_clear_line(run, tmp_path, capsys) -> None:
    def said() -> str:
        assert main(["replay", str(run)]) == 2
        return capsys.readouterr().err

    assert main(["replay", str(tmp_path / "none")]) == 2
    assert "holds no run" in capsys.readouterr().err
    (run / "motion" / "00001.npz").write_bytes(b"PK\x03\x04 cut off")
    assert "00001.npz: cannot be read" in said()
    shutil.rmtree(run / "motion")
    assert "nothing to replay" in said()
    (run / "config.json").write_text("{}")
    assert "not the folder of an episode" in said()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--fps", "0"), "--fps 0"),
        (("--speed", "nan"), "--speed nan"),
        (("--width-px", "101"), "--width-px 101"),
        (("--video", "out.gif"), "must end with .mp4"),
    ],
)
def test_bad_options_are_refused(run, capsys, arguments, message) -> None:
    assert main(["replay", str(run), *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--motion", "servo", "--arm", "none"), "no servos"),
        (("--tip-speed-mm-s", "0"), "--tip-speed-mm-s 0.0: must be a positive"),
        (("--sensing-s", "nan"), "--sensing-s nan: must be a finite number"),
        (("--press-mm", "-1"), "--press-mm -1.0: must be from 0 to 40 mm"),
        (("--force-limit-n", "0"), "--force-limit-n 0.0: must be a positive"),
    ],
)
def test_bad_motion_options_write_nothing(tmp_path, capsys, arguments, message) -> None:
    out = tmp_path / "out"
    assert main(["episode", "--scenario", "sphere", "--steps", "1", "--out", str(out), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_stop_by_force_keeps_what_was_done(no_figures, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    options = ["--motion", "servo", "--stiffness-n-m", "6000", "--planner", "random", "--scenario", "sphere"]
    assert main(["episode", *options, "--steps", "4", "--out", str(out)]) == 2
    assert "above the limit of 5 N" in capsys.readouterr().err
    assert json.loads((out / "manifest.json").read_text())["status"] == "stopped"
    assert list((out / "motion").iterdir())
    assert main(["replay", str(out)]) == 0
