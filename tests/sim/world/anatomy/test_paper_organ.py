import numpy as np
import pytest

from sim.world.anatomy.paper_organ import (
    BOX_HIGH_M,
    BOX_LOW_M,
    GRID_SPACING,
    UNIT_M,
    paper_organ,
    surface_height,
)


@pytest.fixture(scope="module")
def organ():
    return paper_organ()


def test_the_surface_is_matplotlibs_test_data_without_its_scaling(organ):
    from mpl_toolkits.mplot3d.axes3d import get_test_data

    x, y, z = get_test_data(GRID_SPACING)
    expected = np.stack([x / 10.0, y / 10.0, z / 500.0], axis=-1) * UNIT_M
    assert organ.surface.positions_m.reshape(120, 120, 3) == pytest.approx(expected, abs=1e-15)


def test_positions_are_14400_on_a_grid_and_on_the_solid(organ):
    surface = organ.surface
    assert surface.n_poses == 14400
    assert surface.grid_shape == (120, 120)
    inner = np.abs(surface.positions_m[:, :2]).max(axis=1) < 0.0899
    top = organ.solid.top_height_m(surface.positions_m[inner, :2])
    assert top == pytest.approx(surface.positions_m[inner, 2], abs=1e-9)  # rays are moved by 0.7e-9 m


def test_the_solid_is_closed_and_fills_the_box(organ):
    mesh = organ.solid.to_trimesh()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    low, high = organ.solid.bounds_m
    assert low == pytest.approx(BOX_LOW_M)
    assert high[:2] == pytest.approx(BOX_HIGH_M[:2])
    assert high[2] < BOX_HIGH_M[2]


def test_its_volume_is_that_below_the_formula(organ):
    # Each bell integrates to erf products over the square; the wide one loses its tails beyond x, y = 3.
    from scipy.special import erf

    def mass(low, high):
        return 0.5 * (erf(high / np.sqrt(2)) - erf(low / np.sqrt(2)))

    narrow = mass(-4 / 1.5, 2 / 1.5) * mass(-4 / 0.5, 2 / 0.5)
    round_ = mass(-3, 3) ** 2
    expected = (3.3 * 36 + narrow - round_) * UNIT_M**3
    # The bilinear surface errs by spacing^2 / 12 x the bells' boundary slopes: far below 1e-5 of the whole.
    assert organ.solid.volume_m3 == pytest.approx(expected, rel=1e-5)


def test_inside_is_below_the_surface(organ):
    points = np.random.default_rng(0).uniform(BOX_LOW_M, BOX_HIGH_M, size=(20000, 3))
    x, y, z = points.T / UNIT_M
    height = surface_height(x, y)
    clear = np.abs(z - height) > 1e-3  # chords of 0.05 units deviate by at most 0.05^2 / 8 x curvature 1
    assert np.array_equal(organ.solid.contains(points)[clear], (z < height)[clear])


def test_normals_are_those_of_the_formula(organ):
    x, y, _ = organ.surface.positions_m.T / UNIT_M
    step = 1e-5
    slope_x = (surface_height(x + step, y) - surface_height(x - step, y)) / (2 * step)
    slope_y = (surface_height(x, y + step) - surface_height(x, y - step)) / (2 * step)
    inward = np.stack([slope_x, slope_y, -np.ones_like(x)], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    angle = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", inward, organ.surface.normals), -1, 1)))
    inner = np.abs(organ.surface.positions_m[:, :2]).max(axis=1) < 0.0865
    # Ten neighbours reach 0.1 units and are not symmetric; a curvature up to 1 turns the plane by 2 degrees.
    assert angle[inner].max() < 3.0
    assert np.linalg.norm(organ.surface.normals, axis=1) == pytest.approx(np.ones(14400))
