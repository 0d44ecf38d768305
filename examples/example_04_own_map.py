"""A map of one's own: a point is what the nearest sensed points say, and what lies far from all stays unknown.

From the command line, in the folder of this file:

    .venv/bin/sounding episode --planner random --map example_04_own_map:NearestPoints --map-option reach_m=0.02
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
    setup = sounding.build_setup(sounding.load_scenario("spheres"))
    planner = sounding.make_planner("random")  # looks at no map, so that both maps hear of the same places
    print(f"{'map':<14} {'AUPRC':>7} {'log loss':>9}")
    for make_map in (NearestPoints, sounding.make_hilbert_map):
        episode = sounding.Episode(setup, planner, tumour_map=make_map, seed=1)
        for _ in episode.steps(20):
            pass  # each step tells of one action: pose, reading, scores
        scores = episode.metrics()
        assert scores is not None, "a map was kept"
        print(f"{type(episode.tumour_map).__name__:<14} {scores.auprc:>7.3f} {scores.log_loss:>9.4f}")


if __name__ == "__main__":
    main()
