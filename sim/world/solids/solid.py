"""A closed solid bounded by triangles, and the exact answer to which points lie inside it.

A point is inside where the winding number of the surface about it is positive. The number is counted along
the ray towards +z: each triangle crossed on the way out counts +1, each crossed on the way in counts -1.
Solids that overlap themselves (two bodies in one file) are therefore their union.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from sim.world.errors import MeshError

from .crossings import VerticalCrossings

MAX_SAMPLING_ROUNDS = 200
"""Rounds of rejection sampling before a solid is declared to have no interior."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed, outward-oriented triangle surface and the volume it bounds. Arrays are copied and read-only.

    Attributes:
        vertices_m: Vertices [m], shape (V, 3). Triangles that share a corner share its index.
        faces: Vertex indices, shape (F, 3), counter-clockwise seen from outside.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        """Checks the arrays and freezes copies of them.

        Raises:
            MeshError: Wrong shapes, values that are not finite, or indices without a vertex.
        """
        vertices_m = np.array(self.vertices_m, dtype=np.float64, order="C")
        faces = np.array(self.faces, dtype=np.int64, order="C")
        _check_arrays(vertices_m, faces)
        vertices_m.setflags(write=False)
        faces.setflags(write=False)
        object.__setattr__(self, "vertices_m", vertices_m)
        object.__setattr__(self, "faces", faces)

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh) -> "Solid":
        """The solid of a mesh, whose vertices are taken for metres."""
        return cls(np.asarray(mesh.vertices), np.asarray(mesh.faces))

    def to_trimesh(self) -> trimesh.Trimesh:
        """The same surface as a writable trimesh object [m], vertex order kept."""
        return trimesh.Trimesh(self.vertices_m.copy(), self.faces.copy(), process=False)

    @cached_property
    def _crossings(self) -> VerticalCrossings:
        """The crossings of vertical rays with the surface, made on first use: a solid that is only drawn needs none."""
        return VerticalCrossings(self.vertices_m, self.faces)

    @cached_property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the axis-aligned bounding box [m], shape (2, 3), kept: readings ask."""
        bounds_m = np.stack([self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)])
        bounds_m.setflags(write=False)
        return bounds_m

    @property
    def extents_m(self) -> NDArray[np.float64]:
        """Edge lengths of the axis-aligned bounding box [m], shape (3,)."""
        return np.ptp(self.vertices_m, axis=0)

    @property
    def volume_m3(self) -> float:
        """Volume [m^3] by the divergence theorem: one sixth of the sum of a . (b x c) over the triangles."""
        corners = self.vertices_m[self.faces] - self.bounds_m.mean(axis=0)
        return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)

    @property
    def centroid_m(self) -> NDArray[np.float64]:
        """The centre of the volume [m], shape (3,), by the divergence theorem."""
        middle = self.bounds_m.mean(axis=0)
        a, b, c = (self.vertices_m[self.faces[:, i]] - middle for i in range(3))
        sixths = np.einsum("ij,ij->i", a, np.cross(b, c))
        return middle + (sixths[:, None] * (a + b + c)).sum(axis=0) / (4.0 * sixths.sum())

    @property
    def area_m2(self) -> float:
        """Area of the surface [m^2]."""
        return float(np.linalg.norm(self._area_vectors_m2(), axis=1).sum())

    def face_areas_m2(self) -> NDArray[np.float64]:
        """Area of each triangle [m^2], shape (F,)."""
        return np.linalg.norm(self._area_vectors_m2(), axis=1)

    def face_normals(self) -> NDArray[np.float64]:
        """Outward unit normal of each triangle, shape (F, 3); zero where a triangle has no area."""
        vectors = self._area_vectors_m2()
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)

    def winding(self, points_m: ArrayLike) -> NDArray[np.int64]:
        """Winding number of the surface about each point.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Whole numbers, shape (N,): 0 outside, 1 inside, 2 where two bodies overlap, negative inside out.
        """
        return self._crossings.winding(check_points(points_m))

    def contains(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point inside the solid.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,).
        """
        return self.winding(points_m) > 0

    def contains_in_columns(
        self, places_m: NDArray[np.float64], heights_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """What `contains` says of the points of a grid, many times faster, shape (K, Z).

        Args:
            places_m: Where the grid's columns stand in the plane [m], shape (K, 2).
            heights_m: Rising heights of the points of each column [m], shape (Z,).
        """
        return self._crossings.winding_in_columns(places_m, heights_m) > 0

    def is_open_above(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point from which a ray towards +z meets nothing of the surface.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,).
        """
        return self._crossings.count_above(check_points(points_m)) == 0

    def top_height_m(self, points_xy_m: ArrayLike) -> NDArray[np.float64]:
        """Height z [m] of the highest surface point over each place, NaN where there is none.

        Args:
            points_xy_m: Places in the plane [m], shape (N, 2).

        Returns:
            Shape (N,).
        """
        places = np.asarray(points_xy_m, dtype=np.float64).reshape(-1, 2)
        below = np.full((len(places), 1), self.bounds_m[0, 2] - 1.0)
        return self._crossings.highest(np.hstack([places, below]))

    def sample_inside(self, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Points drawn evenly in volume, by rejection from the bounding box.

        Args:
            n: Number of points.
            rng: Source of the draws.

        Returns:
            Points [m], shape (n, 3).

        Raises:
            MeshError: The solid has no interior to draw from.
        """
        low, high = self.bounds_m
        kept: list[NDArray[np.float64]] = []
        n_kept = 0
        for _ in range(MAX_SAMPLING_ROUNDS):
            if n_kept >= n:
                break
            candidates = rng.uniform(low, high, size=(max(4 * (n - n_kept), 256), 3))
            kept.append(candidates[self.contains(candidates)])
            n_kept += len(kept[-1])
        if n_kept < n:
            raise MeshError(
                f"solid of volume {self.volume_m3:.3g} m^3 has no interior to draw {n} points from"
            )
        return np.concatenate([*kept, np.empty((0, 3))])[:n]

    def transformed(self, T_target_solid: ArrayLike) -> "Solid":
        """The solid moved by a rigid motion, 4 x 4, that maps its coordinates to the target frame."""
        T = np.asarray(T_target_solid, dtype=np.float64)
        return Solid(self.vertices_m @ T[:3, :3].T + T[:3, 3], self.faces)

    def _area_vectors_m2(self) -> NDArray[np.float64]:
        a, b, c = (self.vertices_m[self.faces[:, i]] for i in range(3))
        return 0.5 * np.cross(b - a, c - a)


def check_points(points_m: ArrayLike) -> NDArray[np.float64]:
    """The points as float64, shape (N, 3).

    Raises:
        ValueError: Another shape, or values that are not finite.
    """
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points_m has shape {points.shape}, expected (N, 3)")
    if not np.isfinite(points).all():
        raise ValueError("points_m holds values that are not finite")
    return points


def _check_arrays(vertices_m: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    if vertices_m.ndim != 2 or vertices_m.shape[1:] != (3,) or len(vertices_m) < 4:
        raise MeshError(f"vertices_m has shape {vertices_m.shape}, expected (V, 3) with V >= 4")
    if faces.ndim != 2 or faces.shape[1:] != (3,) or len(faces) < 4:
        raise MeshError(f"faces has shape {faces.shape}, expected (F, 3) with F >= 4")
    if not np.isfinite(vertices_m).all():
        raise MeshError("vertices_m holds values that are not finite")
    if faces.min() < 0 or faces.max() >= len(vertices_m):
        raise MeshError(f"faces index {faces.min()}..{faces.max()}, but there are {len(vertices_m)} vertices")
