"""How far vessels and other structures are from the tumours and from the bodies of a second class, mapped and true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import generate_binary_structure, label

from mapping import Prediction
from sim.episode.episode import Episode
from sim.episode.setup import Setup
from sim.record.map_field import called_from
from sim.world.anatomy.structures import Structure
from sim.world.solids.solid import Solid

LEAST_CELLS = 2
"""Points of the lattice above the threshold that make a mapped tumour: a single one has no extent."""


@dataclass(frozen=True, eq=False)
class _Body:
    """A tumour, or a body of the second class."""

    kind: str
    """`mapped` or `true`."""
    number: int
    """Number among the bodies of its class and kind, from 1."""
    points_m: NDArray[np.float64]
    """Points of it [m, world], shape (K, 3)."""
    volume_m3: float


def distance_rows(episode: Episode, prior_prevalence: float) -> list[dict[str, Any]]:
    """The rows of structures.csv, one for each structure and tumour: first the mapped tumours by size, then the true.

    A mapped tumour is a connected piece of the lattice that the map calls tumour, by the rule of the findings
    (`called_from`). Its distance is that of its nearest point, so it is known to half a step of the lattice. Where a
    second class is mapped, its bodies have rows too, which leave the column `tumour` empty and fill `target` and
    `target_name` in its place.

    Args:
        episode: The episode after its last step.
        prior_prevalence: Share of the organ that the map expected to be tumour before anything was sensed.
    """
    setup, target = episode.setup, episode.target
    if not setup.structures:
        return []
    no_target = {} if target is None else {"target": None, "target_name": None}
    threshold = called_from(prior_prevalence)
    tumours = _bodies(setup, threshold, episode.prediction, episode.truth.anatomy.tumours)
    bodies = [(each, {"tumour": each.kind, **no_target}) for each in tumours]
    if target is not None:
        named = {"tumour": None, "target": None, "target_name": target.name}
        targets = _bodies(setup, threshold, target.prediction, target.truth.anatomy.tumours)
        bodies += [(each, named | {"target": each.kind}) for each in targets]
    return [_row(structure, body, classes) for structure in setup.structures for body, classes in bodies]


def _bodies(
    setup: Setup, threshold: float, prediction: Prediction | None, true: Sequence[Solid]
) -> list[_Body]:
    """The bodies of a class, the mapped ones first."""
    mapped = [
        _Body("mapped", i, *each) for i, each in enumerate(_mapped(setup, threshold, prediction), start=1)
    ]
    return mapped + [
        _Body("true", i, each.vertices_m, each.volume_m3) for i, each in enumerate(true, start=1)
    ]


def _row(structure: Structure, body: _Body, classes: dict[str, str | None]) -> dict[str, Any]:
    return {
        "structure": structure.name,
        "is_keepout": structure.is_keepout,
        **classes,
        "number": body.number,
        "volume_m3": body.volume_m3,
        "distance_m": float(structure.distance_m(body.points_m).min()),
    }


def _mapped(
    setup: Setup, threshold: float, prediction: Prediction | None
) -> list[tuple[NDArray[np.float64], float]]:
    """The points [m] and the volume [m^3] of each body of a map, the largest first."""
    if prediction is None:
        return []
    is_called = setup.on_lattice(prediction.probability > threshold, outside=False)
    pieces = np.empty(setup.query.shape, dtype=np.int32)
    label(is_called, structure=generate_binary_structure(3, 3), output=pieces)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    cell_m3 = float(np.prod([np.diff(axis).mean() for axis in setup.query.axes_m]))
    numbers = [number for number in np.argsort(-sizes, kind="stable") if sizes[number] >= LEAST_CELLS]
    points_m, of_piece = setup.query.points_m(), pieces.ravel()
    return [(points_m[of_piece == number], float(sizes[number] * cell_m3)) for number in numbers]
