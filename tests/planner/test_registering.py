"""Actions that are spent on registering, and only where the place is believed uncertain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import PlaceBelief, RandomOrder, registering_first
from tests.helpers.planner_situations import make_situation

DEVIATION_M = 0.004


def situation_of(*, deviation_m=DEVIATION_M, above_m=0.003, **known):
    """A situation in which a contact tells more the farther to the right it is."""
    situation = make_situation(**known)
    gains_m2 = 1e-6 * situation.workspace.positions_m[:, 0]
    return replace(situation, place=PlaceBelief(deviation_m, lambda: gains_m2, above_m)), gains_m2


def ranked(situation):
    return list(registering_first(RandomOrder().rank(situation), situation))


def test_while_the_place_is_uncertain_contacts_that_tell_most_come_first() -> None:
    (situation, gains_m2), gone = situation_of(), (3, 398)
    poses = ranked(situation)
    assert (np.diff(gains_m2[poses]) <= 0.0).all()
    assert sorted(poses) == list(range(situation.workspace.n_poses))
    situation, _ = situation_of(sensed=gone[:1], skipped=gone[1:])
    assert set(poses) - set(ranked(situation)) == set(gone)


@pytest.mark.parametrize(("deviation_m", "above_m"), [(0.003, 0.003), (0.001, 0.003), (1.0, np.inf)])
def test_where_the_place_is_known_or_nobody_asks_the_planner_decides(deviation_m, above_m) -> None:
    situation, _ = situation_of(deviation_m=deviation_m, above_m=above_m)
    other, _ = situation_of(deviation_m=deviation_m)
    assert ranked(situation) == list(RandomOrder().rank(other))


def test_where_nothing_is_believed_of_the_place_the_planner_decides() -> None:
    assert ranked(make_situation()) == list(RandomOrder().rank(make_situation()))
