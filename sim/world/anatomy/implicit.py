"""Implicit solids: fields that are negative inside, and smooth ways of joining and cutting them.

All fields are close to signed distances near their zero level. The smooth joins are the polynomial ones of
Quilez (https://iquilezles.org/articles/smin), with a rounding length `k` in the unit of the field.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Field = NDArray[np.floating]
Coordinates = tuple[Field, Field, Field]


def smooth_union(a: Field, b: Field, k: float) -> Field:
    """Field of the union of two solids, the seam filled over a length k."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0.0, 1.0)
    return b + (a - b) * h - k * h * (1.0 - h)


def smooth_cut(a: Field, b: Field, k: float) -> Field:
    """Field of solid a without solid b, the edge rounded over a length k."""
    return -smooth_union(-a, b, k)


def smooth_intersection(a: Field, b: Field, k: float) -> Field:
    """Field of what two solids share, the edge rounded over a length k."""
    return -smooth_union(-a, -b, k)


def ellipsoid(at: Coordinates, centre: ArrayLike, radii: ArrayLike, axes: ArrayLike | None = None) -> Field:
    """Field of an ellipsoid.

    Args:
        at: Coordinates, three arrays that broadcast.
        centre: Its centre, shape (3,).
        radii: Its half-axes, shape (3,).
        axes: Unit vectors of the half-axes as columns, shape (3, 3); the coordinate axes by default.

    Returns:
        Distance to the surface to first order, negative inside.
    """
    c, r = np.asarray(centre, dtype=np.float32), np.asarray(radii, dtype=np.float32)
    local = [at[i] - c[i] for i in range(3)]
    if axes is not None:
        turn = np.asarray(axes, dtype=np.float32)
        local = [sum((turn[j, i] * local[j] for j in range(3)), start=np.float32(0.0)) for i in range(3)]
    scaled = np.sqrt(sum((local[i] / r[i]) ** 2 for i in range(3)))
    slope = np.sqrt(sum((local[i] / r[i] ** 2) ** 2 for i in range(3)))
    # At the centre the limit depends on the direction: the shortest half-axis is taken.
    at_centre = slope < 1e-9
    length = np.where(at_centre, r.min(), scaled / np.where(at_centre, 1.0, slope))
    return np.asarray((scaled - 1.0) * length, dtype=np.float32)


def capsule(at: Coordinates, start: ArrayLike, end: ArrayLike, radii: tuple[float, float]) -> Field:
    """Field of a round bar from start to end, its radius going from the first to the second of `radii`."""
    along, across = _along_segment(at, start, end)
    return across - (radii[0] + along * (radii[1] - radii[0]))


def half_space(at: Coordinates, normal: ArrayLike, offset: float) -> Field:
    """Field of the half-space n . x > offset, n made a unit vector: negative beyond the plane."""
    n = np.asarray(normal, dtype=np.float32)
    n = n / np.linalg.norm(n)
    return np.asarray(offset - (n[0] * at[0] + n[1] * at[1] + n[2] * at[2]), dtype=np.float32)


def plan_distance(at: Coordinates, start: ArrayLike, end: ArrayLike) -> tuple[Field, Field]:
    """Seen along z: how far along a segment each point is (0 to 1), and its distance from the segment."""
    flat = (at[0], at[1], np.zeros((1, 1, 1), dtype=np.float32))
    return _along_segment(flat, [*np.asarray(start)[:2], 0.0], [*np.asarray(end)[:2], 0.0])


def waves(
    axes: tuple[Field, Field, Field], rng: np.random.Generator, *, n: int, lengths: tuple[float, float]
) -> Field:
    """A smooth random field of unit variance on a lattice: plane waves of random direction, length and phase.

    A plane wave is a product of one factor per axis, so the sum of all is one matrix product.

    Args:
        axes: The lattice's ticks, each a flat array or one that broadcasts over the lattice.
        rng: Source of the waves.
        n: Number of waves.
        lengths: Shortest and longest wave length, in the unit of the axes.

    Returns:
        One value per lattice node, shape (nx, ny, nz).
    """
    directions = rng.normal(size=(n, 3))
    directions *= 2.0 * np.pi / np.linalg.norm(directions, axis=1, keepdims=True)
    directions /= rng.uniform(*lengths, size=(n, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, n)
    x, y, z = (np.exp(1j * np.outer(directions[:, i], axes[i].ravel())) for i in range(3))
    y_z = (y * np.exp(1j * phases)[:, None])[:, :, None] * z[:, None, :]
    total = x.T.astype(np.complex64) @ y_z.reshape(n, -1).astype(np.complex64)
    shape = tuple(axis.size for axis in axes)
    return np.asarray(total.real.reshape(shape) * np.float32(np.sqrt(2.0 / n)))


def _along_segment(at: Coordinates, start: ArrayLike, end: ArrayLike) -> tuple[Field, Field]:
    """How far along a segment each point is (0 to 1), and its distance from the segment."""
    a, b = np.asarray(start, dtype=np.float32), np.asarray(end, dtype=np.float32)
    direction = b - a
    squared = max(float(direction @ direction), 1e-9)
    local = [at[i] - a[i] for i in range(3)]
    along = np.clip(sum(local[i] * direction[i] for i in range(3)) / squared, 0.0, 1.0)
    across = np.sqrt(sum((local[i] - along * direction[i]) ** 2 for i in range(3)))
    return np.asarray(along, dtype=np.float32), np.asarray(across, dtype=np.float32)
