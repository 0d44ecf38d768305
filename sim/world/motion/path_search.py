"""Path search: collision-free joint paths between stand-offs, and the straight way of the probe down to a pose."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from sim.world.ik.chain import Array
from sim.world.ik.damped_least_squares import descend, pose_errors
from sim.world.ik.search import IkSearch
from sim.world.scene.clearance import PROBE_MARGIN_M, Collision

from .curve import rounded, through
from .path_check import PathCheck
from .path_tree import connect_trees
from .timing import STILL

LINE_SPACING_M = 0.002
"""Configurations on the straight way to a pose are this far apart."""
MAX_LINE_TURN_RAD = 0.15
"""No joint turns more than this between two of them [rad or m], or the arm would swing beside its line."""
LINE_TOLERANCE_M, LINE_TOLERANCE_RAD = 1e-4, 2e-3
"""How closely tip and beam follow the line."""
LINE_SLACK = 5.0
"""An arm that misses the line by this many tolerances cannot follow it."""
RISES_M = (0.06, 0.12, 0.2)
"""Where the straight transfer collides, the tip is led over it in arches of these heights."""
ARCH_SHARES = np.array([0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95])
"""Where along an arch its configurations stand."""
ARCH_STEEPNESS = 4.0
"""An arch has its full height after this fraction, one fourth, of the way."""
ARCH_TOLERANCE_M, ARCH_TOLERANCE_RAD = 0.01, 0.1
"""How closely the arm follows an arch."""
FLANK_SLACK_M = 5e-4
"""Between pose and stand-off the probe's flank may seem this deep in the organ: what the distance grid rounds off."""
SLIDE_TOLERANCE_M, SLIDE_TOLERANCE_RAD = 5e-4, 0.06
"""How closely tip and beam follow a way over the surface, also between the configurations that it is made of."""
MAX_SLIDE_TURN_RAD = 0.35
"""No joint turns more than this between two configurations of such a way [rad or m]: more is no sliding."""
CURVE_SAMPLES = 3
"""A rounded path is looked at this many times per knot of its curve: between those it is as good as straight."""


@dataclass(frozen=True, eq=False)
class Path:
    """Smooth curves of configurations of the chain, or the reason why there is no path.

    A path of no curves and no reason leads nowhere, since its ends are the same.
    """

    curves: tuple[CubicSpline, ...]
    """The arm comes to rest at the end of each."""
    reason: str = ""
    """A sentence that names the pair that collides; empty where there is a path."""

    @property
    def is_free(self) -> bool:
        """Whether there is a path."""
        return not self.reason


class PathSearch:
    """Finds joint paths of an arm. The path between two configurations depends on nothing but these."""

    def __init__(self, search: IkSearch, check: PathCheck) -> None:
        """Use the chain, the tolerances and the start set of `search`."""
        self._search, self._chain, self._check = search, search.chain, check

    def line(
        self, contact_q: Array, standoff_q: Array, position_m: Array, normal: Array, *, press_m: float = 0.0
    ) -> Path:
        """The way from a pose along its normal to the stand-off, the tip on a straight line.

        Args:
            contact_q: Configuration of the chain at the pose, shape (n,).
            standoff_q: Above it, shape (n,).
            position_m: The pose [m], shape (3,).
            normal: Its inward unit normal, shape (3,).
            press_m: How far the way goes on below the surface, where the organ gives way.
        """
        standoff_m = self._search.settings.standoff_m
        n = int(np.ceil(standoff_m / LINE_SPACING_M)) + 1
        if n < 2:
            return Path((through(np.stack([contact_q, standoff_q])),))
        share = np.linspace(0.0, 1.0, n)[:, None]
        seeds = contact_q + share * (standoff_q - contact_q)
        lift_m = standoff_m * share
        if press_m > 0.0:
            deeper_m = np.linspace(press_m, 0.0, int(np.ceil(press_m / LINE_SPACING_M)) + 1)[:-1, None]
            seeds = np.vstack([np.tile(contact_q, (len(deeper_m), 1)), seeds])
            lift_m = np.vstack([-deeper_m, lift_m])
        n = len(lift_m)
        at_m = position_m - lift_m * normal
        along = np.tile(normal, (n, 1))
        found = descend(
            self._chain, seeds, at_m, along, centring_gain=0.0,
            position_tolerance_m=LINE_TOLERANCE_M, angle_tolerance_rad=LINE_TOLERANCE_RAD,
        )  # fmt: skip
        q = np.vstack([found.q[:-1], standoff_q])
        q[lift_m[:, 0] == 0.0] = contact_q
        is_off = (found.distance_m > LINE_SLACK * LINE_TOLERANCE_M) | (
            found.angle_rad > LINE_SLACK * LINE_TOLERANCE_RAD
        )
        if is_off.any() or np.abs(np.diff(q, axis=0)).max() > MAX_LINE_TURN_RAD:
            return Path((), "The arm cannot follow the normal between pose and stand-off.")
        hit = self._hit_on_line(q[lift_m[:, 0] >= 0.0])
        return Path((), f"On the way from the stand-off to the pose, {hit}.") if hit else Path((through(q),))

    def slide(self, q: Array, places_m: Array, beams: Array) -> Path:
        """The way of the probe over the organ, its face kept on the surface.

        Args:
            q: Configurations of the chain on the way, shape (K, n), K at least 2.
            places_m: Where the tip is in each [m], shape (K, 3).
            beams: Where the beam points in each, unit vectors, shape (K, 3).
        """
        steps = np.abs(np.diff(q, axis=0)).max(axis=1)
        if steps.max() > MAX_SLIDE_TURN_RAD:
            return Path((), "The arm cannot slide on without turning over.")
        # The tip goes as far from each configuration to the next, and a spline over that way swings least.
        curve = CubicSpline(np.arange(len(q), dtype=np.float64), q)
        between = np.linspace(0.0, len(q) - 1.0, 2 * len(q) - 1)
        dense, low = curve(between), np.floor(between).astype(np.int64)
        dense = np.clip(dense, self._chain.low, self._chain.high)
        high, share = np.minimum(low + 1, len(q) - 1), (between - low)[:, None]
        along = (1.0 - share) * beams[low] + share * beams[high]
        away_m, off_rad = pose_errors(
            self._chain.forward(dense),
            (1.0 - share) * places_m[low] + share * places_m[high],
            along / np.linalg.norm(along, axis=1, keepdims=True),
        )
        if (away_m > SLIDE_TOLERANCE_M).any() or (off_rad > SLIDE_TOLERANCE_RAD).any():
            return Path((), "The arm cannot keep the probe on the surface between two poses.")
        hit = self._hit_on_line(dense)
        return Path((), f"On the way over the organ, {hit}.") if hit else Path((curve,))

    def transfer(self, start_q: Array, end_q: Array) -> Path:
        """A free path between two configurations with the probe lifted: the straight one, or a way around."""
        straight = np.stack([start_q, end_q])
        if np.abs(end_q - start_q).max() <= STILL:
            return Path(())
        hit = self._check.first_hit(straight)
        if hit is None:
            return Path((through(straight),))
        for way in self._ways_around(start_q, end_q):
            curve = through(rounded(way))
            if self._is_free_along(curve):
                return Path((curve,))
        tree = connect_trees(start_q, end_q, self._is_free_between, self._search.starts.q)
        if tree is None:
            return Path((), f"No free path leads to the pose: going straight, {hit}.")
        short = self._shortened(tree)
        curve = through(rounded(short))
        if self._is_free_along(curve):
            return Path((curve,))
        return Path(tuple(through(np.stack(ends)) for ends in pairwise(short)))

    def _is_free_along(self, curve: CubicSpline) -> bool:
        """Whether the way along a curve is free."""
        knots = np.linspace(0.0, curve.x[-1], CURVE_SAMPLES * len(curve.x))
        return self._check.first_hit(curve(knots)) is None

    def is_free_at(self, q: Array) -> bool:
        """Whether a configuration itself is free."""
        return self._check.is_free(np.stack([q, q]))

    def is_lifted_at(self, q: Array) -> bool:
        """Whether a configuration is free, and its whole probe as far from the organ as on a transfer."""
        return self._check.is_lifted(q)

    def _is_free_between(self, start_q: Array, end_q: Array) -> bool:
        """Whether the straight way between two configurations is free."""
        return self._check.is_free(np.stack([start_q, end_q]))

    def _hit_on_line(self, q: Array) -> Collision | None:
        """What is in the way between pose and stand-off, where the probe's face may touch the organ, or None."""
        meter = self._search.meter
        clearances = meter.measure(self._chain.full(q))
        state = self._chain.forward(q)
        probe_m, geom = self._search.clearance.probe_distances(state.tips_m, state.R_world_tip)
        is_bad = ~clearances.is_free | (probe_m < PROBE_MARGIN_M - FLANK_SLACK_M)
        if not is_bad.any():
            return None
        index = int(np.argmax(is_bad))
        return meter.collision(clearances, index) or meter.probe_collision(
            float(probe_m[index]), int(geom[index])
        )

    def _ways_around(self, start_q: Array, end_q: Array) -> list[Array]:
        """Paths to try before a search: arches of growing height between the stand-offs, and the way by home."""
        ways = [way for rise_m in RISES_M if (way := self._arch(start_q, end_q, rise_m)) is not None]
        return [*ways, np.stack([start_q, self._chain.home, end_q])]

    def _arch(self, start_q: Array, end_q: Array, rise_m: float) -> Array | None:
        """A path whose tip goes up, over and down, or None where the arm cannot follow it."""
        state = self._chain.forward(np.stack([start_q, end_q]))
        share = ARCH_SHARES[:, None]
        tips_m = state.tips_m[0] + share * (state.tips_m[1] - state.tips_m[0])
        tips_m[:, 2] += rise_m * np.minimum(1.0, ARCH_STEEPNESS * np.minimum(ARCH_SHARES, 1.0 - ARCH_SHARES))
        beams = state.beams[0] + share * (state.beams[1] - state.beams[0])
        beams /= np.maximum(np.linalg.norm(beams, axis=1, keepdims=True), 1e-9)
        found = descend(
            self._chain, start_q + share * (end_q - start_q), tips_m, beams, centring_gain=0.0,
            position_tolerance_m=ARCH_TOLERANCE_M, angle_tolerance_rad=ARCH_TOLERANCE_RAD, max_steps=15,
        )  # fmt: skip
        if (found.distance_m > ARCH_TOLERANCE_M).any():
            return None
        return np.vstack([start_q, found.q, end_q])

    def _shortened(self, path: Array) -> Array:
        """A path without the corners that it does not need."""
        kept, here = [path[0]], 0
        while here < len(path) - 1:
            ahead = next(
                later
                for later in range(len(path) - 1, here, -1)
                if later == here + 1 or self._is_free_between(path[here], path[later])
            )
            kept.append(path[ahead])
            here = ahead
        return np.stack(kept)
