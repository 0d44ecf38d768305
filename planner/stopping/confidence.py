"""The confidence that nothing of a size is left: of what could hide and could be found, how much is known free."""

from __future__ import annotations

from ..find_and_outline.hidden_balls import HiddenBalls, still_hiding
from ..situation import Situation

SURE_RADIUS_RATIO = 1.25
"""Ratio of the largest radius to the smallest, of the balls that confidence is about."""


def share_known_free(balls: HiddenBalls, situation: Situation) -> float:
    """The share C of the balls that some pose can find, of which the readings show that they do not hide.

    Args:
        balls: What could hide.
        situation: What is known so far.
    """
    hiding = still_hiding(
        balls, situation.readings, situation.false_negative_rate, situation.false_positive_rate
    )
    is_left = situation.available(exclude_sensed=True)
    is_findable = (hiding < balls.weights) | (balls.finds.T @ is_left.astype("float32") > 0)
    return float(1.0 - hiding[is_findable].sum() / max(balls.weights[is_findable].sum(), 1e-30))


def chance_of_none_left(n_found: int, share: float) -> float:
    """The probability that none is left, C^(k + 1), with k found among the share C of what could hide.

    The number of tumours is Poisson of unknown rate, any rate being as likely as any other. Then the rate is
    Gamma(k + 1, C), the number left is negative binomial, and this is its mass at 0.

    Args:
        n_found: The number k of tumours found.
        share: The share C.
    """
    return share ** (n_found + 1)
