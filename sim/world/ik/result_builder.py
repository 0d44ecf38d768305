"""The result of a pose: what the attempts at it mean, which is an answer or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .attempts import Attempts, closeness, closest, joint_at_limit
from .chain import Array, Chain
from .damped_least_squares import pose_errors
from .result import IkResult, IkStatus
from .settings import IkSettings

NEAR_TOLERANCES = 10.0
"""Where the tip is within this many tolerances of the position, it is the beam that fails."""


class ResultBuilder:
    """Builds the results of poses from the attempts of a round."""

    def __init__(
        self, chain: Chain, settings: IkSettings, too_far_m: Callable[[Array, Array], Array]
    ) -> None:
        """Keep what a result needs; `too_far_m` is that of the search."""
        self._chain, self._settings, self._too_far_m = chain, settings, too_far_m

    def result(
        self,
        attempts: Attempts,
        mine: slice,
        position_m: Array,
        normal: Array,
        *,
        n_before: int,
        earlier: IkResult | None,
    ) -> tuple[IkResult, int]:
        """The result of one pose after a round, and the row that it is of.

        Args:
            attempts: Those of the round.
            mine: The rows of this pose.
            position_m: Of the pose [m], shape (3,).
            normal: Its inward unit normal, shape (3,).
            n_before: Starts that this pose had in earlier rounds.
            earlier: The result of those, if there were any.
        """
        n_steps = int(attempts.n_steps[mine].sum()) + (earlier.n_iterations if earlier else 0)
        n_restarts = n_before + mine.stop - mine.start - 1
        status, detail = IkStatus.REACHED, ""
        if attempts.is_valid[mine].any():
            best = mine.start + int(
                np.argmax(np.where(attempts.is_valid[mine], attempts.comfort[mine], -np.inf))
            )
        elif hits := [row for row in range(mine.start, mine.stop) if row in attempts.hits]:
            best = hits[0]
            status, detail = IkStatus.COLLISION, attempts.hits[best]
        else:
            best = closest(attempts, np.arange(mine.start, mine.stop))
            status, detail = self._shortfall(attempts, best, position_m, normal)
        q, q_standoff = (self._chain.full(part[best]) for part in (attempts.q, attempts.q_standoff))
        distance_m, angle_rad = float(attempts.distance_m[best]), float(attempts.angle_rad[best])
        result = IkResult(status, q, q_standoff, distance_m, angle_rad, n_steps, n_restarts, detail)
        if earlier is not None and not result.is_reached and closeness(earlier) <= closeness(result):
            result = replace(earlier, n_iterations=n_steps, n_restarts=n_restarts)
        return result, best

    def _shortfall(
        self, attempts: Attempts, row: int, position_m: Array, normal: Array
    ) -> tuple[IkStatus, str]:
        """Why an attempt ended before the pose, or before the stand-off above it."""
        settings, is_there = self._settings, bool(attempts.is_there[row])
        at_m = position_m - settings.standoff_m * normal if is_there else position_m
        # Where the pose was never reached, these are the joints at the pose.
        q = attempts.q_standoff[row]
        state = self._chain.forward(q[None])
        distance_m, angle_rad = (float(e[0]) for e in pose_errors(state, at_m[None], normal[None]))
        text = f"{'Above the pose' if is_there else 'At the pose'} the closest is {distance_m * 1e3:.1f} mm"
        text += f" and {np.rad2deg(angle_rad):.1f} degrees off"
        if limit := joint_at_limit(self._chain, q):
            return IkStatus.JOINT_LIMIT, f"{text}; {limit}."
        wanted_m = self._too_far_m(at_m[None], normal[None])[0]
        stretched_m = self._too_far_m(state.tips_m, state.beams)[0]
        if wanted_m > stretched_m + settings.position_tolerance_m:
            return IkStatus.TOO_FAR, f"{text}, no joint being at its limit."
        is_turned = angle_rad <= settings.angle_tolerance_rad
        is_near = distance_m <= NEAR_TOLERANCES * settings.position_tolerance_m
        return (IkStatus.AXIS if is_near and not is_turned else IkStatus.NOT_CONVERGED), f"{text}."
