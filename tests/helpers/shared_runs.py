"""Runs whose folders many tests read: what they are, and how they are made."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from two_classes import N_ACTIONS, write_meshes

from sim.cli.command_line import main

ROOT = Path(__file__).resolve().parents[2]
N_ARM_ACTIONS = 4
ARM_BASE_M = (0.45, 0.5, 0.0)
ARM_RUN = (
    *("episode", "--scenario", "sphere", "--seed", "1", "--steps", str(N_ARM_ACTIONS)),
    *("--base-mm", "450", "500", "0", "--base-yaw-deg", "-90"),
)
"""A run with the embedded arm, which stands at `ARM_BASE_M` and is turned to the right, with the default planner."""

N_SWEEPS = 3
SWEEP_OPTIONS = {
    "scenario": "sphere",
    "planner": "find-and-outline",
    "arm": "none",
    "seed": 0,
    "sense": "sweep",
}
"""A run of a free probe that senses along the way."""


def make_arm_run(folder: Path) -> None:
    """Run `ARM_RUN` by the command as a stranger does; what it printed is kept beside the folder."""
    command = [sys.executable, "-m", "sim.cli", *ARM_RUN, "--frames", "each", "--out", str(folder)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    folder.with_suffix(".stdout").write_text(run.stdout)
    folder.with_suffix(".stderr").write_text(run.stderr)


def make_two_class_run(folder: Path) -> None:
    """Write a case with a second class, and in `run` the folder of a run on it that plans for that class."""
    folder.mkdir()
    command = ["episode", "--scenario", str(write_meshes(folder)), "--steps", str(N_ACTIONS), "--seed", "2"]
    command += ["--arm", "none", "--plan-for", "target", "--frames", "last", "--out", str(folder / "run")]
    assert main(command) == 0


def make_sweep_run(folder: Path) -> None:
    """Run `SWEEP_OPTIONS`, without a report."""
    words = [part for name, value in SWEEP_OPTIONS.items() for part in (f"--{name}", str(value))]
    with without_figures():
        assert main(["episode", *words, "--steps", str(N_SWEEPS), "--no-report", "--out", str(folder)]) == 0


@contextmanager
def without_figures() -> Iterator[None]:
    """Runs and inspections within draw none of their figures."""
    with pytest.MonkeyPatch.context() as patch:
        for function in ("pictures.run_figures.draw_run_figures", "viewing.inspection.draw_inspection"):
            patch.setattr(f"sim.{function}", lambda *_arguments, **_more: None)
        yield
