"""Labels near an outline that strays: against planted outlines, and what has to stay as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from mapping import LabelledPoints
from mapping.near_tumour.outline import heeding_outline

STRAY_M = 0.002
SAID = 6.0, -2.5


def view(
    drawn_m: float, seed: int = 0, n: int = 4000, size_m: tuple[float, float, float] = (0.04, 0.02, 0.02)
) -> LabelledPoints:
    """A box of 4 x 2 x 2 cm, or of another size, whose right side, from a plane on, is called tumour."""
    half_m = 0.5 * np.array(size_m)
    points_m = np.random.default_rng(seed).uniform(-half_m, half_m, (n, 3))
    is_tumour = points_m[:, 0] > drawn_m
    return LabelledPoints(points_m, is_tumour, np.where(is_tumour, *SAID), np.full(n, 0.1))


def test_labels_are_as_often_wrong_as_their_log_odds_say() -> None:
    """The true edge is planted at 0, and views draw theirs with the stray; the labels of 400 are counted.

    Labels are as dense as not to blur the edge: their gap is 0.5 mm, a quarter of the stray. Errors of one view are
    all the same, so that 400 views give a share to 0.025.
    """
    rng = np.random.default_rng(1)
    said, wrong = [], []
    for seed in range(400):
        drawn_m = STRAY_M * rng.standard_normal()
        # As dense as 8,000 in a box of 4 cm, and little larger than what is looked at.
        own = heeding_outline(view(drawn_m, seed, n=3600, size_m=(0.028, 0.016, 0.016)), STRAY_M)
        # Labels of tumour are capped by what they were worth, and free ones are not.
        is_near = (np.abs(own.points_m[:, 1:]) < 0.006).all(axis=1) & ~own.is_occupied
        is_near &= own.points_m[:, 0] > drawn_m - 0.008
        said.append(expit(-np.abs(own.log_odds[is_near])))
        wrong.append(own.points_m[is_near, 0] > 0.0)
    said, wrong = np.concatenate(said), np.concatenate(wrong)
    for low, high in ((0.02, 0.1), (0.1, 0.25), (0.25, 0.45)):
        chosen = (said >= low) & (said < high)
        assert wrong[chosen].mean() == pytest.approx(said[chosen].mean(), abs=0.06)


def test_a_view_that_drew_a_lesion_has_not_missed_it() -> None:
    own = heeding_outline(view(0.0), STRAY_M)
    beside = (own.points_m[:, 0] < -0.007) & (own.points_m[:, 0] > -0.0085)
    assert (own.log_odds[beside] < SAID[1]).all()


def test_labels_far_from_an_outline_and_views_without_one_stay_as_they_were() -> None:
    reading = view(0.0)
    far = np.abs(reading.points_m[:, 0]) > 0.011
    np.testing.assert_array_equal(heeding_outline(reading, STRAY_M).log_odds[far], reading.log_odds[far])
    free = view(1.0)
    assert heeding_outline(free, STRAY_M) is free
    alone = replace(reading, weight=None)
    assert heeding_outline(alone, STRAY_M) is alone


def test_no_label_of_tumour_gains_and_slips_draw_no_outline() -> None:
    reading = view(0.0)
    own = heeding_outline(reading, STRAY_M)
    assert (own.log_odds[own.is_occupied] <= reading.log_odds[reading.is_occupied]).all()
    flipped = reading.is_occupied.copy()
    lone = np.flatnonzero(reading.points_m[:, 0] < -0.015)[::60]
    flipped[lone] = True
    with_slips = heeding_outline(replace(reading, is_occupied=flipped), STRAY_M)
    others = np.setdiff1d(np.flatnonzero(reading.points_m[:, 0] < -0.014), lone)
    np.testing.assert_array_equal(with_slips.log_odds[others], reading.log_odds[others])
