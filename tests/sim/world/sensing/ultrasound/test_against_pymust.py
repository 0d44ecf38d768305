"""The beam and the speckle against PyMUST, which sums the waves of every element: `pytest -m slow`."""

import numpy as np
import pytest

from benchmarks.pymust_array import MustArray
from sim.world.sensing.ultrasound import beam
from sim.world.sensing.ultrasound.convex_array import ConvexArray

pymust = pytest.importorskip("pymust", reason="needs pip install 'sounding[pymust]'")
pytestmark = pytest.mark.slow
ARRAY = ConvexArray()
POINTS_M = np.array([20, 30, 45, 65, 80, 95, 115]) * 1e-3


def half_width(profile, spacing):
    """Full width at half height of a peak about the middle of a profile, from its right side."""
    middle = len(profile) // 2
    falling = profile[middle:] / profile[middle]
    at = int(np.argmax(falling < 0.5))
    return 2.0 * spacing * (at - (0.5 - falling[at]) / (falling[at - 1] - falling[at]))


@pytest.fixture(scope="module")
def point_images():
    """Envelopes of lines about points on the axis, shape (lines, depths), with their angles and depths."""
    must, places_m = MustArray(ARRAY), np.column_stack([0.0 * POINTS_M, POINTS_M])
    depths_m = np.arange(0.010, 0.125, 0.02e-3)
    angles_rad = np.arange(-24, 25) * 0.5 * ARRAY.line_rad
    return np.array([must.line(places_m, angle, depths_m) for angle in angles_rad]), angles_rad, depths_m


@pytest.mark.parametrize("index", range(len(POINTS_M)))
def test_a_point_is_as_wide_and_as_long_as_in_pymust(point_images, index):
    images, angles_rad, depths_m = point_images
    is_near = np.abs(depths_m - POINTS_M[index]) < 1.5e-3
    across = images[:, is_near].max(axis=1)
    pitch_m = (ARRAY.radius_m + POINTS_M[index]) * (angles_rad[1] - angles_rad[0])
    # The model's Gaussians leave out side lobes, the elements' own directivity and the ripple of a defocused slit.
    expected_m = half_width(across, pitch_m)
    found_m = beam.lateral_fwhm_m(ARRAY, POINTS_M[index : index + 1])[0]
    assert found_m == pytest.approx(expected_m, rel=0.18)
    along = images[len(images) // 2][is_near]
    assert depths_m[is_near][along.argmax()] == pytest.approx(POINTS_M[index], abs=0.1e-3)
    length_m = (along > 0.5 * along.max()).sum() * (depths_m[1] - depths_m[0])
    # PyMUST's spectrum has a flat top and steep sides where ours is a Gaussian, so its pulse is the longer one.
    assert beam.pulse_fwhm_m(ARRAY) == pytest.approx(length_m, rel=0.3)


def test_scatterers_as_dense_as_ours_are_fully_developed_speckle_in_pymust_too():
    """Scatterers in a patch about the focus, some 10 a cell of resolution as ours are; its edges are not looked at."""
    rng, must = np.random.default_rng(0), MustArray(ARRAY)
    places_m = np.column_stack([rng.uniform(-0.006, 0.006, 1200), rng.uniform(0.058, 0.072, 1200)])
    depths_m = np.arange(0.060, 0.070, 0.1e-3)
    lines = [must.line(places_m, angle, depths_m) for angle in np.linspace(-0.03, 0.03, 7)]
    envelope = np.array(lines)
    # 7 lines of some 30 cells of resolution each: the ratio deviates by a tenth.
    assert envelope.mean() / envelope.std() == pytest.approx(1.91, abs=0.25)
