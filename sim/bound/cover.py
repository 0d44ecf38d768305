"""The hindsight optimum of one truth: the fewest poses whose cones hold a share of its points, with a proof.

With x_i = 1 where pose i is chosen and y_j <= 1 the part of point j that counts, it is the integer program

    min sum_i x_i   subject to   sum_{i sees j} x_i >= y_j,   sum_j y_j >= need,   x_i in {0, 1},   0 <= y_j <= 1.

What is proven is its linear relaxation's dual, which anybody can check in a line (`dual_value`): prices u_j >= 0 of the
points such that no cone holds points worth more than 1, and a worth lambda of each point needed, give

    sum_i x_i >= lambda need - sum_j max(0, lambda - u_j)

for every choice of poses, and a whole number of poses is at least that rounded up. HiGHS solves both programs; its own
dual bound of the integer program is told beside the proof, where it says more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_matrix, hstack, identity, vstack

from sim.streams import quiet_stdout

ROUNDING = 1e-6
"""A bound so little above a whole number counts as that number: far above rounding, far below any true step."""
MOST_NODES = 5000
"""Nodes of the branch and bound after which HiGHS gives up; a number, since a time would not repeat."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CoverBound:
    """The fewest poses that hold enough of the points: how many are needed for certain, and some that are enough."""

    least: int
    """Poses that any choice needs, proven by `prices` and `worth`."""
    solver_least: int
    """Poses that any choice needs by HiGHS' own word, at least `least`."""
    chosen: tuple[int, ...]
    """Poses that are enough."""
    value: float
    """The dual's value, of which `least` is the next whole number."""
    prices: NDArray[np.float64]
    """Price u_j of each point, shape (M,): no cone holds points worth more than 1."""
    worth: float
    """Worth lambda of each point that is needed."""

    @property
    def most(self) -> int:
        """The number of poses that are enough."""
        return len(self.chosen)

    def with_poses(self, names: NDArray[np.intp]) -> CoverBound:
        """The bound with other indices of the poses.

        Args:
            names: What each pose is called, shape (N,).
        """
        return replace(self, chosen=tuple(int(names[each]) for each in self.chosen))


def points_needed(n_points: int, goal: float) -> int:
    """The fewest of some points whose share reaches a goal, as an episode computes it.

    Args:
        n_points: Number of all points, at least 1.
        goal: The share, above 0 and at most 1.
    """
    counts = np.arange(n_points + 1)
    return int(counts[counts / n_points >= goal][0])


def dual_value(
    sees: NDArray[np.bool_], need: int, prices: NDArray[np.float64], worth: float
) -> tuple[float, float]:
    """The bound that prices prove, and the largest worth of a cone by which they were divided to be allowed.

    Args:
        sees: Which pose's cone holds which point, shape (N, M).
        need: Points needed.
        prices: Price of each point, at least 0, shape (M,).
        worth: Worth of each point needed.
    """
    dearest = float((sees @ prices).max(initial=0.0))
    scale = 1.0 / max(dearest, 1.0)
    return scale * (worth * need - float(np.maximum(worth - prices, 0.0).sum())), dearest


def whole_bound(value: float) -> int:
    """The whole number that a bound proves."""
    return max(0, math.ceil(value - ROUNDING))


def cover_bound(sees: NDArray[np.bool_], need: int, *, is_exact: bool = True) -> CoverBound | None:
    """The fewest poses whose cones hold enough points; None where all cones together hold too few.

    Args:
        sees: Which pose's cone holds which point, shape (N, M).
        need: Points needed, from 1 to M.
        is_exact: Whether the integer program is solved too, and not the relaxation alone.
    """
    if int(sees.any(axis=0).sum()) < need:
        return None
    poses, rows, counts, point_row = _reduced(sees)
    chosen = _greedy(rows, counts, need)
    prices, worth = _prices(rows, counts, need)
    point_prices = (prices / counts)[point_row]
    value, dearest = dual_value(sees, need, point_prices, worth)
    point_prices, worth = point_prices / max(dearest, 1.0), worth / max(dearest, 1.0)
    least = solver_least = whole_bound(value)
    if is_exact and least < len(chosen):
        better, said = _integer_program(rows, counts, need)
        solver_least = max(least, said)
        chosen = better if better and len(better) < len(chosen) else chosen
    return CoverBound(
        least=least,
        solver_least=min(solver_least, len(chosen)),
        chosen=tuple(int(poses[each]) for each in chosen),
        value=value,
        prices=point_prices,
        worth=worth,
    )


def _reduced(
    sees: NDArray[np.bool_],
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.int64], NDArray[np.intp]]:
    """The same problem without poses that see no more than another, and with alike points as one.

    Returns:
        The poses kept, shape (n,); which of them see which kind of point, shape (n, m); the points of each kind, shape
        (m,); and the kind of each point, shape (M,).
    """
    poses = np.flatnonzero(sees.any(axis=1))
    poses = poses[np.sort(np.unique(np.packbits(sees[poses], axis=1), axis=0, return_index=True)[1])]
    poses = poses[np.argsort(-sees[poses].sum(axis=1), kind="stable")]
    dense = sees[poses].astype(np.float32)
    size = dense.sum(axis=1)
    # The larger come first, so what a pose sees can lie only within what an earlier one sees.
    is_within = np.tril(dense @ dense.T >= size[:, None] - 0.5, -1).any(axis=1)
    poses = poses[~is_within]
    kinds, point_row, counts = np.unique(sees[poses], axis=1, return_inverse=True, return_counts=True)
    return poses, kinds, counts.astype(np.int64), point_row.ravel()


def _greedy(rows: NDArray[np.bool_], counts: NDArray[np.int64], need: int) -> list[int]:
    """Poses that are enough, each the one that adds most."""
    is_held, chosen = np.zeros(rows.shape[1], dtype=bool), list[int]()
    while counts[is_held].sum() < need:
        best = int((rows[:, ~is_held] @ counts[~is_held]).argmax())
        is_held |= rows[best]
        chosen.append(best)
    return chosen


def _program(
    rows: NDArray[np.bool_], counts: NDArray[np.int64], need: int
) -> tuple[NDArray[np.float64], csr_matrix, NDArray[np.float64]]:
    """Costs, matrix and least values of the program, whose variables are the poses and then the kinds of points."""
    n, m = rows.shape
    held = hstack([csr_matrix(rows.T.astype(np.float64)), -identity(m)])
    enough = csr_matrix(np.concatenate([np.zeros(n), counts])[None])
    costs = np.concatenate([np.ones(n), np.zeros(m)])
    return costs, csr_matrix(vstack([held, enough])), np.concatenate([np.zeros(m), [float(need)]])


def _prices(
    rows: NDArray[np.bool_], counts: NDArray[np.int64], need: int
) -> tuple[NDArray[np.float64], float]:
    """The dual solution of the linear relaxation: a price of each kind of point, shape (m,), and the worth."""
    costs, matrix, least = _program(rows, counts, need)
    # A pose has no upper end here: its dual would be one more number to carry, and no optimum chooses a pose twice.
    ends = [(0, None)] * rows.shape[0] + [(0, 1)] * rows.shape[1]
    solved = linprog(costs, A_ub=-matrix, b_ub=-least, bounds=ends, method="highs")
    if solved.status != 0:
        # Prices of nought prove nothing, and are true.
        return np.zeros(rows.shape[1]), 0.0
    duals = np.maximum(-np.asarray(solved.ineqlin.marginals, dtype=np.float64), 0.0)
    return duals[:-1], float(duals[-1])


def _integer_program(rows: NDArray[np.bool_], counts: NDArray[np.int64], need: int) -> tuple[list[int], int]:
    """Poses that are enough, none where HiGHS finds none in time, and how many any choice needs by its word."""
    costs, matrix, least = _program(rows, counts, need)
    n = rows.shape[0]
    with quiet_stdout():
        solved = milp(
            costs,
            # The stubs know no ends that differ from row to row.
            constraints=LinearConstraint(matrix, least, np.inf),  # pyright: ignore[reportArgumentType]
            integrality=(costs > 0.0).astype(int),
            bounds=Bounds(0, 1),
            options={"mip_rel_gap": 0.0, "node_limit": MOST_NODES},
        )
    said = getattr(solved, "mip_dual_bound", None)
    bound = 0 if said is None or not math.isfinite(said) else whole_bound(float(said))
    if solved.x is None:
        return [], bound
    chosen = np.flatnonzero(np.round(solved.x[:n]) > 0.5)
    is_enough = counts[rows[chosen].any(axis=0)].sum() >= need
    return (chosen.tolist() if is_enough else []), bound
