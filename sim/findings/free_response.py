"""Free response: what a map would find, and make up, if it called tumour from another probability on.

At each threshold the pieces of the map are made anew, and lesions found and false findings are counted as they always
are, so that the curve goes through the counts of the findings themselves. It need not rise everywhere: where the
threshold falls, false pieces may grow into one another or into a lesion.

The thresholds go from near certainty down to half way, in log-odds, between what the map calls tumour and what it
expects where nothing was sensed. Farther down all that was never sensed would be one piece, which touches every lesion
and finds none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from sim.record.map_field import called_from

from .evidence import Evidence
from .findings import pieces_of

BELOW = (0.5, 0.625, 0.75, 0.875)
"""Thresholds below the map's own, as shares of the way from its prior, in log-odds."""
ABOVE = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
"""The map's own threshold and those above it [log-odds above its own]."""
OWN = len(BELOW)
"""The place of the map's own threshold among all."""


@dataclass(frozen=True, eq=False)
class FreeResponse:
    """Counts at each threshold, the lowest first."""

    probability: NDArray[np.float64]
    """The probabilities from which the map would call a point tumour, shape (K,)."""
    n_found: NDArray[np.int64]
    """Lesions that would be found, shape (K,)."""
    n_false: NDArray[np.int64]
    """Findings that would be false, shape (K,)."""
    own: int = OWN
    """Which of them is the map's own threshold."""


def free_response(evidence: Evidence) -> FreeResponse | None:
    """The free response of the last map of an episode; None without a map."""
    levels = thresholds(evidence.prior_prevalence)
    found = [pieces for level in levels if (pieces := pieces_of(evidence, float(level))) is not None]
    if not found:
        return None
    return FreeResponse(
        probability=expit(levels),
        n_found=np.array([int(pieces.is_found.sum()) for pieces in found]),
        n_false=np.array([len(pieces.false) for pieces in found]),
    )


def thresholds(prior_prevalence: float) -> NDArray[np.float64]:
    """The log-odds from which a map would call a point tumour, rising, shape (K,).

    Args:
        prior_prevalence: Share of the organ that the map expects to be tumour before anything is sensed.
    """
    prior, own = logit(prior_prevalence), logit(called_from(prior_prevalence))
    return np.concatenate([prior + np.array(BELOW) * (own - prior), own + np.array(ABOVE)])
