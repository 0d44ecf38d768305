"""What a map of tumours is to those who use it: a protocol that one's own class may follow, and the built-in maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .detailed_map import DetailedMap
from .hilbert_map import HilbertMap
from .lattice import Lattice
from .prediction import Prediction
from .settings import DetailSettings, MapSettings
from .storage import DETAILED_MAP, HILBERT_MAP, naming_the_file, read_arrays


@runtime_checkable
class TumourMap(Protocol):
    """A belief over where an organ is occupied by tumour, made for one `MapSpace`.

    Three methods are all that an episode calls. A class needs no base class of ours to have them:

        class Nearest:
            def __init__(self, space):
                self.space, self.points_m, self.labels = space, np.empty((0, 3)), np.empty(0)

            def update(self, points_m, is_occupied):
                self.points_m = np.concatenate([self.points_m, points_m])
                self.labels = np.append(self.labels, is_occupied)

            def predict_lattice(self):
                return Prediction.from_probability(...)

            def save(self, path):
                np.savez(path, points_m=self.points_m, labels=self.labels)

    What the built-in maps offer besides is optional, and whoever uses it says so: `predict(points_m)`, the belief at
    any points; `revise(n_sweeps)`, which fits all readings again; `settle()`, which does what an update has put off;
    `carry_samples(n_samples, rng=...)` and `sample_lattice()`, draws of whole maps; `query_points_m()`, the points of
    the space once more.
    """

    def update(self, points_m: ArrayLike, is_occupied: ArrayLike, /) -> object:
        """Takes in a reading; what it returns is up to the map.

        Args:
            points_m: Sensed points [m, world], shape (n, 3); n may be 0.
            is_occupied: Their labels, shape (n,), True for tumour.
        """
        ...

    def predict_lattice(self) -> Prediction:
        """The belief at the points of the query lattice that lie in the organ, in C order: at `MapSpace.points_m`."""
        ...

    def save(self, path: str | PathLike[str], /) -> None:
        """Writes the map to one file."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class MapSpace:
    """What a map is made for: where it may have hinges, where it is read, and what it assumes."""

    hinges: Lattice
    """Centres of the features; a map without features may leave them unused."""
    hinge_mask: NDArray[np.bool_]
    """Which hinges lie near enough to the organ to be kept, shape (hinges.n_points,)."""
    query: Lattice
    """The lattice on which the map is read."""
    is_inside: NDArray[np.bool_]
    """Which points of the query lattice lie in the organ, shape (query.n_points,)."""
    settings: MapSettings
    """What the map assumes before it has seen anything, the sensor's rates of false labels among it."""
    detail: DetailSettings | None = None
    """How the map answers in detail near sensed tumour; None for a plain Hilbert map."""

    def __post_init__(self) -> None:
        """Checks the masks and keeps read-only copies of them.

        Raises:
            ValueError: If a mask does not fit its lattice or keeps nothing.
        """
        for name, lattice in (("hinge_mask", self.hinges), ("is_inside", self.query)):
            mask = np.array(getattr(self, name), dtype=bool)
            if mask.shape != (lattice.n_points,) or not mask.any():
                raise ValueError(
                    f"{name} must have shape ({lattice.n_points},), one value per point of its lattice, and keep "
                    f"some; it has shape {mask.shape} and keeps {int(mask.sum())}"
                )
            mask.setflags(write=False)
            object.__setattr__(self, name, mask)

    @cached_property
    def points_m(self) -> NDArray[np.float64]:
        """The points [m, world] that a prediction answers for, shape (M, 3), in C order of the query lattice."""
        points_m = self.query.points_m()[self.is_inside]
        points_m.setflags(write=False)
        return points_m


TumourMapFactory = Callable[[MapSpace], TumourMap]
"""What makes a map without readings for a space; a class whose `__init__` takes the space is one."""


def make_hilbert_map(space: MapSpace) -> HilbertMap | DetailedMap:
    """The built-in map of a space, without readings: a Hilbert map; in detail near sensed tumour if the space says how.

    Args:
        space: What the map is made for.
    """
    coarse = HilbertMap(
        space.hinges,
        space.settings,
        query=space.query,
        query_mask=space.is_inside,
        hinge_mask=space.hinge_mask,
    )
    return coarse if space.detail is None else DetailedMap(coarse, space.detail)


def load_map(path: str | PathLike[str]) -> HilbertMap | DetailedMap:
    """The built-in map that a file holds, whichever of the two it is.

    Args:
        path: What `HilbertMap.save` or `DetailedMap.save` wrote.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file is damaged, foreign or of another version; the text names file and reason.
    """
    kind, arrays = read_arrays(Path(path), HILBERT_MAP, DETAILED_MAP)
    with naming_the_file(Path(path)):
        return DetailedMap.from_state(arrays) if kind == DETAILED_MAP else HilbertMap.from_state(arrays)
