"""A map of one's own: a point is what the nearest sensed points say, and what lies far from all stays unknown.

From the command line, beside this file:

    sounding episode --planner random --map example_04_own_map:NearestPoints
"""

from os import PathLike

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

import sounding


class NearestPoints:
    """Probability by the labels of the nearest sensed points; it has the three methods of `sounding.TumourMap`."""

    def __init__(self, space: sounding.MapSpace, n_neighbours: int = 5, reach_m: float = 0.01) -> None:
        self.space, self.n_neighbours, self.reach_m = space, n_neighbours, reach_m
        self.points_m, self.labels = np.empty((0, 3)), np.empty(0, dtype=bool)

    def update(self, points_m: ArrayLike, is_occupied: ArrayLike) -> None:
        """Takes in a reading."""
        self.points_m = np.vstack([self.points_m, np.asarray(points_m)])
        self.labels = np.append(self.labels, np.asarray(is_occupied))

    def predict_lattice(self) -> sounding.Prediction:
        """The belief at the points of the lattice that lie in the organ."""
        prior = self.space.settings.prior_prevalence
        if len(self.points_m) < self.n_neighbours:
            return sounding.Prediction.from_probability(np.full(len(self.space.points_m), prior))
        away_m, near = KDTree(self.points_m).query(self.space.points_m, k=self.n_neighbours)
        weights = np.exp(-((away_m / self.reach_m) ** 2))
        p = (prior + np.sum(weights * self.labels[near], axis=1)) / (1.0 + weights.sum(axis=1))
        return sounding.Prediction.from_probability(p)

    def save(self, path: str | PathLike[str]) -> None:
        """Writes what the map knows."""
        np.savez(path, points_m=self.points_m, labels=self.labels)


def main() -> None:
    for tumour_map in (NearestPoints, "always"):  # "always": the built-in Bayesian Hilbert map
        summary = sounding.run_episode(
            scenario="spheres", planner="random", tumour_map=tumour_map, arm="none", steps=30, seed=1, report=False,
            out="renders/own-map", overwrite=True, show_progress=False,
        )  # fmt: skip
        name = getattr(tumour_map, "__name__", "HilbertMap")
        print(f"{name:<14} AUPRC {summary['auprc']:.3f}, log loss {summary['log_loss']:.4f}")


if __name__ == "__main__":
    main()
