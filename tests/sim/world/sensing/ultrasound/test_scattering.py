"""The scatterers: the compiled loop against a plain sum over all of them, however the plane lies in the tissue."""

import numpy as np
import pytest
from phantoms import tissue, uniform_phantom
from scipy.spatial.transform import Rotation

from sim.world.sensing.ultrasound import beam
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.imager import Imager
from sim.world.sensing.ultrasound.scattering import N_PER_CUBE, scatterers_in
from sim.world.sensing.ultrasound.settings import Settings

ARRAY = ConvexArray(
    depth_m=0.03,
    n_lines=64,
    n_samples=240,
    face_width_m=0.01,
    focus_m=0.02,
    height_focus_m=0.02,
    height_m=0.004,
)
SETTINGS = Settings(noise_db=-300.0, tissue_seed=5)
TABLES = Imager(ARRAY, SETTINGS)._tables
CUBE_M = TABLES.cube_m


def plain_sum(T_grid_plane):
    """The complex echoes of lines through uniform tissue: each scatterer's Gaussian echo, added up one by one."""
    corners_m = ARRAY.points_m([0, 0, 63, 63, 32], [0, 239, 0, 239, 239])
    thick_m = np.array([0.0, 0.004, 0.0])
    corners_m = np.concatenate([corners_m - thick_m, corners_m + thick_m]) @ T_grid_plane[:3, :3].T
    cubes = (corners_m + T_grid_plane[:3, 3]) / CUBE_M
    first, last = np.floor(cubes.min(axis=0)).astype(int) - 1, np.ceil(cubes.max(axis=0)).astype(int) + 1
    places, chances = scatterers_in(first, last, seed=5)
    numbers = np.tile(np.arange(N_PER_CUBE), len(places))
    places, chances = places.reshape(-1, 3), chances.ravel()
    x_m, y_m, z_m = ((places * CUBE_M - T_grid_plane[:3, 3]) @ T_grid_plane[:3, :3]).T
    range_m = np.hypot(x_m, z_m + ARRAY.radius_m) - ARRAY.radius_m
    angle_rad = np.arctan2(x_m, z_m + ARRAY.radius_m)
    depths_m = ARRAY.depths_m
    lateral = np.interp(range_m, depths_m, beam.lateral_fwhm_m(ARRAY, depths_m)) / 2.3548
    thickness = np.interp(range_m, depths_m, beam.slice_fwhm_m(ARRAY, depths_m)) / 2.3548
    keeps = np.interp(range_m, depths_m, TABLES.keeps)
    norms = np.interp(range_m, depths_m, TABLES.norms)
    is_used = (numbers < np.floor(keeps)) | (
        (numbers == np.floor(keeps)) & (chances < 1024.0 * (keeps - np.floor(keeps)))
    )
    is_near = (np.abs(y_m) < 2.0 * thickness) & (range_m > 0.0) & (range_m < 0.03) & is_used
    pulse_sigma_m = beam.pulse_fwhm_m(ARRAY) / 2.3548
    total = np.zeros((240, 64), complex)
    for i in np.flatnonzero(is_near):
        along = np.exp(-0.5 * ((depths_m - range_m[i]) / pulse_sigma_m) ** 2)
        across_m = (ARRAY.radius_m + range_m[i]) * (ARRAY.angles_rad - angle_rad[i])
        across = np.exp(-0.5 * (across_m / lateral[i]) ** 2)
        slice_ = np.exp(-0.5 * (y_m[i] / thickness[i]) ** 2)
        turn = np.exp(2j * np.pi * 2.0 * range_m[i] / ARRAY.wavelength_m)
        total += norms[i] * slice_ * turn * along[:, None] * across[None]
    return total


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (70, 20, 0), (10, 30, 80), (0, 44, 60)])
def test_the_image_is_the_sum_of_the_echoes_of_all_scatterers_however_the_plane_lies(turn_deg):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    T[:3, 3] = [0.3, -0.2, 0.1]
    received = Imager(ARRAY, SETTINGS).plane(uniform_phantom(tissue()), T).received
    fast, plain = (received[..., 0] + 1j * received[..., 1])[20:220, 12:52], plain_sum(T)[20:220, 12:52]
    likeness = np.abs(np.vdot(fast, plain)) / np.linalg.norm(fast) / np.linalg.norm(plain)
    # What is lost: echoes begin on whole samples and between lines, and the slice's width has 256 steps.
    assert likeness > 0.97
    assert np.linalg.norm(fast) == pytest.approx(np.linalg.norm(plain), rel=0.08)


def test_cubes_hold_scatterers_evenly_and_without_pattern():
    places, chances = scatterers_in(np.array([-20, 5, -3]), np.array([19, 44, 36]), seed=3)
    assert places.shape == (40**3, N_PER_CUBE, 3)
    within = places - np.floor(places)
    # The mean of 64,000 even draws deviates by 0.0011, the correlation of two by 0.004.
    np.testing.assert_allclose(within.mean(axis=0), 0.5, atol=0.006)
    np.testing.assert_allclose(within.var(axis=0), 1.0 / 12.0, atol=0.002)
    grid = within.reshape(40, 40, 40, 3 * N_PER_CUBE)
    n_each = 3 * N_PER_CUBE
    for axis in range(3):
        ahead, behind = np.moveaxis(grid, axis, 0)[1:], np.moveaxis(grid, axis, 0)[:-1]
        both = np.corrcoef(ahead.reshape(-1, n_each).T, behind.reshape(-1, n_each).T)
        assert np.abs(both - np.eye(2 * n_each)).max() < 0.025
    assert (chances < 256).mean() == pytest.approx(0.25, abs=0.01)
    again, _ = scatterers_in(np.array([-20, 5, -3]), np.array([19, 44, 36]), seed=4)
    assert not np.array_equal(places, again)
