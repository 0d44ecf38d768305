"""The separate bodies of a closed surface, and those of them that are the organ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.solids.crossings import VerticalCrossings
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance

from .pieces import Piece, keep_pieces
from .repair import compact
from .topology import Faces, bodies

LEAST_DIAMETER_M = 3e-3
"""Bodies in an organ that are smaller than balls of this diameter are taken for noise of an outline [m]."""

MOST_BODIES = 50
"""Bodies of a file that are kept, the largest first."""

N_PROBES = 8
"""Vertices of a body by which it is told whether it lies inside another."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """A closed surface and the bodies that it consists of.

    Attributes:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        body: Body of each face, shape (F,).
        volumes_m3: Signed volume of each body [m^3]: a cavity's is negative.
    """

    vertices_m: NDArray[np.float64]
    faces: Faces
    body: NDArray[np.int64]
    volumes_m3: NDArray[np.float64]

    @property
    def outer(self) -> NDArray[np.int64]:
        """Those that are no cavities."""
        return np.flatnonzero(self.volumes_m3 > 0.0)

    def solid(self, body: int) -> Solid:
        """One of them, without its cavities."""
        return Solid(*compact(self.vertices_m, self.faces[self.body == body]))

    def middles_m(self) -> NDArray[np.float64]:
        """The middle of the bounding box of each [m], shape (number of bodies, 3)."""
        order, start = self._sorted()
        corners_m = self.vertices_m[self.faces[order]]
        low_m = np.minimum.reduceat(corners_m.min(axis=1), start[:-1])
        return 0.5 * (low_m + np.maximum.reduceat(corners_m.max(axis=1), start[:-1]))

    def probes_m(self, which: NDArray[np.int64]) -> NDArray[np.float64]:
        """Some vertices of each of some bodies [m], shape (len(which), N_PROBES, 3)."""
        order, start = self._sorted()
        places = [np.linspace(start[each], start[each + 1] - 1, N_PROBES).astype(int) for each in which]
        return self.vertices_m[self.faces[order[np.array(places)], 0]]

    def _sorted(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The faces body by body, and where each body begins among them."""
        order = np.argsort(self.body, kind="stable")
        return order, np.searchsorted(self.body[order], np.arange(len(self.volumes_m3) + 1))

    def with_cavities(self, kept: NDArray[np.int64]) -> tuple[NDArray[np.float64], Faces]:
        """Vertices and faces of some bodies and of the cavities in them."""
        crossings = VerticalCrossings(self.vertices_m, self.faces[np.isin(self.body, kept)])
        cavities = np.flatnonzero(self.volumes_m3 <= 0.0)
        if len(cavities):
            first = np.array([np.argmax(self.body == each) for each in cavities])
            is_held = crossings.winding(self.vertices_m[self.faces[first, 0]]) > 0
            kept = np.concatenate([kept, cavities[is_held]])
        return compact(self.vertices_m, self.faces[np.isin(self.body, kept)])


def bodies_of(vertices_m: NDArray[np.float64], faces: Faces) -> Bodies:
    """The bodies of a closed surface.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices of closed bodies that face outwards, shape (F, 3).
    """
    body = bodies(faces)
    # The labels of connected components need not be consecutive among faces.
    _, body = np.unique(body, return_inverse=True)
    corners = (vertices_m - vertices_m.mean(axis=0))[faces]
    six = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return Bodies(vertices_m, faces, body, np.bincount(body, six) / 6.0)


def organ_bodies(
    vertices_m: NDArray[np.float64], faces: Faces, wanted: str | None = None
) -> tuple[NDArray[np.float64], Faces, list[str]]:
    """The surface without bodies that are no part of the organ, and what is said of them.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices of closed bodies that face outwards, shape (F, 3).
        wanted: The body to take, as `piece 2`; None for the rule.

    Raises:
        PieceError: Several bodies could be the organ, or the one wanted is not there.
    """
    every = bodies_of(vertices_m, faces)
    outer = every.outer
    if len(outer) <= 1 and wanted is None:
        return vertices_m, faces, []
    main = outer[np.argmax(every.volumes_m3[outer])]
    is_within, middles_m = _within(every, outer, main), every.middles_m()
    pieces = [
        Piece(volume_m3=float(every.volumes_m3[each]), middle_m=middles_m[each], is_within=bool(inside))
        for each, inside in zip(outer, is_within, strict=True)
    ]
    kept = keep_pieces(pieces, lambda i, j: _gap_m(every.solid(outer[i]), every.solid(outer[j])), wanted)
    if len(kept.indices) == len(pieces):
        return vertices_m, faces, list(kept.remarks)
    return *every.with_cavities(outer[list(kept.indices)]), list(kept.remarks)


def separate_solids(solid: Solid, noun: str) -> tuple[tuple[Solid, ...], list[str]]:
    """The bodies of a closed surface with their cavities, the largest first, and what is said of them.

    Bodies within others are left out, and so are those that are too small, of which there may be no other.

    Args:
        solid: All of them together.
        noun: What each is.
    """
    every = bodies_of(solid.vertices_m, solid.faces)
    outer = every.outer
    order = outer[np.argsort(-every.volumes_m3[outer], kind="stable")]
    is_large = every.volumes_m3[order] >= np.pi / 6.0 * LEAST_DIAMETER_M**3
    large = order[is_large][:MOST_BODIES]
    kept: list[int] = []
    for each in large:
        points_m = every.probes_m(np.array([each]))[0]
        if not any(every.solid(other).contains(points_m).all() for other in kept):
            kept.append(int(each))
    if len(kept) <= 1 and len(order) == len(large):
        return (solid,), []
    said = (
        [f"it is of {len(kept)} separate bodies, each of which is a {noun} of its own"]
        if len(kept) > 1
        else []
    )
    n_small, n_over = int((~is_large).sum()), int(is_large.sum()) - len(large)
    if n_small:
        bodies_were = "a body" if n_small == 1 else f"{n_small:,} bodies"
        verb = "was" if n_small == 1 else "were"
        largest_mm = float(np.cbrt(6.0 * every.volumes_m3[order][~is_large].max() / np.pi)) * 1e3
        size = f"of {largest_mm:.2g}" if n_small == 1 else f"of up to {largest_mm:.2g}"
        said.append(
            f"{bodies_were} {size} mm across {verb} taken for noise of the outline and dropped, as all under "
            f"{LEAST_DIAMETER_M * 1e3:g} mm are"
        )
    if n_over:
        said.append(f"of {len(large) + n_over:,} bodies the {MOST_BODIES} largest are kept")
    return tuple(Solid(*every.with_cavities(np.array([each]))) for each in kept), said


def _within(every: Bodies, outer: NDArray[np.int64], main: np.int64) -> NDArray[np.bool_]:
    """Whether each of the outer bodies lies inside the main one, told by some vertices."""
    crossings = VerticalCrossings(every.vertices_m, every.faces[every.body == main])
    inside = crossings.winding(every.probes_m(outer).reshape(-1, 3)).reshape(-1, N_PROBES) > 0
    return inside.all(axis=1) & (outer != main)


def _gap_m(one: Solid, other: Solid) -> float:
    """The distance between two solids [m], 0 where they overlap; by their vertices."""
    if one.contains(other.vertices_m).any() or other.contains(one.vertices_m).any():
        return 0.0
    return float(
        min(
            SurfaceDistance(one).distance_m(other.vertices_m).min(),
            SurfaceDistance(other).distance_m(one.vertices_m).min(),
        )
    )
