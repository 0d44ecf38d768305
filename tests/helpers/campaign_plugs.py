"""A user's folder with plugs for campaigns on a small ball: good ones, and ones that break in each way there is."""

from __future__ import annotations

from pathlib import Path

import trimesh

BALL = """
organ = "ball.stl"
organ_unit = "m"
n_tumours = 1
tumour_shape = "sphere"
tumour_radius_m = 0.010
n_poses = 60
score_spacing_m = 0.008
"""

OWN_PARTS = """
from dataclasses import dataclass, field, replace

import numpy as np

import sounding


@dataclass(frozen=True)
class Backwards(sounding.Planner):
    step: int = 1
    needs_belief = False
    preferred_map = "paper"

    def rank(self, situation):
        yield from (i for i in range(situation.workspace.n_poses - 1, -1, -self.step) if i not in situation.sensed)


class Sure(Backwards):
    def confidence(self, situation):
        return len(situation.sensed) / 4

    def rank(self, situation):
        assert len(situation.readings) == len(situation.sensed), "a situation that never came"
        yield from super().rank(situation)


@dataclass(frozen=True, kw_only=True)
class Forgetful(sounding.Sensor):
    miss_rate: float = 0.2

    def sense(self, state, rng):
        reading = sounding.ConeSensor(n_rays=20).sense(state, rng)
        return replace(reading, is_occupied=reading.is_occupied & (rng.random(len(reading.points_m)) >= self.miss_rate))


class Shares:
    '''The share of tumour in all that was sensed, everywhere the same but for a slope that ranks the points.'''

    def __init__(self, space, weight=1.0):
        self.space, self.n, self.n_tumour, self.weight = space, 1.0, 0.1, weight

    def update(self, points_m, is_occupied):
        self.n += self.weight * len(points_m)
        self.n_tumour += self.weight * np.count_nonzero(is_occupied)

    def predict_lattice(self):
        slope = np.linspace(0.9, 1.0, len(self.space.points_m))
        return sounding.Prediction.from_probability(self.n_tumour / self.n * slope)

    def save(self, path):
        np.savez(path, n=self.n, n_tumour=self.n_tumour)
"""

BROKEN = """
import sys
from dataclasses import dataclass

import numpy as np

import own_parts
from sounding import Prediction


class Refuses(own_parts.Backwards):
    def __init__(self):
        raise RuntimeError("no licence")


class Tires(own_parts.Backwards):
    def rank(self, situation):
        if len(situation.sensed) == 2:
            raise ZeroDivisionError("tired")
        yield from super().rank(situation)


class Quits(own_parts.Backwards):
    def rank(self, situation):
        sys.exit("enough")


class Boasts(own_parts.Backwards):
    def confidence(self, situation):
        return object()


class Falls(own_parts.Forgetful):
    def sense(self, state, rng):
        raise KeyError("cable")


class Overflows(own_parts.Shares):
    def update(self, points_m, is_occupied):
        super().update(points_m, is_occupied)
        if self.n > 1000:
            raise OverflowError("too many points")


class Vague(own_parts.Shares):
    def predict_lattice(self):
        unknown = np.full(len(self.space.points_m), np.nan)
        return Prediction(unknown, unknown)
"""

MENDED = "from own_parts import Backwards, Forgetful, Shares\n" + "".join(
    f"{name} = {own}\n"
    for own, names in {
        "Backwards": ("Refuses", "Tires", "Quits", "Boasts"),
        "Forgetful": ("Falls",),
        "Shares": ("Overflows", "Vague"),
    }.items()
    for name in names
)


def lay_out(folder: Path) -> None:
    """Write the ball, its scenario and the plugs."""
    trimesh.creation.icosphere(subdivisions=2, radius=0.04).export(folder / "ball.stl")
    (folder / "ball.toml").write_text(BALL)
    (folder / "own_parts.py").write_text(OWN_PARTS)
    (folder / "broken.py").write_text(BROKEN)
