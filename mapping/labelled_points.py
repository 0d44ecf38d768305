"""The labelled points of a reading, and which of its tumour labels can be believed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from scipy.special import bdtrc

N_NEIGHBOURS = 8
"""Number of points, the labelled one included, whose labels decide about a tumour label."""
CHANCE = 1e-3
"""A label is believed where false labels would agree with it, among its neighbours, less often than this."""

_BELIEVED = 5.0
"""Log odds of a label of tumour that outweigh a prior of 2 per cent, as four neighbours that agree have them and three
that slips explain now and then have not."""


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """What one sensing action returned."""

    points_m: NDArray[np.float64]
    """Sensed points [m, world], shape (K, 3)."""
    is_occupied: NDArray[np.bool_]
    """Whether the sensor called each point tumour, shape (K,)."""

    log_odds: NDArray[np.float64] | None = None
    """How far each label can be believed: log P(label | tumour) / P(label | free), shape (K,), infinite where it cannot
    be wrong. None where nobody says; the labels are then as good as the settings' rates."""
    weight: NDArray[np.float64] | None = None
    """How many labels, that err by themselves, each counts for, shape (K,), above 0 and at most 1: less than 1 where
    neighbours err together. None where each counts in full."""

    def at(self, points_m: NDArray[np.float64]) -> LabelledPoints:
        """The same labels at other places, for a body that has moved as a whole.

        Args:
            points_m: Where the points lie [m], shape (K, 3).
        """
        return replace(self, points_m=points_m)

    def believed_tumour_m(self, false_positive_rate: float) -> NDArray[np.float64]:
        """The points called tumour [m] that chance does not explain, shape (B, 3).

        Args:
            false_positive_rate: Share of free points that the sensor is believed to call tumour.
        """
        return self.points_m[self.is_believed_tumour(false_positive_rate)]

    def is_believed_tumour(self, false_positive_rate: float) -> NDArray[np.bool_]:
        """Which points are called tumour in a way that chance does not explain, shape (K,).

        Of the 8 points nearest to one, itself included, m are called tumour; with no tumour there, false labels do
        that with probability P(Binomial(8, rate) >= m). Without false labels every tumour label is believed. Where
        labels say themselves how far they can be believed, the rate is theirs; and where they err together, so that
        neighbours prove nothing, a label is believed that makes a place with a prior of 2 % likelier tumour than not.

        Args:
            false_positive_rate: Share of free points that the sensor is believed to call tumour.
        """
        if self.log_odds is not None and self.is_occupied.any():
            if self.weight is not None:
                return self.is_occupied & (self.log_odds > _BELIEVED)
            false_positive_rate = float(np.exp(-np.median(self.log_odds[self.is_occupied])))
        if false_positive_rate <= 0.0 or not self.is_occupied.any():
            return self.is_occupied
        return self.is_occupied & (self.slip_chance(false_positive_rate) < CHANCE)

    def slip_chance(self, rate: ArrayLike) -> NDArray[np.float64]:
        """The chance that labels which are wrong by themselves agree at each point as those around it do, shape (K,).

        That is P(Binomial(8, rate) >= m), where m of the 8 points nearest to one, itself included, have its label.

        Args:
            rate: Share of labels of the point's kind that are wrong by themselves, one for all or of shape (K,).
        """
        return bdtrc(self.n_agreeing - 1, min(N_NEIGHBOURS, len(self.points_m)), rate)

    @cached_property
    def n_agreeing(self) -> NDArray[np.int64]:
        """How many of the 8 points nearest to each, itself included, have its label, shape (K,)."""
        if not len(self.points_m):
            return np.zeros(0, dtype=np.int64)
        n = min(N_NEIGHBOURS, len(self.points_m))
        # A list of neighbours keeps the shape (K, n) where n is 1.
        _, nearest = self.tree.query(self.points_m, k=[*range(1, n + 1)])
        return (self.is_occupied[nearest] == self.is_occupied[:, None]).sum(axis=1)

    @cached_property
    def tree(self) -> Any:
        """The tree that finds the points nearest to places."""
        # The stubs take the neighbours of many places for one.
        return KDTree(self.points_m)

    @cached_property
    def bounds_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and largest coordinates of the points [m], shapes (3,); there has to be one."""
        return self.points_m.min(axis=0), self.points_m.max(axis=0)


def check_labels(is_occupied: ArrayLike, n_points: int) -> NDArray[np.float64]:
    """Labels as numbers, shape (n_points,), 1 for tumour.

    Raises:
        ValueError: If there are more or fewer labels than points, or one is neither 0 nor 1.
    """
    labels = np.asarray(is_occupied, dtype=np.float64)
    if labels.shape != (n_points,):
        raise ValueError(
            f"is_occupied must hold one label for each of {n_points} points, not shape {labels.shape}"
        )
    if not np.all((labels == 0) | (labels == 1)):
        raise ValueError("is_occupied must hold only False and True (or 0 and 1)")
    return labels
