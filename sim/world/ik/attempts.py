"""Trials: what each start of a pose came to, and which answer of a pose is the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain
from .damped_least_squares import AXIS_WEIGHT_M
from .result import IkResult, IkStatus

COMFORT_ROOM_RAD = 0.3
"""Distance from joint limits with which nothing more is gained."""
COMFORT_CLEARANCE_M = 0.03
"""Clearance with which nothing more is gained."""
HOME_WEIGHT = 0.05
"""Of answers alike in comfort the one nearer to home is taken; half a turn costs this share of the comfort."""
DISTINCT_RAD = np.deg2rad(30.0)
"""Answers are distinct if some joint differs by this much [rad or m]."""
AT_LIMIT_RAD = 1e-3
"""A joint this close to its limit stands at it."""


@dataclass(frozen=True, eq=False)
class Trials:
    """Starts of one round, one row each."""

    owner: NDArray[np.int64]
    """The pose that the start belongs to."""
    q: Array
    """Where it ended at the pose."""
    q_standoff: Array
    """Where it went on to above the pose; equal to `q` where the pose was not reached."""
    distance_m: Array
    angle_rad: Array
    n_steps: NDArray[np.int64]
    is_there: NDArray[np.bool_]
    """Whether the pose is within tolerance."""
    is_free: NDArray[np.bool_]
    """Whether it is free of contacts too."""
    is_valid: NDArray[np.bool_]
    """Whether the stand-off is within tolerance and free as well; less comfortable ones are not looked at."""
    miss_m: Array
    """Error at the pose, or above it where the pose is within tolerance, angles weighted."""
    hits: dict[int, str]
    """What rows touch at the pose, or above it."""
    clearance_m: Array
    """At the pose, NaN where that was not reached."""
    comfort: Array
    """How comfortable the answer is, -inf where it is not free."""


def closest(trials: Trials, rows: NDArray[np.int64]) -> int:
    """The row that came closest: those that reached the pose come first, then the smaller miss."""
    return int(rows[np.lexsort((trials.miss_m[rows], ~trials.is_there[rows]))[0]])


def comfort(chain: Chain, q: Array, clearance_m: Array) -> Array:
    """How comfortable answers are: room to limits and to obstacles, and nearness to home, shape (N,)."""
    from_home = np.abs(q - chain.home).max(axis=1) / np.pi
    room = chain.limit_room(q).min(axis=1)
    return comfort_score(room, clearance_m) - HOME_WEIGHT * from_home


def comfort_score(limit_room: Array, clearance_m: Array) -> Array:
    """From 0 (at a joint limit, or touching) to 1 (more room to limits and obstacles would gain nothing)."""
    return np.minimum(np.minimum(limit_room / COMFORT_ROOM_RAD, clearance_m / COMFORT_CLEARANCE_M), 1.0)


def n_distinct(q: Array, is_answer: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many answers of each pose differ from each other by `DISTINCT_RAD` in some joint, shape (P,).

    Args:
        q: Configurations, as many for each pose, shape (P, K, n).
        is_answer: Which of them are answers, shape (P, K).
    """
    is_apart = np.abs(q[:, :, None] - q[:, None]).max(axis=3) > DISTINCT_RAD
    is_kept = np.zeros_like(is_answer)
    for k in range(q.shape[1]):
        is_kept[:, k] = is_answer[:, k] & (is_apart[:, k] | ~is_kept).all(axis=1)
    return is_kept.sum(axis=1)


def joint_at_limit(chain: Chain, q: Array) -> str:
    """A phrase naming a joint that stands at its limit, or an empty one."""
    room = chain.limit_room(q)
    joint = int(np.argmin(room))
    if room[joint] > AT_LIMIT_RAD:
        return ""
    return f"{chain.names[joint]} is at its limit ({q[joint]:+.3f} {'m' if chain.is_slide[joint] else 'rad'})"


def closeness(result: IkResult) -> tuple[bool, float]:
    """Smaller is better: a collision at the pose beats a result that never got there."""
    error = result.position_error_m + AXIS_WEIGHT_M * result.angle_error_rad
    return result.status is not IkStatus.COLLISION, error
