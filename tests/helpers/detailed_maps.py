"""Small maps with finer ones in them, and readings of a box with a small tumour, for the tests of detailed maps."""

import numpy as np

from mapping import DetailedMap, HilbertMap, InsetSettings, Lattice, MapSettings

LOW_M, HIGH_M = (-0.03, -0.03, -0.04), (0.03, 0.03, 0.0)
TUMOUR_M, TUMOUR_RADIUS_M = np.array([0.004, -0.003, -0.02]), 0.007
QUERY = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.006)
IS_INSIDE = np.abs(QUERY.points_m()[:, 0]) < 0.025


def make_coarse(**changes):
    settings = MapSettings(**changes)
    hinges = Lattice.from_box(LOW_M, HIGH_M, spacing_m=settings.hinge_spacing_m)
    return HilbertMap(hinges, settings, query=QUERY, query_mask=IS_INSIDE)


def make_detailed(*, insets=None, **changes):
    return DetailedMap(make_coarse(**changes), insets if insets is not None else InsetSettings())


def readings(n_readings, *, first_is_free=True, n_points=150, seed=0):
    """Readings all over the box; where the first is free of tumour, the finer map comes with the second."""
    rng = np.random.default_rng(seed)
    for number in range(n_readings):
        points_m = rng.uniform(LOW_M, HIGH_M, (n_points, 3))
        is_tumour = np.linalg.norm(points_m - TUMOUR_M, axis=1) < TUMOUR_RADIUS_M
        yield points_m, is_tumour & (number > 0 or not first_is_free)


def in_boxes(detailed):
    """Which of the points that a map answers for lie in a box."""
    points_m = detailed.query_points_m()
    return np.any([np.zeros(len(points_m), bool), *(box.holds(points_m) for box in detailed.boxes)], axis=0)
