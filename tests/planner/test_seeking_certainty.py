"""An episode that is to stop when sure, and whose views may miss lesions, goes after what it is not sure of."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from planner_situations import flat_workspace
from searched import PLANNER, seen_free, situation

from mapping import LabelledPoints
from planner import Situation
from planner.stopping.confidence import balls_in_question, seeks_certainty, share_known_free

MISSED = 0.1
WORKSPACE = flat_workspace(12)


def doubtful(reading: LabelledPoints) -> LabelledPoints:
    """The reading of a view that misses a lesion as a whole once in ten times."""
    n = len(reading.points_m)
    return replace(reading, log_odds=np.full(n, np.log(MISSED)), weight=np.full(n, 0.02))


FREE = tuple(doubtful(reading) for reading in seen_free(WORKSPACE, range(WORKSPACE.n_poses), 300))


def after(sensed: list[int], **more: float | None) -> Situation:
    """Nothing was found by the views from these poses."""
    readings = tuple(FREE[pose] for pose in sensed)
    made = situation(workspace=WORKSPACE, sensed=sensed, readings=readings)
    return replace(made, missed_rate=MISSED, **more)


@cache
def searched(until_confident: float | None) -> list[int]:
    """The first poses of a search that finds nothing."""
    sensed: list[int] = []
    for _ in range(40):
        sensed.append(next(iter(PLANNER.rank(after(sensed, until_confident=until_confident)))))
    return sensed


def share(asked: Situation) -> float:
    return share_known_free(balls_in_question(asked, PLANNER.balls, PLANNER.sure_radius_m), asked)


def test_it_is_sure_after_fewer_actions() -> None:
    sure, covered = searched(0.95), searched(None)
    assert PLANNER.confidence(after(sure)) > PLANNER.confidence(after(covered)) + 0.02
    # Large lesions are looked for first: until half is known free, both take the same poses.
    n_same = next(i for i in range(40) if sure[i] != covered[i])
    assert share(after(sure[: n_same - 1])) < 0.5 <= share(after(sure[:n_same]))


def test_the_next_pose_makes_surest_of_all_poses() -> None:
    """Tried out: a free reading from every other pose."""
    sensed = searched(0.95)
    asked = after(sensed, until_confident=0.95)
    assert seeks_certainty(asked, PLANNER.balls, PLANNER.sure_radius_m)
    before, gains = share(asked), {}
    chosen = next(iter(PLANNER.rank(asked)))
    for pose in {chosen, *range(0, WORKSPACE.n_poses, 2)} - set(sensed):
        gains[pose] = share(after([*sensed, pose])) - before
    # Not all that the score takes a pose to find gets a label, so that it may err by a little.
    assert gains[chosen] > 0.8 * max(gains.values())
    assert gains[chosen] > 2.0 * np.median(list(gains.values()))


def test_poses_that_are_planned_together_do_not_look_at_the_same() -> None:
    sensed = searched(0.95)
    asked = after(sensed, until_confident=0.95)
    [first, second] = list(PLANNER._search_plan(asked, asked.available(exclude_sensed=True)))[:2]
    alone, beside = (PLANNER.search_score(replace(asked, sensed=(*sensed, *more))) for more in ((), (first,)))
    assert beside[first] < 1.5 * MISSED * alone[first]
    assert second == np.argmax(np.where(np.isin(np.arange(len(beside)), [*sensed, first]), -1.0, beside))


def test_where_views_miss_nothing_or_nobody_asks_for_certainty_the_search_stays_as_it_is() -> None:
    sensed = searched(None)
    exact = replace(after(sensed), missed_rate=0.0)
    np.testing.assert_array_equal(PLANNER.score(replace(exact, until_confident=0.95)), PLANNER.score(exact))
    assert not seeks_certainty(after(sensed), PLANNER.balls, PLANNER.sure_radius_m)
