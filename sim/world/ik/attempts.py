"""Attempts: what became of each start of a pose, and how comfortable an answer is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain
from .damped_least_squares import weighted_error_m
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
class Attempts:
    """The starts of one round and what became of them, one row each."""

    q: Array
    """Where the start ended at the pose, joints of the chain, shape (N, n)."""
    q_standoff: Array
    """Where it went on to above the pose, shape (N, n); equal to `q` where it was not lifted."""
    distance_m: Array
    """Distance of the tip from the pose [m], shape (N,)."""
    angle_rad: Array
    """Angle between beam and normal at the pose [rad], shape (N,)."""
    n_steps: NDArray[np.int64]
    """Steps taken, those to the stand-off too, shape (N,)."""
    is_there: NDArray[np.bool_]
    """Whether the pose is within tolerance, shape (N,)."""
    is_free: NDArray[np.bool_]
    """Whether it is free of contacts too, shape (N,)."""
    is_valid: NDArray[np.bool_]
    """Whether the stand-off is within tolerance and free as well, shape (N,); not known of answers less comfortable
    than one that is valid, and False."""
    miss_m: Array
    """Weighted error of the last descent [m], which was to the stand-off where there was one, shape (N,)."""
    hits: Mapping[int, str]
    """What rows touch at the pose, or above it."""
    clearance_m: Array
    """Clearance of the arm at the pose [m], NaN where that was not reached, shape (N,)."""
    comfort: Array
    """How comfortable the answer is, -inf where it is not free, shape (N,)."""


def closest(attempts: Attempts, rows: NDArray[np.int64]) -> int:
    """The row that came closest: those that reached the pose come first, then the smaller miss."""
    return int(rows[np.lexsort((attempts.miss_m[rows], ~attempts.is_there[rows]))[0]])


def comfort(chain: Chain, q: Array, clearance_m: Array) -> Array:
    """How comfortable answers are: room to limits and to obstacles, and nearness to home, shape (N,).

        min(room / COMFORT_ROOM_RAD, clearance / COMFORT_CLEARANCE_M, 1) - HOME_WEIGHT max_j |q_j - home_j| / pi

    Args:
        chain: The arm.
        q: Joint positions of the chain, shape (N, n).
        clearance_m: How far the arm is from table, organ and itself [m], shape (N,).
    """
    from_home = np.abs(q - chain.home).max(axis=1) / np.pi
    room = chain.limit_room(q).min(axis=1)
    return comfort_score(room, clearance_m) - HOME_WEIGHT * from_home


def comfort_score(limit_room: Array, clearance_m: Array) -> Array:
    """The comfort of answers without their nearness to home, shape (N,).

    It goes from 0, at a joint limit or in touch, to 1, where more room to limits and obstacles would gain nothing.

    Args:
        limit_room: Room of the joint nearest to a limit [rad or m], shape (N,).
        clearance_m: How far the arm is from table, organ and itself [m], shape (N,).
    """
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
    error_m = weighted_error_m(result.position_error_m, result.angle_error_rad)
    return result.status is not IkStatus.COLLISION, error_m
