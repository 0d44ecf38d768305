"""Small detailed maps, and readings of a box with a small tumour, for the tests of detailed maps."""

import numpy as np

from mapping import DetailedMap, DetailSettings, HilbertMap, Lattice, MapSettings

LOW_M, HIGH_M = (-0.03, -0.03, -0.04), (0.03, 0.03, 0.0)
TUMOUR_M, TUMOUR_RADIUS_M = np.array([0.004, -0.003, -0.02]), 0.007
QUERY = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.006)
IS_INSIDE = np.abs(QUERY.points_m()[:, 0]) < 0.025


def make_coarse(**changes):
    settings = MapSettings(**changes)
    hinges = Lattice.from_box(LOW_M, HIGH_M, spacing_m=settings.hinge_spacing_m)
    return HilbertMap(hinges, settings, query=QUERY, query_mask=IS_INSIDE)


def make_detailed(*, detail=None, **changes):
    return DetailedMap(make_coarse(**changes), detail if detail is not None else DetailSettings())


def readings(n_readings, *, first_is_free=True, n_points=150, seed=0):
    """Readings all over the box; where the first is free of tumour, there is detail from the second on."""
    rng = np.random.default_rng(seed)
    for number in range(n_readings):
        points_m = rng.uniform(LOW_M, HIGH_M, (n_points, 3))
        is_tumour = np.linalg.norm(points_m - TUMOUR_M, axis=1) < TUMOUR_RADIUS_M
        yield points_m, is_tumour & (number > 0 or not first_is_free)
