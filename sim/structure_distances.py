"""How far vessels and other structures are from the tumours: those that the map shows, and the true ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import generate_binary_structure, label

from .episode import Episode
from .map_volumes import THRESHOLD
from .world.structures import Structure

LEAST_CELLS = 2
"""Points of the lattice above the threshold that make a mapped tumour: a single one has no extent."""


def distance_rows(episode: Episode) -> list[dict[str, Any]]:
    """A row for each structure and tumour: `mapped` ones, the largest first, and `true` ones.

    A mapped tumour is a connected piece of the lattice where the probability is above one half, and its distance that
    of its nearest point; so it is known to half a step of the lattice.
    """
    stage = episode.stage
    rows = []
    for structure in stage.structures:
        mapped = [_row(structure, "mapped", i, *each) for i, each in enumerate(_mapped(episode), start=1)]
        true = [
            _row(structure, "true", i, tumour.vertices_m, tumour.volume_m3)
            for i, tumour in enumerate(episode.truth.anatomy.tumours, start=1)
        ]
        rows += [*mapped, *true]
    return rows


def _row(
    structure: Structure, kind: str, number: int, points_m: NDArray[np.float64], volume_m3: float
) -> dict[str, Any]:
    return {
        "structure": structure.name,
        "is_keepout": structure.is_keepout,
        "tumour": kind,
        "number": number,
        "volume_m3": volume_m3,
        "distance_m": float(structure.distance_m(points_m).min()),
    }


def _mapped(episode: Episode) -> list[tuple[NDArray[np.float64], float]]:
    """Points [m] and volume [m^3] of each tumour of the map, the largest first."""
    stage, prediction = episode.stage, episode.prediction
    if prediction is None:
        return []
    is_likely = np.zeros(stage.query.n_points, dtype=bool)
    is_likely[stage.is_inside] = prediction.probability > THRESHOLD
    pieces = np.empty(stage.query.shape, dtype=np.int32)
    label(is_likely.reshape(stage.query.shape), structure=generate_binary_structure(3, 3), output=pieces)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    cell_m3 = float(np.prod([np.diff(axis).mean() for axis in stage.query.axes_m]))
    numbers = [number for number in np.argsort(-sizes, kind="stable") if sizes[number] >= LEAST_CELLS]
    points_m, of_piece = stage.query.points_m(), pieces.ravel()
    return [(points_m[of_piece == number], float(sizes[number] * cell_m3)) for number in numbers]
