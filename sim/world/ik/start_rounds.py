"""The approach: a round of starts brought to their poses, and the best of each pose lifted to the stand-off above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.scene.clearance import PROBE_MARGIN_M, Clearance
from sim.world.scene.clearance_meter import ClearanceMeter

from .attempts import Trials, comfort
from .chain import Array, Chain
from .damped_least_squares import AXIS_WEIGHT_M, Descent, descend
from .settings import IkSettings


@dataclass(frozen=True, eq=False)
class Round:
    """Starts of one round, one row each, and the poses that they are for."""

    owner: NDArray[np.int64]
    """The pose that the start belongs to; the starts of a pose stand together, and poses in rising order."""
    starts: Array
    positions_m: Array
    """Of the poses, one row per start [m]."""
    normals: Array
    is_tight: NDArray[np.bool_]
    """Where the probe comes so close to the organ that each configuration has to be looked at."""


class StartRounds:
    """Brings starts to poses of one arm."""

    def __init__(
        self, chain: Chain, meter: ClearanceMeter, clearance: Clearance, settings: IkSettings
    ) -> None:
        """Keep what an approach needs."""
        self._chain, self._meter, self._clearance, self._settings = chain, meter, clearance, settings

    def try_starts(self, starts: Round) -> Trials:
        """What each start comes to.

        All descend to their pose and are looked at for contacts there; then the most comfortable answer of each pose
        is lifted to the stand-off, and the others only where it cannot be.
        """
        contact = self._descend(starts.starts, starts.positions_m, starts.normals)
        is_there = self._is_within(contact)
        trials = Trials(
            owner=starts.owner,
            q=contact.q,
            q_standoff=contact.q.copy(),
            distance_m=contact.distance_m,
            angle_rad=contact.angle_rad,
            n_steps=contact.n_steps,
            is_there=is_there,
            is_free=np.zeros(len(is_there), dtype=bool),
            is_valid=np.zeros(len(is_there), dtype=bool),
            miss_m=contact.distance_m + AXIS_WEIGHT_M * contact.angle_rad,
            hits={},
            clearance_m=np.full(len(is_there), np.nan),
            comfort=np.full(len(is_there), -np.inf),
        )
        rows = np.flatnonzero(is_there)
        trials.is_free[rows] = self._free(rows, trials.q, "At the pose", starts, trials, measures=True)
        free = np.flatnonzero(trials.is_free)
        trials.comfort[free] = comfort(self._chain, trials.q[free], trials.clearance_m[free])
        if self._settings.standoff_m == 0.0:
            trials.is_valid[:] = trials.is_free
        else:
            self._lift(starts, trials)
        return trials

    def _lift(self, starts: Round, trials: Trials) -> None:
        """Lift the most comfortable free answer of each pose, and all others of it only where that one fails."""
        rows = np.flatnonzero(trials.is_free)
        order = rows[np.lexsort((-trials.comfort[rows], trials.owner[rows]))]
        best = order[np.unique(trials.owner[order], return_index=True)[1]]
        self._lift_rows(best, starts, trials)
        is_done = np.isin(trials.owner, trials.owner[trials.is_valid])
        others = trials.is_free & ~is_done
        others[best] = False
        self._lift_rows(np.flatnonzero(others), starts, trials)

    def _lift_rows(self, rows: NDArray[np.int64], starts: Round, trials: Trials) -> None:
        if not len(rows):
            return
        above_m = starts.positions_m[rows] - self._settings.standoff_m * starts.normals[rows]
        above = self._descend(trials.q[rows], above_m, starts.normals[rows])
        trials.q_standoff[rows] = above.q
        trials.n_steps[rows] += above.n_steps
        trials.miss_m[rows] = above.distance_m + AXIS_WEIGHT_M * above.angle_rad
        lifted = rows[self._is_within(above)]
        trials.is_valid[lifted] = self._free(lifted, trials.q_standoff, "Above the pose", starts, trials)

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

    def _free(
        self,
        rows: NDArray[np.int64],
        q: Array,
        place: str,
        starts: Round,
        trials: Trials,
        *,
        measures: bool = False,
    ) -> NDArray[np.bool_]:
        """Which of the rows touch nothing forbidden; writes what the others touch, and the clearance if asked to."""
        if not len(rows):
            return np.zeros(0, dtype=bool)
        clearances = self._meter.measure(self._chain.full(q[rows]))
        probe_m, geom = np.full(len(rows), np.inf), np.zeros(len(rows), dtype=np.int64)
        tight = np.flatnonzero(starts.is_tight[rows])
        state = self._chain.forward(q[rows[tight]])
        probe_m[tight], geom[tight] = self._clearance.probe_distances(state.tips_m, state.R_world_tip)
        is_free = clearances.is_free & (probe_m >= PROBE_MARGIN_M)
        for index in np.flatnonzero(~is_free).tolist():
            hit = self._meter.collision(clearances, index) or self._meter.probe_collision(
                float(probe_m[index]), int(geom[index])
            )
            trials.hits[int(rows[index])] = f"{place} {hit}."
        if measures:
            trials.clearance_m[rows] = clearances.clearance_m
        return is_free
