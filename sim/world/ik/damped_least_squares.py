"""Damped least squares within joint limits, for many sensing poses at once, the roll about the beam left free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Array, Chain, ChainState, cross

AXIS_WEIGHT_M = 0.3
"""A turn of the beam by one radian counts like this distance."""
DAMPING = 1e-6
"""Least damping of the normal equations [m^2]; the squared error is added, so that far steps are short and safe."""
CENTRING_GAIN = 0.05
"""Share of the way to the middle of its range that a joint goes in one step, as far as the pose leaves it free."""
STALL_STEPS = 6
"""A start is given up when this many steps did not halve its error."""
LIMIT_PASSES = 3
"""Times that a step is solved again with the joints held that would leave their range."""


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


def pose_errors(state: ChainState, positions_m: Array, normals: Array) -> tuple[Array, Array]:
    """Distances [m] of tips from positions and angles [rad] of beams from normals, shape (N,) each."""
    away_m, turn = positions_m - state.tips_m, cross(state.beams, normals)
    distance_m, sine = (
        np.sqrt(np.einsum("ij,ij->i", away_m, away_m)),
        np.sqrt(np.einsum("ij,ij->i", turn, turn)),
    )
    cosine = np.einsum("ij,ij->i", state.beams, normals)
    return distance_m, np.arctan2(sine, cosine)


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
    """Steps from starts towards poses until each is within tolerance, stalls, or has taken all its steps.

    A step minimises |J dq - e|^2 + damping |dq - z|^2 over the joints that are not held at a limit, where e is the
    error of position and beam and z draws the joints towards the middle of their ranges.

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
    end = Descent(q, np.full(n, np.inf), np.full(n, np.inf), np.zeros(n, dtype=np.int64))
    best, since = np.full(n, np.inf), np.zeros(n, dtype=np.int64)
    rows = np.arange(n)
    for step in range(max_steps + 1):
        state = chain.forward(q[rows])
        distance_m, angle_rad = pose_errors(state, positions_m[rows], normals[rows])
        end.distance_m[rows], end.angle_rad[rows], end.n_steps[rows] = distance_m, angle_rad, step
        error = distance_m + AXIS_WEIGHT_M * angle_rad
        is_better = error < 0.5 * best
        best, since = np.where(is_better, error, best), np.where(is_better, 0, since + 1)
        is_done = (distance_m <= position_tolerance_m) & (angle_rad <= angle_tolerance_rad)
        is_open = ~is_done & (since < STALL_STEPS)
        if step == max_steps or not is_open.any():
            break
        rows, best, since = rows[is_open], best[is_open], since[is_open]
        here = q[rows]
        state = ChainState(*(part[is_open] for part in vars(state).values()))
        here += _step(chain, state, here, positions_m[rows], normals[rows], max_step_rad, centring_gain)
        q[rows] = np.clip(here, chain.low, chain.high)
    return end


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
    damping = DAMPING + 1e-2 * np.einsum("ij,ij->i", e, e)
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
    middle = np.where(has_range, (chain.low + chain.high) / 2.0, 0.0)
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
