"""Places where a tumour may be, drawn as the scenario draws them, and how many poses are left from each that meets it.

For a place and a pose i that meets its tumour, `fewest` says how many poses are needed at least, i the first of them,
until enough of the tumour is sensed:

    1   where the cone of i holds enough by itself,
    2   where it does together with some other cone,
    3   where it does with no other one; and more where the prices of the hindsight optimum say so: poses that are
        enough hold points worth B at least (`dual_value`), those of i are worth p_i, and any other's at most 1, so
        that 1 + (B - p_i) poses are needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cover import cover_bound, dual_value, whole_bound
from .meeting import meets
from .stage import Stage

MOST_FEWEST = 5
"""The largest number told apart; what needs more counts with it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Place:
    """A planted tumour, as those who look for it meet it."""

    seed: int
    middle_m: NDArray[np.float64]
    """Middle of its surface's vertices [m, world], shape (3,)."""
    radius_m: float
    """Distance of the farthest vertex from the middle [m]."""
    poses: NDArray[np.int32]
    """Those that may meet it, as rows of the poses that are reached, rising, shape (h,)."""
    fewest: NDArray[np.uint8]
    """The fewest poses from each of them on, shape (h,)."""
    prices: NDArray[np.float32]
    """Prices of its points that prove more than 3, shape (D,); empty where they are not needed."""
    worth: float
    """Worth of each point needed that goes with them."""


class PlaceWork:
    """Draws one place after another."""

    def __init__(self, stage: Stage, need: int) -> None:
        """Remember what the places share.

        Args:
            stage: Plants one tumour a seed.
            need: Points of the tumour, of 500, that have to be sensed at least.
        """
        self.stage, self._need = stage, need

    def __call__(self, seed: int) -> Place:
        """The place of a seed.

        Raises:
            WorldError: No place for the tumour was found.
        """
        truth, poses = self.stage.truth(seed), self.stage.poses(seed)
        (tumour,), cone = truth.anatomy.tumours, self.stage.setup(seed).cone
        points_m = truth.anatomy.detection_points_m
        met = np.flatnonzero(meets(cone, poses.apex_m, poses.axis, tumour))
        fewest, prices, worth = fewest_from(poses.part(met).sees(cone, points_m), self._need)
        middle_m = tumour.vertices_m.mean(axis=0)
        return Place(
            seed=seed,
            middle_m=middle_m,
            radius_m=float(np.linalg.norm(tumour.vertices_m - middle_m, axis=1).max()),
            poses=met.astype(np.int32),
            fewest=fewest,
            prices=prices,
            worth=worth,
        )


def fewest_from(sees: NDArray[np.bool_], need: int) -> tuple[NDArray[np.uint8], NDArray[np.float32], float]:
    """The fewest poses from each one on, shape (h,), and the prices and the worth that prove more than 3.

    Args:
        sees: Which pose's cone holds which point, shape (h, D).
        need: Points needed.
    """
    # Whole numbers below 2^24 are exact in single precision.
    held = sees.astype(np.float32)
    size = held.sum(axis=1)
    best_pair = (size[:, None] + size[None, :] - held @ held.T).max(axis=1, initial=0.0)
    fewest = np.where(size >= need, 1, np.where(best_pair >= need, 2, 3)).astype(np.uint8)
    nothing = np.empty(0, dtype=np.float32)
    if not len(fewest) or fewest.min() < 3:
        return fewest, nothing, 0.0
    bound = cover_bound(sees, need, is_exact=False)
    if bound is None:
        return np.full_like(fewest, MOST_FEWEST), nothing, 0.0
    prices = bound.prices.astype(np.float32)
    return np.maximum(fewest, priced_fewest(sees, need, prices, bound.worth)), prices, bound.worth


def priced_fewest(
    sees: NDArray[np.bool_], need: int, prices: NDArray[np.float32], worth: float
) -> NDArray[np.uint8]:
    """The fewest poses from each one on that prices prove, at most `MOST_FEWEST`, shape (h,)."""
    price = prices.astype(np.float64)
    value, dearest = dual_value(sees, need, price, worth)
    own = sees @ price / max(dearest, 1.0)
    bounds = [1 + whole_bound(value - float(each)) for each in own]
    return np.minimum(bounds, MOST_FEWEST).astype(np.uint8)
