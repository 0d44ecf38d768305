"""Planners and sensors of a user's own, as files, and what is said of texts that lead nowhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.errors import UsageError
from sim.plugs import PLANNER, PlugError, make_plug

OWN_PLANNER = """
from dataclasses import dataclass
from planner import ExpectedImprovement, Planner

RATE = 0.5

@dataclass(frozen=True)
class LastFirst(Planner):
    step: int = 1
    needs_belief = False

    def __post_init__(self):
        if self.step < 1:
            raise ValueError(f"step={self.step}: must be 1 or more.")

    def rank(self, situation):
        yield from range(len(situation.workspace) - 1, -1, -self.step)

class Unfinished(Planner):
    needs_belief = False

class Careless(LastFirst):
    def __init__(self, n_poses: int, *, step: "int" = 2):
        raise KeyError("nowhere")

class Silent(Planner):
    def rank(self, situation):
        yield from ()

class Holder:
    Inner = LastFirst

def make():
    return LastFirst()
"""

OWN_SENSOR = """
from sim.world.sensing.sensor import Sensor

class Blind(Sensor):
    def sense(self, state, rng):
        raise NotImplementedError

class Free:
    def sense(self, state, rng):
        raise NotImplementedError

class Dumb:
    pass

class Open(Sensor):
    pass
"""


def add_package(folder: Path, name: str, group: str, entries: dict[str, str]) -> None:
    """Lay down what an installed package tells of itself."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{entry} = {value}" for entry, value in entries.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))


def error_of(text: str, kind=PLANNER, options: dict | None = None, **more) -> str:
    """What is said of a bad text, without line breaks in it."""
    with pytest.raises(PlugError) as caught:
        make_plug(text, kind, options or {}, **more)
    assert isinstance(caught.value, UsageError)
    assert "\n" not in str(caught.value)
    return str(caught.value)
