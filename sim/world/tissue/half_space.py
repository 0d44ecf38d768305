"""Where the points of an elastic half-space go when its surface is pressed over a disc, in closed form.

A pressure p without friction moves the half-space z >= 0 by (Boussinesq; Johnson, Contact Mechanics, 1985, section 3.2)

    u_z = (2 (1 - nu) phi - z dphi/dz) / (4 pi G)
    u_r = -((1 - 2 nu) dpsi/dr + z dphi/dr) / (4 pi G)

where phi is the integral of p / distance over the disc and dpsi/dz = phi. A pressure that depends on the radius alone
is a charge along an imaginary piece of the axis: phi is the integral of g(t) / R(t) over t in (-c, c) with
R(t)^2 = r^2 + (z + i t)^2. The rigid flat punch has g = F / (2 c), Hertz's ellipsoid g = 3 F (c^2 - t^2) / (4 c^3), and
both integrals are elementary.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_RADIUS_SHARE = 1e-5
"""Closer to the axis than this share of the radius, Hertz's formula loses its digits; the field is flat there."""


class Potentials(NamedTuple):
    """phi [N/m], its derivatives along z and r [N/m^2], and dpsi/dr [N/m] of a force of 1 N, each of shape (N,)."""

    phi: Array
    phi_z: Array
    phi_r: Array
    psi_r: Array


def punch_potentials(radial_m: Array, depth_m: Array, radius_m: float) -> Potentials:
    """The potentials of a rigid flat punch, p = F / (2 pi a sqrt(a^2 - r^2)), whose face goes down evenly.

    Args:
        radial_m: Distance from the axis [m], shape (N,), above 0.
        depth_m: Depth below the surface [m], shape (N,), at least 0.
        radius_m: Radius a of the punch [m].
    """
    zeta = _complex_depth(depth_m, radius_m)
    root = _root(radial_m, zeta)
    total = root + zeta
    return Potentials(
        phi=np.angle(total) / radius_m,
        phi_z=(1.0 / root).imag / radius_m,
        phi_r=(radial_m / (root * total)).imag / radius_m,
        psi_r=-(radial_m / total).imag / radius_m,
    )


def hertz_potentials(radial_m: Array, depth_m: Array, radius_m: float) -> Potentials:
    """The potentials of Hertz's pressure, p = 3 F sqrt(1 - r^2 / b^2) / (2 pi b^2).

    Args:
        radial_m: Distance from the axis [m], shape (N,), above 0.
        depth_m: Depth below the surface [m], shape (N,), at least 0.
        radius_m: Radius b of the loaded disc [m].
    """
    r, z, b = np.maximum(radial_m, LEAST_RADIUS_SHARE * radius_m), depth_m, radius_m
    zeta = _complex_depth(z, b)
    root = _root(r, zeta)
    total = root + zeta
    log = np.asarray(np.log(total), dtype=np.complex128)
    # The integrals of zeta^n / R over zeta.
    first, second, third = root, 0.5 * (zeta * root - r * r * log), root**3 / 3.0 - r * r * root
    scale, reach = 1.5 / b**3, b * b + z * z
    psi = b * b * (zeta - root) + (zeta - z) ** 3 / 3.0 - (third - 2.0 * z * second + z * z * first)
    return Potentials(
        phi=scale * (reach * log - 2.0 * z * first + second).imag,
        phi_z=-2.0 * scale * (root - z * log).imag,
        phi_r=scale * r * (reach / (root * total) + (zeta - 2.0 * z) / root - log).imag,
        psi_r=scale / r * psi.imag,
    )


def displacement_of(
    potentials: Potentials, depth_m: Array, shear_modulus_pa: float, poissons_ratio: float
) -> tuple[Array, Array]:
    """Displacement away from the axis and into the half-space [m], each of shape (N,), of a force of 1 N."""
    scale = 1.0 / (4.0 * np.pi * shear_modulus_pa)
    radial_m = -scale * ((1.0 - 2.0 * poissons_ratio) * potentials.psi_r + depth_m * potentials.phi_r)
    inward_m = scale * (2.0 * (1.0 - poissons_ratio) * potentials.phi - depth_m * potentials.phi_z)
    return radial_m, inward_m


def punch_compliance_m_per_n(radius_m: float, contact_modulus_pa: float) -> float:
    """How deep a rigid flat punch goes per force [m/N]: d = F / (2 E* a)."""
    return 1.0 / (2.0 * contact_modulus_pa * radius_m)


def hertz_compliance_m_per_n(radius_m: float, contact_modulus_pa: float) -> float:
    """How deep Hertz's pressure goes per force, in the mean weighted by that pressure [m/N]: 3 F / (5 E* b).

    Under it u_z = 3 F (1 - r^2 / (2 b^2)) / (4 E* b), and the weighted mean of r^2 is 2 b^2 / 5.
    """
    return 3.0 / (5.0 * contact_modulus_pa * radius_m)


def _complex_depth(depth_m: Array, radius_m: float) -> NDArray[np.complex128]:
    return np.asarray(depth_m + 1j * radius_m, dtype=np.complex128)


def _root(radial_m: Array, zeta: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """R = sqrt(r^2 + zeta^2) on the branch that is positive far away."""
    return np.sqrt(radial_m * radial_m + zeta * zeta)
