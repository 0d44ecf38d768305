"""A lattice of points aligned with the axes: the hinges of the features, or the points where a map is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Lattice:
    """Points x_i, y_j, z_k on three axes, listed in C order: x slowest, z fastest."""

    axes_m: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    """Coordinates along x, y and z [m], each strictly increasing."""

    def __post_init__(self) -> None:
        """Checks the axes and keeps read-only copies of them."""
        if len(self.axes_m) != 3:
            raise ValueError(f"a lattice has three axes (x, y, z), but {len(self.axes_m)} were given")
        axes = tuple(np.array(axis, dtype=np.float64) for axis in self.axes_m)
        for name, axis in zip("xyz", axes, strict=True):
            _check_axis(name, axis)
            axis.setflags(write=False)
        object.__setattr__(self, "axes_m", axes)

    @classmethod
    def from_box(cls, low_m: ArrayLike, high_m: ArrayLike, *, spacing_m: float) -> Lattice:
        """The lattice of a fixed spacing that is centred in a box.

        Args:
            low_m: Lowest corner of the box [m], shape (3,).
            high_m: Highest corner of the box [m], shape (3,).
            spacing_m: Distance between neighbours along each axis [m]; the points on each side reach to
                within half a spacing of the box's faces.

        Raises:
            ValueError: If the box is empty or the spacing is not positive.
        """
        low, high = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
        if low.shape != (3,) or high.shape != (3,) or not np.all(np.isfinite([low, high])):
            raise ValueError(f"a box needs two finite corners of shape (3,), not {low_m!r} and {high_m!r}")
        if not np.all(high >= low):
            raise ValueError(f"the box's high corner {high} must not lie below its low corner {low}")
        if not (np.isfinite(spacing_m) and spacing_m > 0):
            raise ValueError(f"spacing_m must be positive, not {spacing_m}")
        # The relative slack lets 180 mm hold 16 steps of 11.25 mm in spite of rounding.
        n_steps = np.floor((high - low) / spacing_m + 1e-6).astype(int)
        start = (low + high - n_steps * spacing_m) / 2
        x, y, z = (start[d] + spacing_m * np.arange(n_steps[d] + 1) for d in range(3))
        return cls((x, y, z))

    @classmethod
    def from_counts(cls, low_m: ArrayLike, high_m: ArrayLike, *, counts: tuple[int, int, int]) -> Lattice:
        """The lattice whose outermost points are the corners of a box.

        Args:
            low_m: Lowest corner of the box [m], shape (3,).
            high_m: Highest corner of the box [m], shape (3,).
            counts: Number of points along x, y and z.
        """
        low, high = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
        x, y, z = (np.linspace(low[d], high[d], counts[d]) for d in range(3))
        return cls((x, y, z))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of points along x, y and z."""
        x, y, z = self.axes_m
        return (x.size, y.size, z.size)

    @property
    def n_points(self) -> int:
        """Number of points of the lattice."""
        return int(np.prod(self.shape))

    def points_m(self) -> NDArray[np.float64]:
        """All points [m], shape (n_points, 3), x slowest."""
        return np.stack(np.meshgrid(*self.axes_m, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class MaskedLattice:
    """The points of a lattice that a mask keeps, in C order: those that a map answers for."""

    lattice: Lattice
    """All points."""
    mask: NDArray[np.bool_] | None = None
    """Which of them are kept, shape (lattice.n_points,); all if None."""

    def __post_init__(self) -> None:
        """Checks the mask and keeps a read-only copy of it.

        Raises:
            ValueError: If it does not fit the lattice or keeps nothing.
        """
        if self.mask is None:
            return
        mask = np.array(self.mask, dtype=bool)
        if mask.shape != (self.lattice.n_points,) or not mask.any():
            raise ValueError(
                f"query_mask must keep some of {self.lattice.n_points} points; it has shape {mask.shape}"
            )
        mask.setflags(write=False)
        object.__setattr__(self, "mask", mask)

    def kept(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """What values at all points, shape (..., lattice.n_points), are at those that the mask keeps."""
        return values if self.mask is None else values[..., self.mask]

    def points_m(self) -> NDArray[np.float64]:
        """The points that the mask keeps [m], shape (N, 3)."""
        points = self.lattice.points_m()
        return points if self.mask is None else points[self.mask]

    def part(self, low_m: ArrayLike, high_m: ArrayLike) -> tuple[MaskedLattice, NDArray[np.intp]] | None:
        """The part that lies in a box, and where its points stand among all that the mask keeps; None if it is empty.

        Args:
            low_m: Lowest corner of the box [m], shape (3,).
            high_m: Highest corner of the box [m], shape (3,).
        """
        low, high = np.asarray(low_m), np.asarray(high_m)
        within = [(a >= low[d]) & (a <= high[d]) for d, a in enumerate(self.lattice.axes_m)]
        is_kept = np.ones(self.lattice.n_points, dtype=bool) if self.mask is None else self.mask
        place = np.where(is_kept, np.cumsum(is_kept) - 1, -1).reshape(self.lattice.shape)
        place = place[np.ix_(*within)].ravel()
        if not (place >= 0).any():
            return None
        x, y, z = (axis[keep] for axis, keep in zip(self.lattice.axes_m, within, strict=True))
        return MaskedLattice(Lattice((x, y, z)), place >= 0), place[place >= 0]


def _check_axis(name: str, axis: NDArray[np.float64]) -> None:
    if axis.ndim != 1 or axis.size == 0:
        raise ValueError(f"axis {name} must be a non-empty list of coordinates, not of shape {axis.shape}")
    if not np.all(np.isfinite(axis)) or np.any(np.diff(axis) <= 0):
        raise ValueError(f"axis {name} must be finite and strictly increasing, not {axis}")


def check_points(points_m: ArrayLike) -> NDArray[np.float64]:
    """Points as a float array of shape (N, 3).

    Raises:
        ValueError: If the shape is not (N, 3) or a coordinate is not finite.
    """
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points_m must have shape (N, 3), not {points.shape}")
    if not np.all(np.isfinite(points)):
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ValueError(f"points_m must be finite, but point {bad} is {points[bad]}")
    return points


def lattice_state(name: str, lattice: Lattice) -> dict[str, NDArray]:
    """The axes of a lattice as arrays of a file."""
    return {f"{name}_{letter}_m": axis for letter, axis in zip("xyz", lattice.axes_m, strict=True)}


def lattice_from(state: Mapping[str, NDArray], name: str) -> Lattice:
    """The lattice whose arrays `lattice_state` gave under a name."""
    return Lattice((state[f"{name}_x_m"], state[f"{name}_y_m"], state[f"{name}_z_m"]))
