"""Finished work is not lost for a terminal: any encoding, closed streams, readers that went away."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
COMMAND = f"{sys.executable} -m sim.cli"
EPISODE = f"{COMMAND} episode --planner random --steps 1 --arm none"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="speaks to a POSIX shell")


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """What a shell's line does; its last word is the exit code of the first command of a pipe."""
    return subprocess.run(
        ["bash", "-c", f"{line}\nexit ${{PIPESTATUS[0]}}"],
        capture_output=True,
        timeout=300,
        cwd=ROOT,
        env={**os.environ, **environment},
    )


def said(errors: bytes) -> list[str]:
    """The lines of stderr beside the bar of progress."""
    lines = errors.decode().replace("\r", "\n").splitlines()
    return [line for line in lines if line.strip() and not line.startswith("sensing:")]


@pytest.mark.parametrize(
    ("redirection", "environment"),
    [
        ("", {"LC_ALL": "C", "PYTHONUTF8": "0"}),
        ("<&- >&- 2>&-", {}),
        ("2>/dev/full | true", {}),
    ],
)
def test_an_episode_ends_well_wherever_it_prints(tmp_path, redirection, environment) -> None:
    out, case = tmp_path / "läsion", tmp_path / "case.toml"
    # Nothing depends on how fine it is.
    case.write_text('base = "sphere"\nn_poses = 60\nscore_spacing_m = 0.016\n')
    done = shell(f"{EPISODE} --scenario {case} --out '{out}' {redirection}", **environment)
    assert done.returncode == 0
    assert not said(done.stderr)
    assert json.loads((out / "manifest.json").read_text())["status"] == "finished"
    assert "läsion" in (out / "report.html").read_text(encoding="utf-8")
    if not redirection:
        assert b"was sensed  -\n" in done.stdout


@pytest.mark.parametrize("line", ["--help >&-", "episode --help | true", "report --help 2>&-"])
def test_a_command_that_only_prints_is_silent_when_nobody_reads(line) -> None:
    done = shell(f"{COMMAND} {line}")
    assert (done.returncode, done.stderr) == (0, b"")


def test_help_in_plain_letters_has_no_question_marks() -> None:
    done = shell(f"{COMMAND} replay --help", PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert b"?" not in done.stdout
    assert b"--speed" in done.stdout


def test_a_full_disk_under_stdout_is_one_sentence(tmp_path) -> None:
    done = shell(f"{COMMAND} replay --help >/dev/full")
    assert done.returncode == 2
    assert len(said(done.stderr)) == 1
    assert b"No space left" in done.stderr


def test_what_compiled_code_prints_goes_nowhere_and_python_prints_on() -> None:
    code = (
        "import ctypes; from sim.streams import quiet_stdout; print('before')\n"
        "with quiet_stdout(): ctypes.CDLL(None).printf(b'from C\\n')\n"
        "print('after')"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["before", "after"]
