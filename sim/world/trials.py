"""Trials: what each start of a pose came to, and which answer of a pose is the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain
from .clearance import FAR_M
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
    """Starts of one round, one row each: `owner` tells the pose, `rank` how far the start got."""

    owner: NDArray[np.int64]
    q: Array
    q_standoff: Array
    distance_m: Array
    angle_rad: Array
    n_steps: NDArray[np.int64]
    is_valid: NDArray[np.bool_]
    is_converged: NDArray[np.bool_]
    details: dict[int, str]
    clearance_m: Array


def comfort(chain: Chain, trials: Trials, rows: NDArray[np.int64]) -> Array:
    """How comfortable answers are: room to limits and to obstacles, and nearness to home, shape (len(rows),)."""
    room = chain.limit_room(trials.q[rows]).min(axis=1) / COMFORT_ROOM_RAD
    clear = np.minimum(trials.clearance_m[rows], FAR_M) / COMFORT_CLEARANCE_M
    from_home = np.abs(trials.q[rows] - chain.home).max(axis=1) / np.pi
    return np.minimum(np.minimum(room, clear), 1.0) - HOME_WEIGHT * from_home


def n_distinct(q: Array) -> int:
    """How many configurations differ from each other by `DISTINCT_RAD` in some joint; q has shape (N, n)."""
    kept: list[Array] = []
    for each in q:
        if all(np.abs(each - other).max() > DISTINCT_RAD for other in kept):
            kept.append(each)
    return len(kept)


def shortfall(chain: Chain, q: Array, distance_m: float, angle_rad: float) -> str:
    """What stopped a descent: how far it ended from the pose, and the joint that stands at its limit, if one does."""
    text = f"the closest is {distance_m * 1e3:.1f} mm and {np.rad2deg(angle_rad):.1f} degrees off"
    room = chain.limit_room(q)
    joint = int(np.argmin(room))
    if room[joint] > AT_LIMIT_RAD:
        return f"{text}, with no joint at its limit."
    unit = "m" if chain.is_slide[joint] else "rad"
    return f"{text}, {chain.names[joint]} is at its limit ({q[joint]:+.3f} {unit})."


def closeness(result: IkResult) -> tuple[bool, float]:
    """Smaller is better: a collision at the pose beats a result that never got there."""
    error = result.position_error_m + AXIS_WEIGHT_M * result.angle_error_rad
    return result.status is not IkStatus.COLLISION, error
