"""The files of the bound on every policy: blocks of places, and the dual weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import UsageError

from .folder import read_arrays, write_arrays
from .places import Place

POLICY = "policy.npz"
PLACE_FOLDER = "places"
BLOCK = 50
"""Places in a file."""


def blocks(first_place: int, n_places: int) -> list[range]:
    """The seeds of the places, block by block."""
    end = first_place + n_places
    return [range(first, min(first + BLOCK, end)) for first in range(first_place, end, BLOCK)]


def block_file(folder: Path, seeds: range) -> Path:
    """The file of a block."""
    return folder / PLACE_FOLDER / f"{seeds.start}-{seeds.stop - 1}.npz"


def write_block(file: Path, places: Sequence[Place]) -> None:
    """Write the places of a block."""
    file.parent.mkdir(exist_ok=True)
    write_arrays(
        file,
        {
            "seed": np.array([place.seed for place in places]),
            "middle_m": np.array([place.middle_m for place in places]),
            "radius_m": np.array([place.radius_m for place in places]),
            "n_poses": np.array([len(place.poses) for place in places]),
            "poses": np.concatenate([place.poses for place in places]),
            "fewest": np.concatenate([place.fewest for place in places]),
            "n_prices": np.array([len(place.prices) for place in places]),
            "prices": np.concatenate([place.prices for place in places]),
            "worth": np.array([place.worth for place in places]),
        },
    )


def read_block(file: Path) -> list[Place]:
    """The places of a block.

    Raises:
        UsageError: The file is missing, damaged, or lacks something.
    """
    arrays = read_arrays(file)
    try:
        poses = _split(arrays["poses"], arrays["n_poses"])
        fewest = _split(arrays["fewest"], arrays["n_poses"])
        prices = _split(arrays["prices"], arrays["n_prices"])
        return [
            Place(
                seed=int(seed),
                middle_m=arrays["middle_m"][index],
                radius_m=float(arrays["radius_m"][index]),
                poses=poses[index].astype(np.int32),
                fewest=fewest[index].astype(np.uint8),
                prices=prices[index].astype(np.float32),
                worth=float(arrays["worth"][index]),
            )
            for index, seed in enumerate(arrays["seed"])
        ]
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise UsageError(f"{file}: is no whole block of places ({error}).") from error


def _split(values: NDArray[Any], counts: NDArray[Any]) -> list[NDArray[Any]]:
    """Values in parts of given lengths."""
    if int(counts.sum()) != len(values):
        raise ValueError(f"{len(values)} values for {int(counts.sum())}")
    return np.split(values, np.cumsum(counts)[:-1])
