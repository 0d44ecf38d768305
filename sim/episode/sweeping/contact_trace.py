"""The trace of a sweep: the pieces of the tip's way that lie on the organ, and when each was gone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..moving.motion import Motion, Phase

N_PIECES, MOST_PIECES = 40, 1200
"""Pieces in which the way of an action is told, and about how many there are in all: pictures have room for no more."""


@dataclass(frozen=True, eq=False)
class Trace:
    """The way on the organ of one action, in Q pieces, the oldest first."""

    pieces_m: NDArray[np.float64]
    """Where each begins and ends [m], shape (Q, 2, 3)."""
    end_s: NDArray[np.float64]
    """When each was gone, since the action began [s], shape (Q,)."""


def traces_of(motions: Sequence[Motion], tips_m: Sequence[NDArray[np.float64]] | None = None) -> list[Trace]:
    """The traces of the motions of all actions, told the more coarsely the more there are.

    Args:
        motions: In order.
        tips_m: Where the tip of each was as seen from the organ [m], shape (T, 3); None where it lies as planned.
    """
    n_pieces = min(N_PIECES, max(2, MOST_PIECES // max(len(motions), 1)))
    seen_m = [motion.tips_m for motion in motions] if tips_m is None else tips_m
    return [trace_of(motion, tips, n_pieces) for motion, tips in zip(motions, seen_m, strict=True)]


def trace_of(motion: Motion, tips_m: NDArray[np.float64] | None = None, n_pieces: int = N_PIECES) -> Trace:
    """The trace of a motion, without pieces where nothing slid.

    Args:
        motion: The motion of one action.
        tips_m: Where its tip was as seen from the organ [m], shape (T, 3); None where the organ lies as planned.
        n_pieces: About how many pieces.
    """
    tips_m = motion.tips_m if tips_m is None else tips_m
    is_on = motion.phases == int(Phase.SWEEP)
    on = np.flatnonzero(is_on)
    if not len(on):
        return Trace(np.empty((0, 2, 3)), np.empty(0))
    rows = np.unique(np.append(on[:: max(1, -(-len(on) // n_pieces))], on[-1]))
    off = np.cumsum(~is_on)
    # Two slides of one action are joined by a flight, which is none of the trace.
    lies_on = off[rows[:-1]] == off[rows[1:]]
    pieces_m = np.stack([tips_m[rows[:-1]], tips_m[rows[1:]]], axis=1)
    return Trace(pieces_m[lies_on], motion.time_s[rows[1:]][lies_on])
