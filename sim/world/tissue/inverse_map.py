"""Where the points of a deformed body lay at rest: the inverse of x + u(x), point by point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import TissueError

Array = NDArray[np.float64]
Field = Callable[[Array], Array]

TOLERANCE_M = 1e-5
"""A rest place is found where it goes to within this of the point asked for [m]."""
PLAIN_ROUNDS = 12
"""Rounds of the fixed point, which serve all but the points close to the face."""
NEWTON_ROUNDS = 15
"""Rounds of Newton's method for the others."""
HALF_ROUNDS = 60
"""Rounds of the fixed point in halved steps, for the few that Newton's method leaves: those beside the face's rim, and
those that nothing came to."""
STEP_M = 1e-6
"""Step of the differences that Newton's method takes its derivatives of [m]."""
LEAST_DETERMINANT = 1e-3
"""A map flatter than this has no useful derivative."""


def rest_places(displacement_m: Field, points_m: Array, *, most_missed_m: float) -> Array:
    """The places x with x + u(x) = y for each point y [m], shape (N, 3).

    The fixed point x <- y - u(x) shrinks the error where the strain is below 1. Close to the face, where it is not,
    Newton's method goes on, and after it the fixed point in halved steps. A place always exists: u is continuous and
    bounded, so that x + u(x) takes every value.

    Args:
        displacement_m: u [m] of points [m], shapes (N, 3).
        points_m: Points y of the deformed body [m], shape (N, 3).
        most_missed_m: A place must go to within this of its point [m], also where the field folds over itself.

    Raises:
        TissueError: A place was not found.
    """
    most_missed_m = max(most_missed_m, TOLERANCE_M)
    search = _Search(displacement_m, points_m)
    search.run(PLAIN_ROUNDS, search.missed)
    search.run(NEWTON_ROUNDS, search.newton_step)
    search.run(HALF_ROUNDS, lambda rows: 0.5 * search.missed(rows))
    if search.left_m.max(initial=0.0) > most_missed_m:
        worst = int(search.left_m.argmax())
        raise TissueError(
            f"no rest place of {np.round(points_m[worst], 4).tolist()} was found within {1e3 * most_missed_m:.2g} "
            f"mm ({1e3 * search.left_m[worst]:.2g} mm is left): the indentation is too deep for linear elasticity; "
            "press less, or with a wider face"
        )
    return search.best_m


class _Search:
    """The places of all points, the best found so far, and by how much each misses its point."""

    def __init__(self, displacement_m: Field, points_m: Array) -> None:
        self._displacement_m, self._points_m = displacement_m, points_m
        self._places_m = points_m.copy()
        self._missed_m = -displacement_m(points_m)
        self.best_m, self.left_m = points_m.copy(), np.linalg.norm(self._missed_m, axis=1)

    def run(self, n_rounds: int, step_m: Callable[[NDArray[np.int64]], Array]) -> None:
        """Moves the places that are still missing by the steps, starting from the best ones found."""
        rows = np.flatnonzero(self.left_m > TOLERANCE_M)
        self._look(rows, self.best_m[rows])
        for _ in range(n_rounds):
            if not len(rows):
                return
            self._look(rows, self._places_m[rows] + step_m(rows))
            rows = rows[self.left_m[rows] > TOLERANCE_M]

    def missed(self, rows: NDArray[np.int64]) -> Array:
        """What is missing of some points [m], shape (K, 3)."""
        return self._missed_m[rows]

    def newton_step(self, rows: NDArray[np.int64]) -> Array:
        """Newton's step, no longer than twice what is missing [m], shape (K, 3)."""
        places_m, missed_m = self._places_m[rows], self._missed_m[rows]
        here_m = self._points_m[rows] - places_m - missed_m
        beside = (places_m[None] + STEP_M * np.eye(3)[:, None]).reshape(-1, 3)
        beside_m = self._displacement_m(beside).reshape(3, len(rows), 3)
        jacobian = np.eye(3) + ((beside_m - here_m) / STEP_M).transpose(1, 2, 0)
        jacobian[np.abs(np.linalg.det(jacobian)) < LEAST_DETERMINANT] = np.eye(3)
        step_m = np.linalg.solve(jacobian, missed_m[..., None])[..., 0]
        length_m, most_m = np.linalg.norm(step_m, axis=1), 2.0 * np.linalg.norm(missed_m, axis=1)
        return step_m * np.minimum(1.0, most_m / np.maximum(length_m, 1e-12))[:, None]

    def _look(self, rows: NDArray[np.int64], places_m: Array) -> None:
        """Takes new places for some points, and keeps them as the best where they are."""
        missed_m = self._points_m[rows] - places_m - self._displacement_m(places_m)
        left_m = np.linalg.norm(missed_m, axis=1)
        self._places_m[rows], self._missed_m[rows] = places_m, missed_m
        better = left_m < self.left_m[rows]
        self.best_m[rows[better]], self.left_m[rows[better]] = places_m[better], left_m[better]
