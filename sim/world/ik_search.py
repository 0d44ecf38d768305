"""The search: IK of many sensing poses at once, each by several starts, the most comfortable answer chosen."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain, frames_along
from .clearance import PROBE_MARGIN_M, Clearance
from .descent import AXIS_WEIGHT_M, Descent, descend, pose_errors
from .gaps import GapMeter
from .ik_result import IkResult, IkStatus
from .ik_settings import IkSettings
from .scene import Scene
from .start_set import StartSet
from .trials import Trials, closeness, closest, comfort, joint_at_limit, n_distinct

CHUNK = 256
"""Poses searched together: enough that NumPy's calls are cheap, few enough that the arrays stay in the cache."""
SURE_STARTS = 12
"""After this many starts a pose is given up whose closest answer is the stretched arm, at no limit and free."""
NEAR_TOLERANCES = 10.0
"""Within this many tolerances of the position it is the beam that fails."""
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
    """Solves sensing poses in batches for the arm of a scene. The answer to a pose depends on the pose alone."""

    def __init__(self, scene: Scene, clearance: Clearance, settings: IkSettings | None = None) -> None:
        """Read the arm's chain and draw the set of starts."""
        self.settings = settings or IkSettings()
        self.chain = Chain(scene)
        self.meter = GapMeter(scene, clearance)
        self.clearance = clearance
        self.starts = StartSet(self.chain, self.meter, seed=self.settings.start_seed)
        self._hub = self.chain.axis_hub()
        self._reach = self.chain.hub_reach()

    def with_settings(self, settings: IkSettings) -> IkSearch:
        """The same search with other tolerances or effort; the starts stay those of this one."""
        other = copy.copy(self)
        other.settings = settings
        return other

    def with_effort(self, *, max_restarts: int) -> IkSearch:
        """The same search with another number of restarts."""
        return self.with_settings(replace(self.settings, max_restarts=max_restarts))

    def at_base(self, T_world_base: Array) -> IkSearch:
        """The same search with the arm's base elsewhere, at a frame of shape (4, 4).

        The starts are those of this one, carried along; what they touch at the new place is not looked at, since every
        answer is.
        """
        other = copy.copy(self)
        other.chain = self.chain.at_base(T_world_base)
        other.meter = self.meter.at_base(T_world_base)
        other._starts = self._starts.at_base(other.chain)
        other._reach = other.chain.hub_reach()
        return other

    def with_new_starts(self) -> IkSearch:
        """The same search with starts drawn afresh, free of contacts where the base stands now."""
        other = copy.copy(self)
        other._starts = StartSet(self.chain, self.meter, seed=self.settings.start_seed)
        return other

    def search(self, positions_m: Array, normals: Array) -> Answers:
        """Answers to poses: positions [m] and inward unit normals, shape (N, 3) each."""
        return Answers.joined(
            [
                self._search_chunk(positions_m[first : first + CHUNK], normals[first : first + CHUNK])
                for first in range(0, len(positions_m), CHUNK)
            ]
        )

    def too_far_m(self, positions_m: Array, normals: Array) -> Array:
        """How far poses lie beyond the stretched arm [m], shape (N,); 0 or less decides nothing.

        The last joint lies beside the beam at a known height, so where it must be is known from the pose alone.
        """
        height_m, beside_m = self._hub
        shoulder_m, reach_m = self._reach
        hubs_m = positions_m + height_m * normals
        return np.linalg.norm(hubs_m - shoulder_m, axis=1) - reach_m - beside_m

    def _search_chunk(self, positions_m: Array, normals: Array) -> Answers:
        n, settings = len(positions_m), self.settings
        results: list[IkResult | None] = [None] * n
        clearance_m, n_solutions = np.full(n, np.nan), np.zeros(n, dtype=np.int64)
        is_tight = self._refuse_hopeless(positions_m, normals, results)
        is_open = np.array([result is None for result in results])
        n_starts = min(settings.max_restarts + 1, len(self.starts))
        first, count = 0, settings.n_compared
        while first < n_starts and is_open.any():
            rows = np.flatnonzero(is_open)
            last = min(first + count, n_starts)
            chosen = self.starts.starts(positions_m[rows], normals[rows], first, last)
            owner = np.repeat(rows, chosen.shape[1])
            trials = self._try(owner, chosen.reshape(-1, self.chain.n_joints), positions_m, normals, is_tight)
            for row in rows:
                mine = np.flatnonzero(owner == row)
                result, best = self._judge(
                    trials, mine, positions_m[row], normals[row], n_before=first, earlier=results[row]
                )
                results[row] = result
                if result.is_reached:
                    is_open[row] = False
                    clearance_m[row] = trials.clearance_m[best]
                    n_solutions[row] = n_distinct(trials.q[mine[trials.is_valid[mine]]])
                elif last > SURE_STARTS and result.status is IkStatus.TOO_FAR:
                    is_open[row] = False
            first, count = first + count, 2 * count
        return Answers([result for result in results if result is not None], clearance_m, n_solutions)

    def _refuse_hopeless(
        self, positions_m: Array, normals: Array, results: list[IkResult | None]
    ) -> NDArray[np.bool_]:
        """Answer the poses that need no search: too far, or the probe itself would enter the organ.

        Returns:
            Where the probe comes so close to the organ that each configuration has to be looked at, shape (N,).
        """
        is_tight = np.zeros(len(positions_m), dtype=bool)
        chain = self.chain
        home = np.tile(chain.home, (len(positions_m), 1))
        errors = np.column_stack(pose_errors(chain.forward(home), positions_m, normals))
        q = chain.full(chain.home)
        R_world_tip = frames_along(normals)
        lifts_m = (0.0, self.settings.standoff_m) if self.settings.standoff_m > 0 else (0.0,)
        for lift_m in lifts_m:
            at_m = positions_m - lift_m * normals
            too_far_m = self.too_far_m(at_m, normals)
            probe_m, geom = self.clearance.probe_distances(at_m, R_world_tip)
            is_tight |= probe_m < SURE_M + self.settings.slack_m
            place = "above the pose" if lift_m else "at the pose"
            for row in np.flatnonzero((too_far_m > 0.0) | (probe_m < PROBE_MARGIN_M)).tolist():
                if results[row] is not None:
                    continue
                if too_far_m[row] > 0.0:
                    detail = f"The wrist would be {too_far_m[row] * 1e3:.0f} mm beyond it {place}."
                    results[row] = IkResult(
                        IkStatus.TOO_FAR, q, q, errors[row, 0], errors[row, 1], 0, 0, detail
                    )
                else:
                    hit = self.meter.probe_collision(float(probe_m[row]), int(geom[row]))
                    detail = f"However the arm stands, {hit} {place}."
                    results[row] = IkResult(
                        IkStatus.COLLISION, q, q, errors[row, 0], errors[row, 1], 0, 0, detail
                    )
        return is_tight

    def _try(
        self,
        owner: NDArray[np.int64],
        starts: Array,
        positions_m: Array,
        normals: Array,
        is_tight: NDArray[np.bool_],
    ) -> Trials:
        """Descend to the pose and on to the stand-off from each start, and look for contacts at both."""
        at_m, along = positions_m[owner], normals[owner]
        contact = self._descend(starts, at_m, along)
        is_there = self._is_within(contact)
        lifted = Descent(contact.q.copy(), contact.distance_m, contact.angle_rad, contact.n_steps)
        is_above = is_there.copy()
        hits: dict[int, str] = {}
        n_steps = contact.n_steps.copy()
        miss_m = contact.distance_m + AXIS_WEIGHT_M * contact.angle_rad
        if self.settings.standoff_m > 0.0 and is_there.any():
            rows = np.flatnonzero(is_there)
            above_m = at_m[rows] - self.settings.standoff_m * along[rows]
            above = self._descend(contact.q[rows], above_m, along[rows])
            lifted.q[rows] = above.q
            n_steps[rows] += above.n_steps
            is_above[rows] = self._is_within(above)
            miss_m[rows] = above.distance_m + AXIS_WEIGHT_M * above.angle_rad
        clearance_m = np.full(len(owner), np.nan)
        is_valid = self._free(is_above, contact.q, "At the pose", hits, is_tight[owner], clearance_m)
        if self.settings.standoff_m > 0.0:
            is_valid = self._free(is_valid, lifted.q, "Above the pose", hits, is_tight[owner])
        return Trials(
            owner, contact.q, lifted.q, contact.distance_m, contact.angle_rad, n_steps,
            is_there, is_above, is_valid, miss_m, hits, clearance_m,
        )  # fmt: skip

    def _descend(self, starts: Array, positions_m: Array, normals: Array) -> Descent:
        settings = self.settings
        return descend(
            self.chain,
            starts,
            positions_m,
            normals,
            position_tolerance_m=settings.position_tolerance_m,
            angle_tolerance_rad=settings.angle_tolerance_rad,
            max_steps=settings.max_iterations,
            max_step_rad=settings.max_step_rad,
        )

    def _is_within(self, descent: Descent) -> NDArray[np.bool_]:
        return (descent.distance_m <= self.settings.position_tolerance_m) & (
            descent.angle_rad <= self.settings.angle_tolerance_rad
        )

    def _free(
        self,
        is_asked: NDArray[np.bool_],
        q: Array,
        place: str,
        hits: dict[int, str],
        is_tight: NDArray[np.bool_],
        clearance_m: Array | None = None,
    ) -> NDArray[np.bool_]:
        """Which of the rows asked for touch nothing forbidden; writes what the others touch, and the clearance."""
        rows = np.flatnonzero(is_asked)
        is_free = np.zeros(len(q), dtype=bool)
        if not len(rows):
            return is_free
        gaps = self.meter.measure(self.chain.full(q[rows]))
        probe_m, geom = np.full(len(rows), np.inf), np.zeros(len(rows), dtype=np.int64)
        tight = np.flatnonzero(is_tight[rows])
        state = self.chain.forward(q[rows[tight]])
        probe_m[tight], geom[tight] = self.clearance.probe_distances(state.tips_m, state.R_world_tip)
        is_free[rows] = gaps.is_free & (probe_m >= PROBE_MARGIN_M)
        for index in np.flatnonzero(~is_free[rows]).tolist():
            hit = self.meter.collision(gaps, index) or self.meter.probe_collision(
                float(probe_m[index]), int(geom[index])
            )
            hits[int(rows[index])] = f"{place} {hit}."
        if clearance_m is not None:
            clearance_m[rows] = gaps.clearance_m
        return is_free

    def _judge(
        self,
        trials: Trials,
        mine: NDArray[np.int64],
        position_m: Array,
        normal: Array,
        *,
        n_before: int,
        earlier: IkResult | None,
    ) -> tuple[IkResult, int]:
        """The result of one pose after a round, and the trial it comes from."""
        n_steps = int(trials.n_steps[mine].sum()) + (earlier.n_iterations if earlier else 0)
        n_restarts = n_before + len(mine) - 1
        valid, hits = mine[trials.is_valid[mine]], mine[trials.is_converged[mine]]
        status, detail = IkStatus.REACHED, ""
        if len(valid):
            best = int(valid[np.argmax(comfort(self.chain, trials, valid))])
        elif len(hits):
            best = int(hits[0])
            status, detail = IkStatus.COLLISION, trials.hits[best]
        else:
            best = closest(trials, mine)
            status, detail = self._shortfall(trials, best, position_m, normal)
        q, q_standoff = (self.chain.full(part[best]) for part in (trials.q, trials.q_standoff))
        distance_m, angle_rad = float(trials.distance_m[best]), float(trials.angle_rad[best])
        result = IkResult(status, q, q_standoff, distance_m, angle_rad, n_steps, n_restarts, detail)
        if earlier is not None and not result.is_reached and closeness(earlier) <= closeness(result):
            result = replace(earlier, n_iterations=n_steps, n_restarts=n_restarts)
        return result, best

    def _shortfall(self, trials: Trials, row: int, position_m: Array, normal: Array) -> tuple[IkStatus, str]:
        """Why a trial ended before the pose, or before the stand-off above it."""
        is_there = bool(trials.is_there[row])
        at_m = position_m - self.settings.standoff_m * normal if is_there else position_m
        q = trials.q_standoff[row]  # equal to that at the pose where the pose was never reached
        state = self.chain.forward(q[None])
        distance_m, angle_rad = (float(e[0]) for e in pose_errors(state, at_m[None], normal[None]))
        text = f"{'Above the pose' if is_there else 'At the pose'} the closest is {distance_m * 1e3:.1f} mm"
        text += f" and {np.rad2deg(angle_rad):.1f} degrees off"
        if limit := joint_at_limit(self.chain, q):
            return IkStatus.JOINT_LIMIT, f"{text}; {limit}."
        wanted_m = self.too_far_m(at_m[None], normal[None])[0]
        stretched_m = self.too_far_m(state.tips_m, state.beams)[0]
        if wanted_m > stretched_m + self.settings.position_tolerance_m:
            return IkStatus.TOO_FAR, f"{text}, no joint being at its limit."
        is_turned = angle_rad <= self.settings.angle_tolerance_rad
        is_near = distance_m <= NEAR_TOLERANCES * self.settings.position_tolerance_m
        return (IkStatus.AXIS if is_near and not is_turned else IkStatus.NOT_CONVERGED), f"{text}."
