"""The organ as an elastic body on its bed, factorised once, and what a probe's face does to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, kron
from scipy.sparse.linalg import SuperLU, splu

from sim.world.solids.solid import Solid

from .brick import VOID_SHARE, cell_stiffness
from .contact import Contact, checked_contact, spread_weights
from .half_space import hertz_compliance_m_per_n, punch_compliance_m_per_n
from .indentation import Indentation
from .lattice import Lattice, cell_size_m, inside_cells, lay_lattice
from .outer_surface import OuterSurface
from .settings import ElasticSettings

Array = NDArray[np.float64]

FACE_RADIUS_M = 0.004
"""Radius of a small face [m]; that of the embedded probe is twice as large."""
BED_STIFFNESS_PER_M = 1e4
"""Stiffness of the bed per area over the organ's modulus [1/m]: a layer of the organ's own tissue 0.1 mm thick."""


@dataclass(frozen=True, eq=False)
class ElasticOrgan:
    """An organ that yields under a probe; made by `build_elastic_organ`.

    Attributes:
        tissue: What it is made of.
        lattice: The cells that it is laid into.
        surface: Its surface in pieces.
    """

    tissue: ElasticSettings
    lattice: Lattice
    surface: OuterSurface
    _to_surface: csr_array
    _factors: SuperLU

    def press(
        self,
        position_m: ArrayLike,
        direction: ArrayLike,
        *,
        force_n: float | None = None,
        depth_m: float | None = None,
        face_radius_m: float = FACE_RADIUS_M,
    ) -> Indentation:
        """What happens where a probe's flat round face is pressed on the organ at rest.

        Args:
            position_m: Middle of the face where it first touches [m], shape (3,), on the surface.
            direction: The probe's axis into the organ, shape (3,), of any length.
            force_n: The force that the probe stops at [N]; give this or the depth.
            depth_m: How far the face goes in from where it touched [m]; give this or the force.
            face_radius_m: Radius of the face [m].

        Raises:
            TissueError: Not one of force and depth, a value out of its range, a face that is not on the surface or does
                not look into the organ, or an indentation too deep for the organ or for linear elasticity.
        """
        contact = checked_contact(
            self.surface, position_m, direction, face_radius_m, cell_size_m=self.lattice.size_m
        )
        moved_m_per_n, compliance = self._response(contact)
        force_n = contact.force_of(
            compliance, force_n=force_n, depth_m=depth_m, thickness_m=float(self.surface.spans_m.min())
        )
        return Indentation(
            contact=contact,
            tissue=self.tissue,
            lattice=self.lattice,
            force_n=force_n,
            strain=contact.check_strain(force_n, self.tissue.contact_modulus_pa),
            compliance_m_per_n=compliance,
            coarse_m_per_n=self.lattice.on_box(moved_m_per_n),
        )

    def _response(self, contact: Contact) -> tuple[Array, float]:
        """Displacement of the lattice's nodes under the spread force, shape (N, 3), and the face's depth [m/N].

        The face goes as deep as the organ does under the spread force, less that force's own dent, and its own.
        """
        near, weights = spread_weights(self.surface, contact)
        to_near = self._to_surface[near]
        load_n = np.outer(to_near.T @ weights, contact.direction)
        moved_m = self._factors.solve(load_n.ravel()).reshape(-1, 3)
        organ = float(weights @ (to_near @ moved_m) @ contact.direction)
        modulus_pa = self.tissue.contact_modulus_pa
        spread = hertz_compliance_m_per_n(contact.spread_radius_m, modulus_pa)
        return moved_m, organ - spread + punch_compliance_m_per_n(contact.face_radius_m, modulus_pa)


def build_elastic_organ(
    organ: Solid, *, tumours: Sequence[Solid] = (), tissue: ElasticSettings | None = None
) -> ElasticOrgan:
    """The elastic model of an organ, which takes some tenths of a second.

    Args:
        organ: The organ where it lies, its z axis pointing up.
        tumours: Stiffer bodies within it, in the same frame; what lies outside the organ counts for nothing.
        tissue: What organ and tumours are made of; None takes the defaults.

    Raises:
        TissueError: Cells that do not suit the organ, or an organ that rests on nothing.
    """
    tissue = tissue or ElasticSettings()
    size_m = cell_size_m(organ, tissue.element_size_m)
    surface = OuterSurface.of(organ, size_m)
    lattice, is_inside = lay_lattice(organ, surface.points_m, size_m)
    moduli_pa = np.where(is_inside, tissue.youngs_modulus_pa, VOID_SHARE * tissue.youngs_modulus_pa)
    for tumour in tumours:
        is_tumour = inside_cells(tumour, lattice)[lattice.is_cell] & is_inside
        moduli_pa[is_tumour] = tissue.tumour_youngs_modulus_pa
    to_surface = lattice.weights(surface.points_m)
    stiffness = _assembled(lattice, cell_stiffness(moduli_pa, size_m, tissue.poissons_ratio))
    stiffness = stiffness + _bed(lattice, surface, to_surface, tissue)
    factors = splu(
        csc_array(stiffness), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return ElasticOrgan(tissue, lattice, surface, to_surface, factors)


def _assembled(lattice: Lattice, per_cell: Array) -> csc_array:
    """The organ's stiffness matrix [N/m] of the cells' own, rows and columns by node and axis."""
    unknowns = (3 * lattice.cell_rows[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows, columns = np.repeat(unknowns, 24, axis=1), np.tile(unknowns, (1, 24))
    n = 3 * len(lattice.nodes)
    return csc_array(coo_array((per_cell.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)))


def _bed(
    lattice: Lattice, surface: OuterSurface, to_surface: csr_array, tissue: ElasticSettings
) -> csc_array:
    """Stiffness of the bed [N/m], which holds what lies on it in all directions."""
    parts = lattice.cell_parts[tuple(lattice.cell_at(surface.points_m).T)]
    rests = surface.rests(parts, tissue.rest_height_share)
    springs = diags_array(surface.areas_m2[rests] * (BED_STIFFNESS_PER_M * tissue.youngs_modulus_pa))
    on_bed = to_surface[rests]
    return csc_array(kron(on_bed.T @ springs @ on_bed, np.eye(3)))
