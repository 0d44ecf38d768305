"""Rounds of starts: each is brought to its pose, and the best answer of each pose is lifted to the stand-off above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.scene.clearance import PROBE_MARGIN_M, Clearance
from sim.world.scene.clearance_meter import ClearanceMeter

from .attempts import Attempts, comfort
from .chain import Array, Chain
from .damped_least_squares import Descent, descend
from .settings import IkSettings


@dataclass(frozen=True, eq=False)
class Round:
    """Starts of one round, one row each, and the poses that they are for."""

    owner: NDArray[np.int64]
    """The pose that each start belongs to, shape (N,). The starts of a pose stand together, poses in rising order."""
    starts: Array
    """Joint positions of the chain, shape (N, n)."""
    positions_m: Array
    """Of the poses, one row per start [m], shape (N, 3)."""
    normals: Array
    """Likewise."""
    is_tight: NDArray[np.bool_]
    """Where the probe is so close to the organ that each configuration has to be looked at, shape (N,)."""


@dataclass(frozen=True, eq=False)
class _Contacts:
    """What K configurations touch."""

    is_free: NDArray[np.bool_]
    clearance_m: Array
    hits: dict[int, str]
    """By index of those that are not free."""


@dataclass(frozen=True, eq=False)
class _AtPose:
    """What became of a round of starts at their poses, one row each; see `Attempts`."""

    end: Descent
    is_there: NDArray[np.bool_]
    is_free: NDArray[np.bool_]
    clearance_m: Array
    comfort: Array
    hits: dict[int, str]
    """By row."""


@dataclass(frozen=True, eq=False)
class _Lift:
    """The way of some rows of a round to the stand-off."""

    rows: NDArray[np.int64]
    end: Descent
    is_valid: NDArray[np.bool_]
    """Whether it ends within tolerance and free."""
    hits: dict[int, str]
    """By row of the round."""


class StartRounds:
    """Brings starts to poses of one arm."""

    def __init__(
        self, chain: Chain, meter: ClearanceMeter, clearance: Clearance, settings: IkSettings
    ) -> None:
        """Keep what a round needs."""
        self._chain, self._meter, self._clearance, self._settings = chain, meter, clearance, settings

    def attempt(self, starts: Round) -> Attempts:
        """What becomes of each start.

        All descend to their poses, where contacts are looked for. Then the most comfortable free answer of each pose is
        lifted to the stand-off, and its others only where that one cannot be.
        """
        at_pose = self._at_pose(starts)
        end = at_pose.end
        q_standoff, n_steps, miss_m, hits = end.q.copy(), end.n_steps.copy(), end.error_m, dict(at_pose.hits)
        lifts = self._lifts(starts, at_pose) if self._settings.standoff_m > 0.0 else ()
        is_valid = np.zeros_like(at_pose.is_free) if lifts else at_pose.is_free
        for lift in lifts:
            q_standoff[lift.rows] = lift.end.q
            n_steps[lift.rows] += lift.end.n_steps
            miss_m[lift.rows] = lift.end.error_m
            is_valid[lift.rows] = lift.is_valid
            hits |= lift.hits
        return Attempts(
            q=end.q,
            q_standoff=q_standoff,
            distance_m=end.distance_m,
            angle_rad=end.angle_rad,
            n_steps=n_steps,
            is_there=at_pose.is_there,
            is_free=at_pose.is_free,
            is_valid=is_valid,
            miss_m=miss_m,
            hits=hits,
            clearance_m=at_pose.clearance_m,
            comfort=at_pose.comfort,
        )

    def _at_pose(self, starts: Round) -> _AtPose:
        """Where the starts end at their poses, and what they touch there."""
        end = self._descend(starts.starts, starts.positions_m, starts.normals)
        is_there, n = self._is_within(end), len(end.q)
        there = np.flatnonzero(is_there)
        found = self._contacts(end.q[there], starts.is_tight[there], "At the pose")
        is_free, clearance_m, comforts = np.zeros(n, dtype=bool), np.full(n, np.nan), np.full(n, -np.inf)
        is_free[there], clearance_m[there] = found.is_free, found.clearance_m
        free = np.flatnonzero(is_free)
        comforts[free] = comfort(self._chain, end.q[free], clearance_m[free])
        hits = {int(there[index]): text for index, text in found.hits.items()}
        return _AtPose(end, is_there, is_free, clearance_m, comforts, hits)

    def _lifts(self, starts: Round, at_pose: _AtPose) -> tuple[_Lift, _Lift]:
        """The lift of the most comfortable free answer of each pose, and that of its others where that one fails."""
        rows = np.flatnonzero(at_pose.is_free)
        order = rows[np.lexsort((-at_pose.comfort[rows], starts.owner[rows]))]
        best = order[np.unique(starts.owner[order], return_index=True)[1]]
        first = self._lift(best, starts, at_pose.end.q)
        is_other = at_pose.is_free & ~np.isin(starts.owner, starts.owner[best[first.is_valid]])
        is_other[best] = False
        return first, self._lift(np.flatnonzero(is_other), starts, at_pose.end.q)

    def _lift(self, rows: NDArray[np.int64], starts: Round, q: Array) -> _Lift:
        """The way of some rows from their answers `q` to the stand-off."""
        above_m = starts.positions_m[rows] - self._settings.standoff_m * starts.normals[rows]
        end = self._descend(q[rows], above_m, starts.normals[rows])
        within = np.flatnonzero(self._is_within(end))
        found = self._contacts(end.q[within], starts.is_tight[rows[within]], "Above the pose")
        is_valid = np.zeros(len(rows), dtype=bool)
        is_valid[within] = found.is_free
        hits = {int(rows[within[index]]): text for index, text in found.hits.items()}
        return _Lift(rows, end, is_valid, hits)

    def _descend(self, starts: Array, positions_m: Array, normals: Array) -> Descent:
        settings = self._settings
        return descend(
            self._chain,
            starts,
            positions_m,
            normals,
            position_tolerance_m=settings.position_tolerance_m,
            angle_tolerance_rad=settings.angle_tolerance_rad,
            max_steps=settings.max_iterations,
            max_step_rad=settings.max_step_rad,
        )

    def _is_within(self, descent: Descent) -> NDArray[np.bool_]:
        return (descent.distance_m <= self._settings.position_tolerance_m) & (
            descent.angle_rad <= self._settings.angle_tolerance_rad
        )

    def _contacts(self, q: Array, is_tight: NDArray[np.bool_], place: str) -> _Contacts:
        """What configurations touch, shape (K, n); `place` begins the sentence that says it."""
        n = len(q)
        if n == 0:
            return _Contacts(np.zeros(0, dtype=bool), np.zeros(0), {})
        clearances = self._meter.measure(self._chain.full(q))
        probe_m, geom = np.full(n, np.inf), np.zeros(n, dtype=np.int64)
        tight = np.flatnonzero(is_tight)
        state = self._chain.forward(q[tight])
        probe_m[tight], geom[tight] = self._clearance.probe_distances(state.tips_m, state.R_world_tip)
        is_free = clearances.is_free & (probe_m >= PROBE_MARGIN_M)
        hits = {}
        for index in np.flatnonzero(~is_free).tolist():
            hit = self._meter.collision(clearances, index) or self._meter.probe_collision(
                float(probe_m[index]), int(geom[index])
            )
            hits[index] = f"{place} {hit}."
        return _Contacts(is_free, clearances.clearance_m, hits)
