"""The search: IK of many sensing poses at once, each by several starts, the most comfortable answer chosen.

What the descent of a start minimises, and what makes an answer comfortable, is in `damped_least_squares.py`.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.world.frames import frames_along
from sim.world.scene.clearance import PROBE_MARGIN_M, Clearance
from sim.world.scene.clearance_meter import ClearanceMeter
from sim.world.scene.scene import Scene

from .attempts import Attempts, n_distinct
from .chain import Array, Chain
from .damped_least_squares import pose_errors
from .result import IkResult, IkStatus
from .result_builder import ResultBuilder
from .settings import IkSettings
from .start_rounds import Round, StartRounds
from .start_set import StartSet

CHUNK = 512
"""Poses searched together: enough that NumPy's calls are cheap, few enough that the arrays stay in the cache."""
SURE_STARTS = 12
"""After this many starts a pose is given up whose closest answer is the stretched arm, at no limit and free."""
SURE_M = 0.001
"""A probe that at the exact pose is this far from the organ is clear of it within the IK's tolerances."""


@dataclass(frozen=True, eq=False)
class Answers:
    """What the search found for N poses."""

    results: list[IkResult]
    """One per pose; joint positions are those of the whole scene."""
    clearance_m: Array
    """Least distance of the arm to table, organ and itself at the pose [m], at most `FAR_M`, NaN if not reached."""
    n_solutions: NDArray[np.int64]
    """Distinct answers among those of the first starts, shape (N,)."""

    @classmethod
    def joined(cls, parts: list[Answers]) -> Answers:
        """Answers one after the other."""
        return cls(
            [result for part in parts for result in part.results],
            np.concatenate([np.empty(0), *(part.clearance_m for part in parts)]),
            np.concatenate([np.empty(0, dtype=np.int64), *(part.n_solutions for part in parts)]),
        )

    @property
    def q(self) -> Array:
        """Joint positions of the whole scene at the poses, shape (N, nq)."""
        return np.array([result.q for result in self.results])

    @property
    def is_reached(self) -> NDArray[np.bool_]:
        """Which poses are reached, shape (N,)."""
        return np.array([result.is_reached for result in self.results], dtype=bool)


class IkSearch:
    """Solves sensing poses in batches for the arm of a scene. The answer to a pose depends on nothing but the pose."""

    def __init__(self, scene: Scene, clearance: Clearance, settings: IkSettings | None = None) -> None:
        """Read the arm's chain and draw the set of starts."""
        self.settings = settings or IkSettings()
        self.chain = Chain(scene)
        self.meter = ClearanceMeter(scene, clearance).with_padding(self.settings.padding_m)
        self.clearance = clearance
        self.starts = self._new_starts()
        self._hub = self.chain.axis_hub()
        self._reach = self.chain.hub_reach()

    def with_settings(self, settings: IkSettings) -> IkSearch:
        """The same search with other tolerances or effort; the starts stay those of this one."""
        other = copy.copy(self)
        other.settings = settings
        if settings.padding_m != self.settings.padding_m:
            other.meter = self.meter.with_padding(settings.padding_m)
        return other

    def with_effort(self, *, max_restarts: int) -> IkSearch:
        """The same search with another number of restarts."""
        return self.with_settings(replace(self.settings, max_restarts=max_restarts))

    def at_base(self, T_world_base: Array) -> IkSearch:
        """The same search with the arm's base elsewhere, at a frame of shape (4, 4).

        The starts are those of this one, carried along. They are not checked for contacts at the new place, since every
        answer is.
        """
        other = copy.copy(self)
        other.chain = self.chain.at_base(T_world_base)
        other.meter = self.meter.at_base(T_world_base)
        other.starts = self.starts.at_base(other.chain)
        other._reach = other.chain.hub_reach()
        return other

    def with_new_starts(self) -> IkSearch:
        """The same search with starts drawn afresh, free of contacts where the base stands now."""
        other = copy.copy(self)
        other.starts = other._new_starts()
        return other

    def _new_starts(self) -> StartSet:
        """Starts free of contacts; padding does not change them, so that more of it never reaches more."""
        return StartSet(self.chain, self.meter.with_padding(0.0), seed=self.settings.start_seed)

    def search(self, positions_m: Array, normals: Array) -> Answers:
        """Answers to poses: positions [m] and inward unit normals, shape (N, 3) each.

        What is not reached without padding is not reached with it, and keeps its reason. More padding never reaches
        more poses: for all others the same starts are tried, and each keeps less than with less padding.
        """
        if self.settings.padding_m > 0.0:
            return self._padded(positions_m, normals)
        return self._searched(positions_m, normals)

    def _padded(self, positions_m: Array, normals: Array) -> Answers:
        """The answers with padding, which are looked for where there are any without."""
        plain = self.with_settings(replace(self.settings, padding_m=0.0)).search(positions_m, normals)
        rows = np.flatnonzero(plain.is_reached)
        padded = self._searched(positions_m[rows], normals[rows])
        results = list(plain.results)
        clearance_m, n_solutions = plain.clearance_m.copy(), plain.n_solutions.copy()
        for row, result in zip(rows.tolist(), padded.results, strict=True):
            results[row] = result
        clearance_m[rows], n_solutions[rows] = padded.clearance_m, padded.n_solutions
        return Answers(results, clearance_m, n_solutions)

    def _searched(self, positions_m: Array, normals: Array) -> Answers:
        return Answers.joined(
            [
                self._search_chunk(positions_m[first : first + CHUNK], normals[first : first + CHUNK])
                for first in range(0, len(positions_m), CHUNK)
            ]
        )

    def too_far_m(self, positions_m: Array, normals: Array) -> Array:
        """How far poses lie beyond the stretched arm [m], shape (N,); of 0 or less nothing follows.

        The last joint lies beside the beam at a known height, so the pose tells where it must be.
        """
        height_m, beside_m = self._hub
        shoulder_m, reach_m = self._reach
        hubs_m = positions_m + height_m * normals
        return np.linalg.norm(hubs_m - shoulder_m, axis=1) - reach_m - beside_m

    def _search_chunk(self, positions_m: Array, normals: Array) -> Answers:
        n, settings = len(positions_m), self.settings
        results, is_tight = self._refused(positions_m, normals)
        clearance_m, n_solutions = np.full(n, np.nan), np.zeros(n, dtype=np.int64)
        builder = ResultBuilder(self.chain, settings, self.too_far_m)
        rows = np.array([row for row in range(n) if results[row] is None], dtype=np.int64)
        n_starts = min(settings.max_restarts + 1, len(self.starts))
        first, count = 0, settings.n_compared
        while first < n_starts and len(rows):
            last = min(first + count, n_starts)
            attempts, n_found = self._attempt(rows, first, last, positions_m, normals, is_tight)
            stays_open = np.zeros(len(rows), dtype=bool)
            for index, row in enumerate(rows.tolist()):
                mine = slice(index * (last - first), (index + 1) * (last - first))
                result, best = builder.result(
                    attempts, mine, positions_m[row], normals[row], n_before=first, earlier=results[row]
                )
                results[row] = result
                if result.is_reached:
                    clearance_m[row], n_solutions[row] = attempts.clearance_m[best], n_found[index]
                else:
                    is_sure = last > SURE_STARTS and result.status is IkStatus.TOO_FAR
                    # Poses looked for with padding have an answer without, and are none of those.
                    stays_open[index] = settings.padding_m > 0.0 or not is_sure
            rows = rows[stays_open]
            first, count = last, 2 * count
        return Answers([result for result in results if result is not None], clearance_m, n_solutions)

    def _attempt(
        self,
        rows: NDArray[np.int64],
        first: int,
        last: int,
        positions_m: Array,
        normals: Array,
        is_tight: NDArray[np.bool_],
    ) -> tuple[Attempts, NDArray[np.int64]]:
        """What becomes of the starts `first` to `last` of some poses, and how many distinct answers each has."""
        chosen = self.starts.starts(positions_m[rows], normals[rows], first, last)
        owner = np.repeat(np.arange(len(rows)), last - first)
        of_pose = rows[owner]
        starts = Round(
            owner, chosen.reshape(len(owner), -1), positions_m[of_pose], normals[of_pose], is_tight[of_pose]
        )
        attempts = self._rounds().attempt(starts)
        return attempts, n_distinct(
            attempts.q.reshape(chosen.shape), attempts.is_free.reshape(chosen.shape[:2])
        )

    def _rounds(self) -> StartRounds:
        return StartRounds(self.chain, self.meter, self.clearance, self.settings)

    def is_reached_from(self, starts: Array, position_m: Array, normal: Array) -> bool:
        """Whether any start of the caller's, shape (N, n), leads to one pose, shape (3,) each."""
        n = len(starts)
        owner, is_tight = np.zeros(n, dtype=np.int64), np.ones(n, dtype=bool)
        given = Round(owner, starts, np.tile(position_m, (n, 1)), np.tile(normal, (n, 1)), is_tight)
        return bool(self._rounds().attempt(given).is_valid.any())

    def _refused(self, positions_m: Array, normals: Array) -> tuple[list[IkResult | None], NDArray[np.bool_]]:
        """The results of poses that need no search: too far, or the probe itself would enter the organ.

        Returns:
            A result for each of those, None for the others, and where the probe comes so close to the organ that each
            configuration has to be looked at, shape (N,).
        """
        results: list[IkResult | None] = [None] * len(positions_m)
        is_tight = np.zeros(len(positions_m), dtype=bool)
        home = np.tile(self.chain.home, (len(positions_m), 1))
        errors = np.column_stack(pose_errors(self.chain.forward(home), positions_m, normals))
        q = self.chain.full(self.chain.home)
        R_world_tip = frames_along(normals)
        slack_m = self.settings.slack_m(self.clearance.probe.reach_m)
        # What the turn about the beam leaves free is decided by each configuration.
        is_tight |= not self.clearance.probe.is_round
        lifts_m = (0.0, self.settings.standoff_m) if self.settings.standoff_m > 0 else (0.0,)
        for lift_m in lifts_m:
            at_m = positions_m - lift_m * normals
            too_far_m = self.too_far_m(at_m, normals)
            probe_m, geom = self.clearance.best_turn_distances(at_m, R_world_tip)
            is_tight |= probe_m < SURE_M + slack_m
            place = "above the pose" if lift_m else "at the pose"
            for row in np.flatnonzero((too_far_m > 0.0) | (probe_m < PROBE_MARGIN_M)).tolist():
                if results[row] is not None:
                    continue
                if too_far_m[row] > 0.0:
                    status = IkStatus.TOO_FAR
                    detail = f"The wrist would be {too_far_m[row] * 1e3:.0f} mm beyond it {place}."
                else:
                    hit = self.meter.probe_collision(float(probe_m[row]), int(geom[row]))
                    status, detail = IkStatus.COLLISION, f"However the arm stands, {hit} {place}."
                results[row] = IkResult(status, q, q, errors[row, 0], errors[row, 1], 0, 0, detail)
        return results, is_tight
