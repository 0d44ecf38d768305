"""How far an arm got along the path that it follows, and when it last got on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .timed_path import TimedPath


class Progress:
    """The farthest sample of a path that an arm came near to, so that it gets on only so many times."""

    def __init__(self, path: TimedPath, now_s: float) -> None:
        """Begin before the first sample.

        Args:
            path: What is followed.
            now_s: The time [s].
        """
        self._q, self._row, self.since_s = path.q, -1, now_s

    def see(self, q: NDArray[np.float64], now_s: float) -> None:
        """Note where the joints are at a time [s]; `since_s` becomes that time where they got on."""
        row = int(np.argmin(np.abs(self._q - q).max(axis=1)))
        if row > self._row:
            self._row, self.since_s = row, now_s
