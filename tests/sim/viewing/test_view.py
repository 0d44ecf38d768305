"""The view: a clear word without a display, and a Rerun recording that holds the run."""

from __future__ import annotations

import pytest

from sim.cli.command_line import main


def test_without_a_display_the_other_ways_are_named(arm_run, capsys, monkeypatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(arm_run)]) == 2
    said = capsys.readouterr().err
    assert "no display" in said
    assert "report.html" in said


def test_bad_options_are_refused(arm_run, tmp_path, capsys) -> None:
    assert main(["view", str(arm_run), "--rerun", str(tmp_path / "run.mp4")]) == 2
    assert "must end with .rrd" in capsys.readouterr().err
    assert main(["view", str(arm_run), "--speed", "0"]) == 2
    assert main(["view", str(tmp_path)]) == 2


def test_a_missing_extra_is_named(arm_run, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    assert main(["view", str(arm_run), "--rerun", str(tmp_path / "run.rrd")]) == 2
    assert "[rerun]'" in capsys.readouterr().err


def test_the_rerun_recording_is_written(arm_run, tmp_path, capsys) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'sounding[rerun]'")
    out = tmp_path / "deep" / "run.rrd"
    assert main(["view", str(arm_run), "--rerun", str(out)]) == 0
    assert "wrote 4 actions" in capsys.readouterr().out
    assert out.read_bytes()[:4] == b"RRF2"
    assert out.stat().st_size > 20_000
