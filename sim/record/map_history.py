"""The history of a map: its log-odds after each action in a byte a point, so that a report can move through them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import UsageError

from .run_folder import RunFolder

FOLDER = "maps"
TUMOURS, TARGETS = "log_odds", "target_log_odds"
"""Arrays of a file: the map of the tumours, and that of a second class where there is one."""
LOG_ODDS_STEP = 0.05
"""Log-odds of one step of the byte: a probability near 0.5 is kept to 0.6 %, and the ends are 0.2 % and 99.8 %."""
MOST_STEPS = 127
"""Steps to either side of 0 that the byte holds."""
N_KEPT = 200
"""The map is kept after every action up to this one, then after each tenth: thousands of maps would fill a disk."""
STRIDE = 10
"""Actions from one kept map to the next, after the first `N_KEPT`."""


def write_history(
    folder: RunFolder, step: int, log_odds: ArrayLike, target_log_odds: ArrayLike | None = None
) -> None:
    """Write the map after an action to maps/<step>.npz, unless the action is among those left out.

    Args:
        folder: The run's folder.
        step: The action, from 0 (before the first).
        log_odds: Log-odds of the probability at the search points, shape (M,).
        target_log_odds: The same for the map of a second class, where there is one.
    """
    if step <= N_KEPT or step % STRIDE == 0:
        maps = {TUMOURS: to_bytes(log_odds)}
        if target_log_odds is not None:
            maps[TARGETS] = to_bytes(target_log_odds)
        folder.write_arrays(f"{FOLDER}/{step:05d}.npz", compressed=True, **maps)


def read_history(folder: Path, of: str = TUMOURS) -> dict[int, NDArray[np.float32]]:
    """The log-odds at the search points by action, in order; empty where no map was kept.

    Args:
        folder: The run's folder.
        of: Which map: `TUMOURS` or `TARGETS`.

    Raises:
        UsageError: A file is broken.
    """
    files = sorted((folder / FOLDER).glob("*.npz"))
    return {int(file.stem): _read(file, of) for file in files if file.stem.isdecimal()}


def to_bytes(log_odds: ArrayLike) -> NDArray[np.int8]:
    """Log-odds as bytes, shape kept."""
    steps = np.rint(np.asarray(log_odds, dtype=np.float64) / LOG_ODDS_STEP)
    return np.clip(steps, -MOST_STEPS, MOST_STEPS).astype(np.int8)


def from_bytes(steps: NDArray[np.int8]) -> NDArray[np.float32]:
    """Bytes as log-odds, shape kept."""
    return steps.astype(np.float32) * np.float32(LOG_ODDS_STEP)


def _read(file: Path, of: str) -> NDArray[np.float32]:
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return from_bytes(arrays[of])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise UsageError(f"{file}: cannot be read ({error}). Remove it, or run the episode again.") from error
