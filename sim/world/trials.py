"""Trials: what each start of a pose came to, and which answer of a pose is the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain
from .descent import AXIS_WEIGHT_M
from .ik_result import IkResult, IkStatus

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
    is_converged: NDArray[np.bool_]
    """Whether the stand-off is as well."""
    is_valid: NDArray[np.bool_]
    """Whether both are free of contacts too."""
    miss_m: Array
    """Error at the pose, or above it where the pose is within tolerance, angles weighted."""
    hits: dict[int, str]
    """What the rows touch that converged and are not valid."""
    clearance_m: Array


def closest(trials: Trials, rows: NDArray[np.int64]) -> int:
    """The row that came closest: those that reached the pose come first, then the smaller miss."""
    return int(rows[np.lexsort((trials.miss_m[rows], ~trials.is_there[rows]))[0]])


def comfort(chain: Chain, trials: Trials, rows: NDArray[np.int64]) -> Array:
    """How comfortable answers are: room to limits and to obstacles, and nearness to home, shape (len(rows),)."""
    from_home = np.abs(trials.q[rows] - chain.home).max(axis=1) / np.pi
    room = chain.limit_room(trials.q[rows]).min(axis=1)
    return comfort_score(room, trials.clearance_m[rows]) - HOME_WEIGHT * from_home


def comfort_score(limit_room: Array, clearance_m: Array) -> Array:
    """From 0 (at a joint limit, or touching) to 1 (more room to limits and obstacles would gain nothing)."""
    return np.minimum(np.minimum(limit_room / COMFORT_ROOM_RAD, clearance_m / COMFORT_CLEARANCE_M), 1.0)


def n_distinct(q: Array) -> int:
    """How many configurations differ from each other by `DISTINCT_RAD` in some joint; q has shape (N, n)."""
    kept: list[Array] = []
    for each in q:
        if all(np.abs(each - other).max() > DISTINCT_RAD for other in kept):
            kept.append(each)
    return len(kept)


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
