"""The way of a tip over the surface: a path of the roadmap made smooth, with the places where readings are taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner import Workspace
from planner.paths.roadmap import read_at
from sim.world.solids.surface_distance import SurfaceDistance

STEP_M = 0.002
"""Places of a way are about this far apart [m]."""
SMOOTH_M = 0.012
"""Corners of a path, and the normals along it, are averaged over up to this much of the way to both sides [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceWay:
    """K places that the tip passes, both ends of the path exactly among them."""

    places_m: NDArray[np.float64]
    """On the surface, world frame [m], shape (K, 3)."""
    beams: NDArray[np.float64]
    """Where the beam points, unit vectors into the organ, shape (K, 3)."""
    along_m: NDArray[np.float64]
    """Length of the way up to each place [m], shape (K,)."""

    def readings(self, every_m: float) -> NDArray[np.intp]:
        """The places at which readings are taken, see `read_at`."""
        return read_at(self.along_m, every_m)


def surface_way(
    workspace: Workspace,
    path: Sequence[int],
    surface: SurfaceDistance,
    *,
    most_tilt_rad: float,
    smooth_m: float = SMOOTH_M,
) -> SurfaceWay:
    """The smooth way along neighbouring poses.

    Places are averaged over a window that shrinks to nothing at both ends, and brought back to the surface. Normals are
    averaged over one that is cut off there; the beam then turns evenly to the poses' own over the last part of the way.

    Args:
        workspace: The poses.
        path: Indices of at least two different poses, each a neighbour of the one before.
        surface: The organ's surface.
        most_tilt_rad: A beam is no farther from the normal of the path than this.
        smooth_m: Half of the window [m].
    """
    corners_m, normals = workspace.positions_m[list(path)], workspace.normals[list(path)]
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners_m, axis=0), axis=1))])
    n = max(2, int(np.ceil(at_m[-1] / STEP_M)) + 1)
    even_m = np.linspace(0.0, at_m[-1], n)
    places_m, along = _between(even_m, at_m, corners_m), _unit(_between(even_m, at_m, normals))
    ends, room_m = [0, -1], np.minimum(even_m, even_m[-1] - even_m)
    places_m = _averaged(places_m, even_m, np.minimum(smooth_m, room_m))
    beams = _to_ends(_averaged(along, even_m, np.full(n, smooth_m)), normals[ends], even_m, smooth_m)
    inner = places_m[1:-1]
    if len(inner):
        distance_m, outward = surface.signed_distance_and_outward(inner)
        places_m[1:-1] = inner - distance_m[:, None] * outward
    places_m[ends], beams = corners_m[ends], _tilted(along, _unit(beams), most_tilt_rad)
    beams[ends] = normals[ends]
    steps_m = np.linalg.norm(np.diff(places_m, axis=0), axis=1)
    return SurfaceWay(
        places_m=places_m,
        beams=beams,
        along_m=np.concatenate([[0.0], np.cumsum(steps_m)]),
    )


def _between(
    at: NDArray[np.float64], knots: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values between knots, straight, shape (K, 3)."""
    return np.column_stack([np.interp(at, knots, column) for column in values.T])


def _averaged(
    values: NDArray[np.float64], along_m: NDArray[np.float64], half_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean of the values within a window about each place, which is cut off at both ends, shape (K, 3)."""
    first = np.searchsorted(along_m, along_m - half_m - 1e-9)
    last = np.searchsorted(along_m, along_m + half_m + 1e-9, side="right")
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    return (sums[last] - sums[first]) / (last - first)[:, None]


def _to_ends(
    values: NDArray[np.float64], ends: NDArray[np.float64], along_m: NDArray[np.float64], within_m: float
) -> NDArray[np.float64]:
    """Values that come evenly, over a part of the way, to what they shall be at both ends, shape (K, 3)."""
    within_m = max(min(within_m, float(along_m[-1])), 1e-9)
    moved = values.copy()
    for row, away_m in ((0, along_m), (-1, along_m[-1] - along_m)):
        share = np.maximum(1.0 - away_m / within_m, 0.0)
        moved += share[:, None] * (ends[row] - values[row])
    return moved


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _tilted(normals: NDArray[np.float64], beams: NDArray[np.float64], most_rad: float) -> NDArray[np.float64]:
    """Beams turned back towards the normals until none is farther from its own than an angle, shape (K, 3)."""
    cosine = np.clip(np.einsum("ij,ij->i", normals, beams), -1.0, 1.0)
    is_over = np.arccos(cosine) > most_rad
    side = _unit(beams - cosine[:, None] * normals)
    limited = np.cos(most_rad) * normals + np.sin(most_rad) * side
    return np.where(is_over[:, None], limited, beams)
