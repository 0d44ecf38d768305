"""The confidence that nothing of a size is left: of what could hide and could be found, how much is known free.

And the search that raises it fastest, for the end of an episode whose views may miss what is there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..find_and_outline.hidden_balls import BallPrior, HiddenBalls, hidden_balls
from ..find_and_outline.still_hiding import still_hiding
from ..situation import Situation

SURE_RADIUS_RATIO = 1.25
"""Ratio of the largest radius to the smallest, of the balls that confidence is about."""
_LARGE_FIRST = 0.5
"""Until this share is known free a search goes by balls of all sizes, so that large lesions are found first."""


def balls_in_question(situation: Situation, prior: BallPrior, radius_m: float) -> HiddenBalls:
    """The balls that confidence is about: of the tumours of a radius or more the smallest hide best.

    A pose can find one where its cone reaches half the radius into it.

    Args:
        situation: Gives poses, cone and organ.
        prior: Gives the number of balls.
        radius_m: The smallest radius [m]; the largest is a quarter more.
    """
    range_m = (radius_m, SURE_RADIUS_RATIO * radius_m)
    return hidden_balls(
        situation.workspace,
        situation.cone,
        situation.search_points_m,
        situation.surface_distance_m,
        replace(prior, radius_range_m=range_m, overlap_share=0.5, radius_power=0.0),
    )


def share_known_free(balls: HiddenBalls, situation: Situation) -> float:
    """The share C of the balls that some pose can find, of which the readings show that they do not hide.

    Args:
        balls: What could hide.
        situation: What is known so far.
    """
    hiding = _left_by_readings(balls, situation)
    is_left = situation.available(exclude_sensed=True)
    is_findable = (hiding < balls.weights) | (balls.finds.T @ is_left.astype("float32") > 0)
    share = 1.0 - hiding[is_findable].sum() / max(balls.weights[is_findable].sum(), 1e-30)
    # Sums in single precision may differ by a rounding where nothing is known yet.
    return max(0.0, float(share))


def seeks_certainty(situation: Situation, prior: BallPrior, radius_m: float) -> bool:
    """Whether an episode that stops when sure, and whose views may miss lesions, knows enough to see to being sure.

    Where views miss nothing the search stays as it is.

    Args:
        situation: What is known so far.
        prior: Gives the number of balls.
        radius_m: The smallest radius of those in question [m].
    """
    if situation.until_confident is None or situation.missed_rate == 0.0 or not situation.readings:
        return False
    return share_known_free(balls_in_question(situation, prior, radius_m), situation) >= _LARGE_FIRST


def certainty_score(balls: HiddenBalls, situation: Situation) -> NDArray[np.float64]:
    """The share of the balls that the readings leave and that each pose would find, shape (N,).

    Each pose that is planned and has no reading yet leaves of what it finds the chance that a view misses it.

    Args:
        balls: What could hide.
        situation: What is known so far; poses sensed beyond its readings are planned.
    """
    left = _left_by_readings(balls, situation)
    planned = situation.sensed[len(situation.readings) :]
    left = left * situation.missed_rate ** balls.times_found(planned)
    return balls.newly_found(left.astype(np.float32)).astype(np.float64)


def _left_by_readings(balls: HiddenBalls, situation: Situation) -> NDArray[np.float64]:
    return still_hiding(
        balls, situation.readings, situation.false_negative_rate, situation.false_positive_rate
    )


def chance_of_none_left(n_found: int, share: float) -> float:
    """The probability that none is left, C^(k + 1), with k found among the share C of what could hide.

    The number of tumours is Poisson of unknown rate, any rate being as likely as any other. Then the rate is
    Gamma(k + 1, C), the number left is negative binomial, and this is its mass at 0.

    Args:
        n_found: The number k of tumours found.
        share: The share C.
    """
    return share ** (n_found + 1)
