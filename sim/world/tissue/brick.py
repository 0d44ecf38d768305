"""Stiffness of the lattice's cells, of which the organ's surface cuts some: a finite cell method.

All cells are cubes of trilinear elements, and each is integrated over the sub-cubes of it that lie inside the organ
(Parvizian, Duester and Rank, Computational Mechanics 41, 2007). The rest of a cut cell keeps a small share of the
stiffness, so that no node hangs loose. Elements of nearly incompressible tissue lock unless their change of volume is
taken in the mean over the element (B-bar: Hughes, Int. J. Numer. Meth. Eng. 15, 1980), and so it is here, over the part
that lies inside.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUBCELLS = 4
"""Sub-cubes along each edge of a cell."""
VOID_SHARE = 1e-3
"""Stiffness of what lies outside the organ, as a share of the organ's."""
CORNERS = np.array(list(product((0, 1), repeat=3)))
"""The corners of a cell on the lattice, shape (8, 3)."""


def cell_stiffness(moduli_pa: Array, size_m: float, poissons_ratio: float) -> Array:
    """Stiffness matrix of each cell [N/m], shape (C, 24, 24), rows and columns by corner and axis.

    Args:
        moduli_pa: Young's modulus of each cell's sub-cubes [Pa], shape (C, SUBCELLS^3).
        size_m: Edge of a cell [m].
        poissons_ratio: Of all tissue.
    """
    gradients = _gradients(size_m)
    volume_m3 = (size_m / SUBCELLS) ** 3
    shear, bulk = 0.5 / (1.0 + poissons_ratio), 1.0 / (3.0 * (1.0 - 2.0 * poissons_ratio))
    within = moduli_pa @ (shear * volume_m3 * _shape_change(gradients)).reshape(len(gradients), -1)
    totals = moduli_pa.sum(axis=1)
    mean = (moduli_pa @ gradients.reshape(len(gradients), 24)) / totals[:, None]
    volume_change = (bulk * volume_m3 * totals)[:, None, None] * mean[:, :, None] * mean[:, None, :]
    return within.reshape(-1, 24, 24) + volume_change


def _gradients(size_m: float) -> Array:
    """Gradients of the eight trilinear shape functions at the middle of each sub-cube [1/m], shape (S, 8, 3)."""
    along = (np.arange(SUBCELLS) + 0.5) / SUBCELLS
    places = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    factors = np.where(CORNERS == 1, places, 1.0 - places)
    slopes = np.where(CORNERS == 1, 1.0, -1.0) / size_m
    others = np.stack([np.delete(factors, axis, axis=2).prod(axis=2) for axis in range(3)], axis=-1)
    return slopes * others


def _shape_change(gradients: Array) -> Array:
    """The form 2 e : e of the deviatoric strain e at each sub-cube [1/m^2], shape (S, 24, 24)."""
    same = np.einsum("sad,sbd,ij->saibj", gradients, gradients, np.eye(3))
    crossed = np.einsum("saj,sbi->saibj", gradients, gradients)
    volume = np.einsum("sai,sbj->saibj", gradients, gradients)
    return (same + crossed - 2.0 / 3.0 * volume).reshape(-1, 24, 24)
