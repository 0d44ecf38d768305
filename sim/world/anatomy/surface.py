"""The sensing surface: positions on an organ with inward normals, where a probe may be pressed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from sim.world.errors import MeshError
from sim.world.solids.solid import Solid

N_NEIGHBOURS = 10
"""Neighbours to which the tangent plane is fitted, as in the paper."""

MAX_TILT_RAD = np.deg2rad(60.0)
"""A face counts as upper if its outward normal is this close to +z: an arm above can hardly press others."""

LEAN_RAD = np.deg2rad(1.0)
"""A fitted plane that is steeper than the limit by no more leans back to it: planes are fitted to some degrees."""

LIFT_M = 1e-6
"""How far above the face the view towards +z starts [m], so that the face does not hide itself."""

CANDIDATES_PER_POSE = 12
"""Random surface points drawn per pose that is wanted; an even choice of them is kept."""

DISC_CONSTANT = 0.70
"""First guess of n r^2 / area for random points at least r apart: discs of r/2 then cover 0.547."""


@dataclass(frozen=True, eq=False)
class SensingSurface:
    """Positions on an organ's surface and inward unit normals. Arrays are copied and read-only.

    Attributes:
        positions_m: Positions [m], shape (N, 3).
        normals: Inward unit normals, shape (N, 3).
        grid_shape: (rows, columns) if the positions form a grid in C order, else None.
    """

    positions_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    grid_shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Freezes copies of the arrays.

        Raises:
            ValueError: The shapes disagree.
        """
        for name in ("positions_m", "normals"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.positions_m.ndim != 2 or self.positions_m.shape[1] != 3:
            raise ValueError(f"positions_m has shape {self.positions_m.shape}, expected (N, 3)")
        if self.normals.shape != self.positions_m.shape:
            raise ValueError(f"normals has shape {self.normals.shape}, expected {self.positions_m.shape}")
        if self.grid_shape is not None and self.grid_shape[0] * self.grid_shape[1] != len(self.positions_m):
            raise ValueError(f"grid_shape={self.grid_shape} does not hold {len(self.positions_m)} positions")

    @property
    def n_poses(self) -> int:
        """Number of positions."""
        return len(self.positions_m)

    def transformed(self, T_target_surface: ArrayLike) -> "SensingSurface":
        """The surface moved by a rigid motion, 4 x 4, that maps its coordinates to the target frame."""
        T = np.asarray(T_target_surface, dtype=np.float64)
        positions_m = self.positions_m @ T[:3, :3].T + T[:3, 3]
        return SensingSurface(positions_m, self.normals @ T[:3, :3].T, self.grid_shape)


def upper_surface_workspace(
    solid: Solid,
    n_poses: int = 5000,
    *,
    rng: np.random.Generator,
    max_tilt_rad: float = MAX_TILT_RAD,
) -> SensingSurface:
    """Even positions on the part of a surface that faces up and is seen from above, with inward normals.

    A face belongs to it if its outward normal is within `max_tilt_rad` of +z and nothing of the solid is
    above it. Positions are a Poisson-disc sample: random points of that part, in random order, each kept if
    no kept one is near. Normals are those of planes fitted to neighbours, and the limit holds for them as well: a
    position whose plane is steeper, as at a rim or on a knob, is left out.

    Args:
        solid: The organ, in a frame with z up.
        n_poses: Number of positions wanted; the result has within a few per cent of it, and fewer on a rough surface.
        rng: Source of the draws.
        max_tilt_rad: Largest angle between an outward normal and +z [rad], in (0, pi/2].

    Returns:
        The positions and inward unit normals.

    Raises:
        ValueError: `n_poses` or `max_tilt_rad` out of range.
        MeshError: No face is upper, or all planes are steeper than the limit.
    """
    if n_poses < N_NEIGHBOURS + 1:
        raise ValueError(f"n_poses={n_poses} must be at least {N_NEIGHBOURS + 1}, for normals to be fitted")
    if not 0.0 < max_tilt_rad <= np.pi / 2:
        raise ValueError(f"max_tilt_rad={max_tilt_rad} must be above 0 and at most pi/2")
    candidates_m, faces, area_m2 = _strew_upper(solid, CANDIDATES_PER_POSE * n_poses, max_tilt_rad, rng)
    spacing_m = np.sqrt(DISC_CONSTANT * area_m2 / n_poses)
    kept = thin_to_spacing(candidates_m, spacing_m)
    # The constant was a guess; what it led to tells the spacing.
    kept = thin_to_spacing(candidates_m, spacing_m * np.sqrt(len(kept) / n_poses))
    positions_m = candidates_m[kept]
    if len(positions_m) < N_NEIGHBOURS + 1:
        raise MeshError(
            f"only {len(positions_m)} positions fit on {area_m2 * 1e6:.3g} mm^2 of surface; ask for more"
        )
    inward = -solid.face_normals()[faces[kept]]
    normals, is_kept = held_to_tilt(fit_normals(positions_m, inward), max_tilt_rad)
    if not is_kept.any():
        raise MeshError(
            f"the surface is too rough for a pose: about each position it tilts by more than "
            f"{np.rad2deg(max_tilt_rad):.3g} degrees; smooth the mesh, turn the organ, or ask for more poses"
        )
    return SensingSurface(positions_m[is_kept], normals[is_kept])


def held_to_tilt(
    normals: NDArray[np.float64], max_tilt_rad: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Inward normals, of which those a little too steep lean back to a limit, and which poses are to be kept.

    Args:
        normals: Inward unit normals, shape (N, 3).
        max_tilt_rad: Largest angle between a normal and -z [rad].

    Returns:
        The normals, shape (N, 3), and which are within the limit, shape (N,).
    """
    tilt_rad = np.arctan2(np.hypot(normals[:, 0], normals[:, 1]), -normals[:, 2])
    held = normals.copy()
    leaning = (tilt_rad > max_tilt_rad) & (tilt_rad <= max_tilt_rad + LEAN_RAD)
    flat = normals[leaning, :2] / np.linalg.norm(normals[leaning, :2], axis=1, keepdims=True)
    held[leaning, :2] = flat * np.sin(max_tilt_rad)
    held[leaning, 2] = -np.cos(max_tilt_rad)
    return held, tilt_rad <= max_tilt_rad + LEAN_RAD


def upper_surface_area_m2(
    solid: Solid, rng: np.random.Generator, *, max_tilt_rad: float = MAX_TILT_RAD, n_points: int = 2000
) -> float:
    """Area [m^2] of the part of a surface that faces up and is seen from above; 0 where there is none.

    Args:
        solid: The organ, in a frame with z up.
        rng: Source of the points by which the hidden share is judged.
        max_tilt_rad: Largest angle between a face's outward normal and +z [rad].
        n_points: Number of these points.
    """
    try:
        return _strew_upper(solid, n_points, max_tilt_rad, rng)[2]
    except MeshError:
        return 0.0


def fit_normals(positions_m: NDArray[np.float64], toward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of the planes fitted to each position and its 10 nearest neighbours.

    Args:
        positions_m: Positions [m], shape (N, 3), N > 10.
        toward: A vector per position, shape (N, 3); the normal's sign is chosen to agree with it.

    Returns:
        Shape (N, 3).
    """
    neighbours = KDTree(positions_m).query(positions_m, k=N_NEIGHBOURS + 1)[1]
    patches = positions_m[neighbours]
    centred = patches - patches.mean(axis=1, keepdims=True)
    scatter = np.einsum("nki,nkj->nij", centred, centred)
    # The first eigenvector is the direction of least spread.
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    return np.where(np.einsum("ij,ij->i", normals, toward)[:, None] < 0.0, -normals, normals)


def thin_to_spacing(points_m: NDArray[np.float64], spacing_m: float) -> NDArray[np.int64]:
    """Indices of a maximal subset with no two points closer than a spacing, earlier points first.

    Args:
        points_m: Points [m], shape (N, 3), in the order in which they may be kept.
        spacing_m: Least distance between kept points [m].

    Returns:
        Sorted indices.
    """
    pairs = KDTree(points_m).query_pairs(spacing_m, output_type="ndarray")
    order = np.argsort(pairs[:, 0], kind="stable")
    later = pairs[order, 1]
    start = np.searchsorted(pairs[order, 0], np.arange(len(points_m) + 1))
    is_free = np.ones(len(points_m), dtype=bool)
    for i in range(len(points_m)):
        if is_free[i]:
            is_free[later[start[i] : start[i + 1]]] = False
    return np.flatnonzero(is_free)


def _strew_upper(
    solid: Solid, n_candidates: int, max_tilt_rad: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Random points, even in area, on the upper visible surface; their faces; that surface's area [m^2]."""
    upward = solid.face_normals()[:, 2]
    areas_m2 = np.where(upward >= np.cos(max_tilt_rad) - 1e-12, solid.face_areas_m2(), 0.0)
    total_m2 = float(areas_m2.sum())
    if total_m2 == 0.0:
        raise MeshError(
            f"no face points up within {np.rad2deg(max_tilt_rad):.3g} degrees; turn the organ or the limit"
        )
    cumulative = np.cumsum(areas_m2)
    drawn = np.searchsorted(cumulative, rng.uniform(0.0, total_m2, n_candidates), side="right")
    faces = np.minimum(drawn, len(areas_m2) - 1)
    u, v = rng.uniform(size=(2, n_candidates))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    a, b, c = (solid.vertices_m[solid.faces[faces, i]] for i in range(3))
    points_m = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    is_seen = solid.is_open_above(points_m + solid.face_normals()[faces] * LIFT_M)
    if not is_seen.any():
        raise MeshError("nothing of the surface can be seen from above; is the mesh inside out?")
    return points_m[is_seen], faces[is_seen], total_m2 * float(is_seen.mean())
