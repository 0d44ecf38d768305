"""Whether a change of the code left the results as they were: `.venv/bin/python -m benchmarks.unchanged --help`.

`record` runs a study of all planners and two episodes with the code as it is, and `compare OLD NEW` names the files
that differ. The commands that `record` runs work in older checkouts too, so OLD can be recorded with the code before.
"""

from __future__ import annotations

import csv
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.episode.measures import ACTION_SECONDS

STUDY = Path(__file__).resolve().parent / "unchanged.toml"
EPISODES = {
    "run-liver": ("--scenario", "liver", "--steps", "10", "--seed", "3"),
    "run-spheres": (
        *("--scenario", "spheres", "--planner", "expected-improvement", "--arm", "none"),
        *("--steps", "8", "--seed", "2"),
    ),
}
"""Two run folders besides the study."""


@dataclass(frozen=True)
class Record:
    """Run the study and the episodes into a folder."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder to write to."""

    def run(self) -> int:
        """Run the study and the episodes, and return the exit code."""
        for name, options in EPISODES.items():
            out = ("--out", str(self.folder / name))
            subprocess.run([sys.executable, "-m", "sim.cli", "episode", *options, *out], check=True)
        study = ("--study", str(STUDY), "--out", str(self.folder / "trials"))
        return subprocess.run([sys.executable, "-m", "sim.cli", "trials", *study], check=True).returncode


@dataclass(frozen=True)
class Compare:
    """Say which files of two such folders differ, without the measured seconds."""

    old: Annotated[Path, tyro.conf.Positional]
    """Folder of the code before the change."""
    new: Annotated[Path, tyro.conf.Positional]
    """Folder of the code after it."""

    def run(self) -> int:
        """Compare all files, and return 1 where a file differs, 0 otherwise."""
        names = [Path("trials/trials.csv"), Path("trials/curves.npz")]
        names += [file.relative_to(self.old) for file in sorted(self.old.glob("run-*/steps.csv"))]
        names += [file.relative_to(self.old) for file in sorted(self.old.glob("run-*/map.npz"))]
        same = [_content(self.old / name) == _content(self.new / name) for name in names]
        for name, is_same in zip(names, same, strict=True):
            print(f"{'same' if is_same else 'DIFFERS'}  {name}")
        return 0 if all(same) else 1


def _content(file: Path) -> object:
    """The bytes of a file, or the cells of steps.csv without the measured seconds."""
    if file.name != "steps.csv":
        return file.read_bytes()
    with file.open(newline="", encoding="utf-8") as text:
        return [
            {name: cell for name, cell in row.items() if name not in ACTION_SECONDS}
            for row in csv.DictReader(text)
        ]


if __name__ == "__main__":
    sys.exit(tyro.extras.subcommand_cli_from_dict({"record": Record, "compare": Compare}).run())
