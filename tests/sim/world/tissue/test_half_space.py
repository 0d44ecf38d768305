"""The closed forms of a pressed half-space, held against sums of point forces, the laws of contact and equilibrium."""

import numpy as np
import pytest

from sim.world.tissue.half_space import (
    displacement_of,
    hertz_compliance_m_per_n,
    hertz_potentials,
    punch_compliance_m_per_n,
    punch_potentials,
)

RADIUS, SHEAR = 0.004, 1700.0
PROFILES = {"punch": punch_potentials, "hertz": hertz_potentials}


def moved(profile, radial, depth, poissons_ratio):
    radial, depth = np.atleast_1d(radial).astype(float), np.atleast_1d(depth).astype(float)
    return displacement_of(PROFILES[profile](radial, depth, RADIUS), depth, SHEAR, poissons_ratio)


def point_forces(profile, n=160):
    """Places (x, y) on the disc and their shares of the force; r = a sin t takes the punch's edge away."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    t, weights = (nodes + 1) * np.pi / 4, weights * np.pi / 4
    share = np.sin(t) if profile == "punch" else 3.0 * np.sin(t) * np.cos(t) ** 2
    angle = 2 * np.pi * (np.arange(n) + 0.5) / n
    x, y = (RADIUS * np.outer(np.sin(t), f(angle)) for f in (np.cos, np.sin))
    return x, y, np.repeat((weights * share / n)[:, None], n, axis=1)


@pytest.mark.parametrize("poissons_ratio", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("profile", PROFILES)
def test_the_field_is_the_sum_of_boussinesqs_point_forces(profile, poissons_ratio):
    x, y, share = point_forces(profile)
    assert share.sum() == pytest.approx(1.0)
    for radial, depth in (
        (0.001, 0.002),
        (0.004, 0.004),
        (0.009, 0.001),
        (0.00005, 0.008),
        (0.03, 0.01),
        (0.006, 0.0),
    ):
        beside, away = radial - x, np.sqrt((radial - x) ** 2 + y**2 + depth**2)
        scale = share / (4 * np.pi * SHEAR)
        inward = (scale * (2 * (1 - poissons_ratio) / away + depth**2 / away**3)).sum()
        outward = (
            scale * beside * (depth / away**3 - (1 - 2 * poissons_ratio) / (away * (away + depth)))
        ).sum()
        # The quadrature is exact to rounding where the point lies off the disc; the closed form loses 4 digits at most.
        assert np.concatenate(moved(profile, radial, depth, poissons_ratio)) == pytest.approx(
            [outward, inward], rel=1e-7, abs=1e-9 * inward
        )


def test_the_flat_face_goes_down_evenly_by_the_law_of_the_punch():
    modulus = 2 * SHEAR / (1 - 0.49)  # E* = E / (1 - nu^2)
    _, inward = moved("punch", np.linspace(1e-6, 0.999 * RADIUS, 20), np.zeros(20), 0.49)
    assert inward == pytest.approx(np.full(20, punch_compliance_m_per_n(RADIUS, modulus)), rel=1e-9)
    assert 1.0 / inward[0] == pytest.approx(2 * modulus * RADIUS)


def test_hertzs_pressure_makes_a_paraboloid_of_the_surface():
    modulus = 2 * SHEAR / (1 - 0.3)
    radial = np.linspace(1e-5, 0.99 * RADIUS, 20)
    _, inward = moved("hertz", radial, np.zeros(20), 0.3)
    # A ball of radius R: b^2 = R d, F = 4 E* b^3 / (3 R), u = d - r^2 / (2 R).
    ball = 4 * modulus * RADIUS**3 / 3
    assert inward == pytest.approx((RADIUS**2 - radial**2 / 2) / ball, rel=1e-8)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    radial = RADIUS * (nodes + 1) / 2
    pressure = 1.5 * np.sqrt(1 - (radial / RADIUS) ** 2) / (np.pi * RADIUS**2)
    mean = (weights * RADIUS / 2 * 2 * np.pi * radial * pressure) @ moved("hertz", radial, 0 * radial, 0.3)[1]
    # The root at the edge of the disc leaves the quadrature an error of 1e-5.
    assert mean == pytest.approx(hertz_compliance_m_per_n(RADIUS, modulus), rel=1e-4)


@pytest.mark.parametrize("profile", PROFILES)
def test_the_tissue_is_in_equilibrium_beneath_the_disc(profile):
    """Navier's equation: grad(div u) / (1 - 2 nu) + laplace(u) = 0, by differences of fourth order."""
    ratio, step = 0.4, 2e-4

    def field(points):
        radial = np.hypot(points[:, 0], points[:, 1])
        out, inward = moved(profile, radial, points[:, 2], ratio)
        return np.column_stack([out * points[:, 0] / radial, out * points[:, 1] / radial, inward])

    place = np.array([0.002, 0.001, 0.005])
    offsets = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1)
    u = field((place + step * offsets).reshape(-1, 3)).reshape(5, 5, 5, 3)
    first = np.array([1, -8, 0, 8, -1]) / (12 * step)
    second = np.array([-1, 16, -30, 16, -1]) / (12 * step**2)
    unit = np.array([0, 0, 1, 0, 0])

    def derivative(i, j, component):
        kernels = [second if k == i == j else first if k in (i, j) else unit for k in range(3)]
        return np.einsum("xyz,x,y,z->", u[..., component], *kernels)

    for i in range(3):
        divergence = sum(derivative(i, j, j) for j in range(3))
        laplacian = sum(derivative(j, j, i) for j in range(3))
        largest = max(abs(derivative(j, j, i)) for j in range(3))
        # Fourth order: (step / 5 mm)^4 is some 1e-6; the terms themselves are not small.
        assert abs(divergence / (1 - 2 * ratio) + laplacian) < 1e-3 * largest
