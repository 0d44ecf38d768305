"""What the inverse kinematics minimises: damped least squares within joint limits, for many sensing poses at once.

A sensing pose fixes five things, the position of the tip and the direction of the beam; the roll about the beam is
free. One step of the joints is the dq that minimises

    |J dq - e|^2 + damping |dq - z|^2,   which is   dq = z + J^T (J J^T + damping I)^-1 (e - J z)

over the joints that are not held at a limit, where

    e        what is missing, five numbers [m]: the way from the tip to the position, and w times the turn about the
             tip's own x and y that brings the beam to the normal [rad]. w = AXIS_WEIGHT_M.
    J        how the tip and, times w, the beam move with each joint, 5 x n.
    damping  DAMPING + ERROR_DAMPING |e|^2 [m^2]: far from the pose steps are short and safe.
    z        CENTRING_GAIN (middle - q): as far as the pose leaves them free, joints go to the middle of their ranges;
             0 for a joint without limits.

The step is shortened until no joint moves more than `max_step_rad`. Joints that it would take out of their ranges are
held at their limits, and it is solved again for the others. A start ends when the pose is within tolerance, when its
error, distance + w angle, was not halved within STALL_STEPS steps, or after `max_steps`.

A pose is tried from several starts: `n_compared` of them, and more only where all of these fail. Of the answers that
touch nothing, neither at the pose nor at the stand-off above it, the most comfortable is taken. With the constants of
`attempts.py`, the comfort of joint positions q is

    min(room / COMFORT_ROOM_RAD, clearance / COMFORT_CLEARANCE_M, 1) - HOME_WEIGHT max_j |q_j - home_j| / pi

where room is how far the joint nearest to a limit is from it, and clearance how far the arm is from table, organ and
itself at the pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain, ChainState, cross

AXIS_WEIGHT_M = 0.3
"""A turn of the beam by one radian counts like this distance."""
DAMPING = 1e-6
"""Least damping [m^2]: at the pose, a step through a singular configuration stays finite."""
ERROR_DAMPING = 1e-2
"""Share of the squared error that is added to it."""
CENTRING_GAIN = 0.05
"""Share of the way to the middle of its range that a joint goes in one step, as far as the pose leaves it free."""
STALL_STEPS = 6
"""A start is given up when this many steps did not halve its error."""
LIMIT_PASSES = 3
"""Times that a step is solved again with the joints held that would leave their range."""

Error = TypeVar("Error", float, Array)


@dataclass(frozen=True, eq=False)
class Descent:
    """Where N starts ended."""

    q: Array
    """Joint positions of the chain, always within the limits, shape (N, n)."""
    distance_m: Array
    """Distance of the tip from the pose [m], shape (N,)."""
    angle_rad: Array
    """Angle between beam and normal [rad], shape (N,)."""
    n_steps: NDArray[np.int64]
    """Steps taken, shape (N,)."""

    @property
    def error_m(self) -> Array:
        """Distance and angle as one length [m], shape (N,)."""
        return weighted_error_m(self.distance_m, self.angle_rad)


def pose_errors(state: ChainState, positions_m: Array, normals: Array) -> tuple[Array, Array]:
    """Distances [m] of tips from positions and angles [rad] of beams from normals, shape (N,) each."""
    away_m, turn = positions_m - state.tips_m, cross(state.beams, normals)
    distance_m = np.sqrt(np.einsum("ij,ij->i", away_m, away_m))
    sine = np.sqrt(np.einsum("ij,ij->i", turn, turn))
    cosine = np.einsum("ij,ij->i", state.beams, normals)
    return distance_m, np.arctan2(sine, cosine)


def weighted_error_m(distance_m: Error, angle_rad: Error) -> Error:
    """A distance and an angle as one length [m]."""
    return distance_m + AXIS_WEIGHT_M * angle_rad


def descend(
    chain: Chain,
    q_start: Array,
    positions_m: Array,
    normals: Array,
    *,
    position_tolerance_m: float,
    angle_tolerance_rad: float,
    max_steps: int = 40,
    max_step_rad: float = 0.5,
    centring_gain: float = CENTRING_GAIN,
) -> Descent:
    """Where starts end that step towards poses; see the module for what a step minimises.

    Args:
        chain: The arm.
        q_start: Start configurations within the limits, shape (N, n).
        positions_m: Where the tips shall be, world frame [m], shape (N, 3).
        normals: Where the beams shall point, unit vectors, shape (N, 3).
        position_tolerance_m: Accepted distance [m].
        angle_tolerance_rad: Accepted angle [rad].
        max_steps: Steps of one start at most.
        max_step_rad: No joint moves more than this in one step [rad or m].
        centring_gain: Pull towards the middle of the ranges; 0 moves as little as possible.
    """
    q = np.clip(q_start, chain.low, chain.high)
    n = len(q)
    distance_m, angle_rad, n_steps = np.full(n, np.inf), np.full(n, np.inf), np.zeros(n, dtype=np.int64)
    rows, best_m, n_since = np.arange(n), np.full(n, np.inf), np.zeros(n, dtype=np.int64)
    for step in range(max_steps + 1):
        state = chain.forward(q[rows])
        away_m, off_rad = pose_errors(state, positions_m[rows], normals[rows])
        distance_m[rows], angle_rad[rows], n_steps[rows] = away_m, off_rad, step
        error_m = weighted_error_m(away_m, off_rad)
        is_better = error_m < 0.5 * best_m
        best_m, n_since = np.where(is_better, error_m, best_m), np.where(is_better, 0, n_since + 1)
        is_done = (away_m <= position_tolerance_m) & (off_rad <= angle_tolerance_rad)
        is_open = ~is_done & (n_since < STALL_STEPS)
        if step == max_steps or not is_open.any():
            break
        rows, best_m, n_since = rows[is_open], best_m[is_open], n_since[is_open]
        here = q[rows]
        state = ChainState(*(part[is_open] for part in vars(state).values()))
        here += _step(chain, state, here, positions_m[rows], normals[rows], max_step_rad, centring_gain)
        q[rows] = np.clip(here, chain.low, chain.high)
    return Descent(q, distance_m, angle_rad, n_steps)


def _step(
    chain: Chain,
    state: ChainState,
    q: Array,
    positions_m: Array,
    normals: Array,
    max_step_rad: float,
    centring_gain: float,
) -> Array:
    """One damped step of each configuration, none of which leaves the limits, shape (N, n)."""
    J = chain.jacobian(state)
    J[:, 3:] *= AXIS_WEIGHT_M
    e = _task_error(state, positions_m, normals)
    e[:, 3:] *= AXIS_WEIGHT_M
    damping = DAMPING + ERROR_DAMPING * np.einsum("ij,ij->i", e, e)
    z = _centring(chain, q, centring_gain)
    dq = _capped(_solve(J, e, z, damping), max_step_rad)
    return _within(chain, q, dq, (J, e, z, damping), max_step_rad)


def _within(
    chain: Chain, q: Array, dq: Array, terms: tuple[Array, Array, Array, Array], max_step_rad: float
) -> Array:
    """Steps that keep within the limits: joints that would leave are held there and the others solved again."""
    J, e, z, damping = terms
    low, high = chain.low - q, chain.high - q
    held = np.zeros(q.shape, dtype=bool)
    for _ in range(LIMIT_PASSES):
        newly = ((dq < low) | (dq > high)) & ~held
        rows = np.flatnonzero(newly.any(axis=1))
        if not len(rows):
            break
        held[rows] |= newly[rows]
        fixed = np.where(held[rows], np.clip(dq[rows], low[rows], high[rows]), 0.0)
        free_J = J[rows] * ~held[rows][:, None, :]
        left = e[rows] - np.einsum("nij,nj->ni", J[rows], fixed)
        moved = _solve(free_J, left, np.where(held[rows], 0.0, z[rows]), damping[rows])
        dq[rows] = np.where(held[rows], fixed, _capped(moved, max_step_rad))
    return np.clip(dq, low, high)


def _solve(J: Array, e: Array, z: Array, damping: Array) -> Array:
    """dq = z + J^T (J J^T + damping)^-1 (e - J z), shape (N, n)."""
    JT = J.transpose(0, 2, 1)
    A = J @ JT
    A[:, np.arange(5), np.arange(5)] += damping[:, None]
    residual = e[:, :, None] - J @ z[:, :, None]
    return z + (JT @ np.linalg.solve(A, residual))[:, :, 0]


def _capped(dq: Array, max_step_rad: float) -> Array:
    largest = np.abs(dq).max(axis=1, keepdims=True)
    return dq * np.minimum(1.0, max_step_rad / np.maximum(largest, 1e-12))


def _centring(chain: Chain, q: Array, gain: float) -> Array:
    """The wish of each joint to move towards the middle of its range, shape (N, n)."""
    has_range = np.isfinite(chain.low) & np.isfinite(chain.high)
    # Without limits the sum would be that of both infinities.
    middle = (np.where(has_range, chain.low, 0.0) + np.where(has_range, chain.high, 0.0)) / 2.0
    return np.where(has_range, gain * (middle - q), 0.0)


def _task_error(state: ChainState, positions_m: Array, normals: Array) -> Array:
    """What is missing: a shift in the world [m] and a turn about the tip's x and y [rad], shape (N, 5)."""
    in_tip = np.einsum("nij,ni->nj", state.R_world_tip, normals)
    sine = np.hypot(in_tip[:, 0], in_tip[:, 1])
    angle_rad = np.arctan2(sine, in_tip[:, 2])
    # Turning z to the normal is a turn about z x normal = (-n_y, n_x, 0); opposite beams turn about x.
    is_plain = sine > 1e-9
    scale = np.where(is_plain, angle_rad / np.where(is_plain, sine, 1.0), 0.0)
    turn = np.column_stack([-in_tip[:, 1] * scale, in_tip[:, 0] * scale])
    turn[~is_plain & (in_tip[:, 2] < 0.0), 0] = np.pi
    return np.concatenate([positions_m - state.tips_m, turn], axis=1)
