"""What is expected to be left in the light of the readings, and whether it is worth looking for."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..find_and_outline.still_hiding import still_hiding
from ..situation import Situation
from .hidden_lesions import HiddenLesions, hidden_lesions
from .lesion_count import labels_per_m3
from .lesion_prior import LesionPrior
from .what_is_left import WhatIsLeft


def what_is_left(situation: Situation, prior: LesionPrior, n_found: int) -> WhatIsLeft:
    """The lesions that are expected to be left.

    With C the share of lesions that a reading would have met, H the share that none has met and some pose can find, U
    the share that none has met and no pose can find, and k found, the rate of all lesions is Gamma(a + k, b + C), and

        E[left] = H (a + k) / (b + C),   P(none left) = ((b + C) / (b + C + H))^(a + k),
        E[unseeable] = U (a + k) / (b + C).

    Args:
        situation: What is known so far.
        prior: Number and sizes of lesions before anything is sensed.
        n_found: The number k of lesions found.
    """
    lesions = hidden_lesions(situation, prior)
    hiding = _hiding(lesions, situation)
    can_be_found = lesions.can_be_found(situation.available(exclude_sensed=False))
    share = float(hiding[can_be_found].sum())
    shape, rate = prior.rate(n_found, 1.0 - float(hiding.sum()))
    return WhatIsLeft(
        n_found=n_found,
        expected_left=share * shape / rate,
        chance_of_none=(rate / (rate + share)) ** shape,
        unseeable_share=float(np.mean(~can_be_found)),
        expected_unseeable=float(hiding[~can_be_found].sum()) * shape / rate,
    )


def is_worth_searching(
    situation: Situation, prior: LesionPrior, n_found: int, plan: Iterable[int], miss_cost: float
) -> bool:
    """Whether the next poses of a search are worth it: for some n,  L E[lesions found by the first n of them] > n.

    A lesion that no reading has met is found by a pose with the probability that its reading has a label in it.

    Args:
        situation: What is known so far.
        prior: Number and sizes of lesions before anything is sensed.
        n_found: The number of lesions found.
        plan: The poses that the search would take if it found nothing; read only as far as they decide.
        miss_cost: How many actions a missed lesion is worth, L.
    """
    lesions = hidden_lesions(situation, prior)
    hiding = _hiding(lesions, situation)
    shape, rate = prior.rate(n_found, 1.0 - float(hiding.sum()))
    density = labels_per_m3(situation.cone, situation.readings) * (1.0 - situation.false_negative_rate)
    missed = hiding
    for n, pose in enumerate(plan, 1):
        missed = missed * lesions.chance_of_missing(situation.workspace, situation.cone, [pose], density)[0]
        if miss_cost * (hiding.sum() - missed.sum()) * shape / rate > n:
            return True
    return False


def _hiding(lesions: HiddenLesions, situation: Situation) -> NDArray[np.float64]:
    """The share of each lesion that the readings leave, shape (B,)."""
    return still_hiding(
        lesions.balls, situation.readings, situation.false_negative_rate, situation.false_positive_rate
    )
