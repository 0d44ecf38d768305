"""What a pose is worth to planners that go by the belief alone: how unsure the map is of what it would see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..find_and_outline.frontier import seen_weight
from ..situation import Situation


def explored_and_refined(
    situation: Situation, planner: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much each pose sees of what was never sensed, and of what is doubtful, both from 0 to 1, shape (N,) each.

    The first sums the share of the latent's largest variance that is left over the search points in a pose's cone, the
    second 4 p (1 - p); each is divided by its largest value.

    Args:
        situation: What is known so far.
        planner: What needs it, for the error.

    Raises:
        PlannerError: If there is no belief.
    """
    belief = situation.belief(planner)
    variance = belief.latent_variance / max(float(belief.latent_variance.max()), 1e-30)
    doubt = 4.0 * belief.probability * (1.0 - belief.probability)
    both = []
    for weights in (variance, doubt):
        seen = seen_weight(situation.workspace, situation.cone, situation.search_points_m, weights)
        both.append(seen / max(float(seen.max()), 1e-30))
    return both[0], both[1]
