"""A pressed organ: where each point of its tissue goes, and where each came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.world.solids.solid import check_points

from .contact import Contact
from .half_space import displacement_of, hertz_potentials, punch_potentials
from .inverse_map import rest_places
from .lattice import Lattice
from .settings import ElasticSettings

Array = NDArray[np.float64]

LOCAL_RADII = 6.0
"""Beyond so many radii of the spread disc, the fields of the face and of the disc differ by microns."""
MISSED_SHARE = 0.2
"""A rest place must go to its point within this share of the depth, also beside the rim of the face, where the linear
field folds over itself. Elsewhere, places are found within `inverse_map.TOLERANCE_M`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Indentation:
    """The deformed state of an organ under a probe's face.

    Attributes:
        contact: Where the face stands.
        tissue: What the organ is made of.
        lattice: The cells of the coarse model.
        force_n: The force on the face [N].
        strain: The largest strain on the face's axis; from 1 on, tissue below the face passes through itself.
        compliance_m_per_n: Depth of the face per force [m/N].
        coarse_m_per_n: Displacement of the lattice's nodes per force [m/N], shape (B, 3).
    """

    contact: Contact
    tissue: ElasticSettings
    lattice: Lattice
    force_n: float
    strain: float
    compliance_m_per_n: float
    coarse_m_per_n: Array

    @property
    def depth_m(self) -> float:
        """How far the face has gone in from where it touched [m]."""
        return self.force_n * self.compliance_m_per_n

    @property
    def face_m(self) -> Array:
        """Where the middle of the probe's face is now [m], shape (3,)."""
        return self.contact.position_m + self.depth_m * self.contact.direction

    def displacement_m(self, points_m: ArrayLike) -> Array:
        """How far each point of the tissue has moved [m], shape (N, 3).

        Args:
            points_m: Points of the organ at rest [m], shape (N, 3); the field goes on smoothly outside the organ.
        """
        points = check_points(points_m)
        offset_m = points - self.contact.position_m
        height_m = offset_m @ self.contact.direction
        beside_m = offset_m - height_m[:, None] * self.contact.direction
        radial_m = np.linalg.norm(beside_m, axis=1)
        moved_m = self.lattice.interpolate(self.coarse_m_per_n, points - self._above_m(height_m, radial_m))
        self._add_local(moved_m, height_m, radial_m, beside_m)
        return self.force_n * moved_m

    def deformed_m(self, points_m: ArrayLike) -> Array:
        """Where points of the organ at rest have gone [m], shape (N, 3)."""
        points = check_points(points_m)
        return points + self.displacement_m(points)

    def rest_of(self, points_m: ArrayLike) -> Array:
        """Where points of the deformed body lay at rest [m], shape (N, 3): the inverse of `deformed_m`.

        What lies where the probe is now came from nowhere, and is given a place outside the organ.

        Args:
            points_m: Points in the deformed state [m], shape (N, 3).

        Raises:
            TissueError: A place was not found within a fifth of the depth. All are found within 0.01 mm but for a few
                beside the face's rim.
        """
        return rest_places(
            self.displacement_m, check_points(points_m), most_missed_m=MISSED_SHARE * self.depth_m
        )

    def _above_m(self, height_m: Array, radial_m: Array) -> Array:
        """From the plane of the face to the points above it [m], shape (N, 3), zero away from the probe.

        There, outside the organ, the lattice's loaded nodes hang on next to nothing; the plane's displacement is taken.
        """
        share = np.clip(2.0 - radial_m / self.contact.spread_radius_m, 0.0, 1.0)
        return (np.minimum(height_m, 0.0) * share)[:, None] * self.contact.direction

    def _add_local(self, moved_m: Array, height_m: Array, radial_m: Array, beside_m: Array) -> None:
        """Adds what the face does beyond the spread force, per force [m/N]: the difference of their fields."""
        contact = self.contact
        near = np.flatnonzero(radial_m**2 + height_m**2 < (LOCAL_RADII * contact.spread_radius_m) ** 2)
        if not len(near):
            return
        # A curved surface rises above the plane of the face, where the half-space has no field.
        depth_m, radial_m = np.maximum(height_m[near], 0.0), np.maximum(radial_m[near], 1e-12)
        elastic = self.tissue.shear_modulus_pa, self.tissue.poissons_ratio
        out_m, in_m = displacement_of(
            punch_potentials(radial_m, depth_m, contact.face_radius_m), depth_m, *elastic
        )
        less_out_m, less_in_m = displacement_of(
            hertz_potentials(radial_m, depth_m, contact.spread_radius_m), depth_m, *elastic
        )
        moved_m[near] += (in_m - less_in_m)[:, None] * contact.direction
        moved_m[near] += ((out_m - less_out_m) / radial_m)[:, None] * beside_m[near]
