"""Stiffness of whole and of cut cells: rigid motions are free, even strains have the energy of the continuum."""

import numpy as np
import pytest

from sim.world.tissue.brick import CORNERS, SUBCELLS, cell_stiffness

SIZE_M, MODULUS_PA = 0.01, 5000.0


def cells():
    """A whole cell and two cut ones, shape (3, sub-cubes)."""
    middles = (
        np.stack(np.meshgrid(*[np.arange(SUBCELLS)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5
    ) / SUBCELLS
    is_inside = np.stack([np.ones(len(middles)), middles[:, 2] < 0.5, middles @ [1.0, 0.7, 0.4] < 0.8])
    return MODULUS_PA * is_inside


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.49])
def test_an_even_strain_has_the_energy_of_the_material_inside(ratio):
    strain = np.array([[0.02, 0.004, -0.01], [0.004, -0.03, 0.006], [-0.01, 0.006, 0.015]])
    moved = (SIZE_M * CORNERS @ strain).ravel()
    shear, lame = MODULUS_PA / (2 * (1 + ratio)), MODULUS_PA * ratio / ((1 + ratio) * (1 - 2 * ratio))
    density = 0.5 * lame * np.trace(strain) ** 2 + shear * (strain * strain).sum()
    volume = cells().sum(axis=1) / MODULUS_PA * (SIZE_M / SUBCELLS) ** 3
    energy = 0.5 * np.einsum("i,cij,j->c", moved, cell_stiffness(cells(), SIZE_M, ratio), moved)
    assert energy == pytest.approx(density * volume, rel=1e-12)


def test_rigid_motions_cost_nothing_and_all_else_something():
    stiffness = cell_stiffness(cells(), SIZE_M, 0.49)
    places = SIZE_M * CORNERS - SIZE_M / 2
    turns = [np.cross(axis, places) for axis in np.eye(3)]
    rigid = np.stack([*(np.tile(axis, (8, 1)) for axis in np.eye(3)), *turns]).reshape(6, 24)
    assert np.abs(stiffness @ rigid.T).max() < 1e-12 * np.abs(stiffness).max()
    values = np.linalg.eigvalsh(stiffness[0])
    assert (values[:6] < 1e-12 * values[-1]).all()
    assert values[6] > 1e-4 * values[-1]


def test_bending_does_not_lock_where_the_tissue_keeps_its_volume():
    """In the mean over the cell pure bending changes no volume: its energy stays bounded as nu goes to 0.5."""
    along, across = CORNERS[:, 0] - 0.5, CORNERS[:, 2] - 0.5
    bent = np.zeros((8, 3))
    bent[:, 0] = along * across
    energies = [
        bent.ravel() @ cell_stiffness(cells()[:1], SIZE_M, ratio)[0] @ bent.ravel() for ratio in (0.3, 0.499)
    ]
    assert energies[1] < 1.1 * energies[0]
