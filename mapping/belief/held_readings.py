"""The readings that a belief holds, as it took them in, and their arrays in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..likelihood import Evidence
from ..storage import checked_array, split_by_counts


@dataclass(frozen=True, eq=False)
class HeldReading:
    """A reading that the belief holds, and how: lambda and the expected label of each of its n points."""

    points_m: NDArray[np.float64]
    """Sensed points [m], shape (n, 3)."""
    offset: NDArray[np.float64]
    """The latent's offset b at each point, shape (n,)."""
    evidence: Evidence
    """What the n labels say of their points."""
    curvature: NDArray[np.float64]
    """lambda with which the belief holds each point, shape (n,)."""
    labels: NDArray[np.float64]
    """Expected true label of each point, shape (n,)."""


def held_state(held: Sequence[HeldReading]) -> dict[str, NDArray]:
    """The arrays of readings, one below another, and how many points each has."""
    points_m = [reading.points_m for reading in held]
    parts = {
        "offset": [reading.offset for reading in held],
        "log_odds": [reading.evidence.log_odds for reading in held],
        "curvature": [reading.curvature for reading in held],
        "labels": [reading.labels for reading in held],
    }
    values = {name: np.concatenate([np.empty(0), *arrays]) for name, arrays in parts.items()}
    weight = np.concatenate([np.empty(0), *(reading.evidence.weight for reading in held)])
    if np.any(weight != 1.0):
        values["weight"] = weight
    return {
        "held_counts": np.array([len(points) for points in points_m], dtype=np.int64),
        "held_points_m": np.concatenate([np.empty((0, 3)), *points_m]),
        **{f"held_{name}": array for name, array in values.items()},
    }


def held_from(state: Mapping[str, NDArray]) -> list[HeldReading]:
    """The readings whose arrays `held_state` gave.

    Raises:
        KeyError: If an array is missing.
        ValueError: If arrays do not fit together or hold what is no number.
    """
    n = len(state["held_offset"])
    points_m = checked_array(state, "held_points_m", (n, 3))
    # The log odds of a label that cannot be wrong are infinite.
    log_odds = checked_array(state, "held_log_odds", (n,), is_finite=False)
    offset, curvature, labels = (
        checked_array(state, f"held_{name}", (n,)) for name in ("offset", "curvature", "labels")
    )
    # Files of readings whose points all count in full hold no weights.
    weight = checked_array(state, "held_weight", (n,)) if "held_weight" in state else np.ones(n)
    return [
        HeldReading(
            points_m[rows],
            offset[rows],
            Evidence(log_odds[rows], weight[rows]),
            curvature[rows],
            labels[rows],
        )
        for rows in split_by_counts(state, "held_counts", n, least=1)
    ]
