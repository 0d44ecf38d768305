"""Planners may be anybody's: what they are shown cannot be written to, and what they answer is looked at."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from mapping import MapSettings
from planner import Planner
from sim.episode.episode import Episode
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.live.session import Session

COARSE = MapSettings(hinge_spacing_m=0.02)
SMALL = replace(SCENARIOS["spheres"], n_poses=300)


@pytest.fixture(scope="module")
def setup():
    return build_setup(SMALL, None, COARSE)


class Own(Planner):
    """A planner with the answers that it is given."""

    needs_belief = True
    tells_confidence = True

    def __init__(self, ranking: Any = (5,), sure: Any = 0.5) -> None:
        self.ranking, self.sure = ranking, sure

    def rank(self, situation):
        return self.ranking

    def confidence(self, situation):
        return self.sure


@dataclass(frozen=True)
class Writing(Planner):
    """A planner with a slip: it takes something off an array that it is shown."""

    needs_belief = True
    needs_readings = True
    name: str = "search_points_m"

    def rank(self, situation):
        if situation.sensed:
            arrays = {
                "mean": situation.prediction.latent_mean,
                "variance": situation.prediction.latent_variance,
                "labels": situation.readings[0].is_occupied,
                "points": situation.readings[0].points_m,
                "positions": situation.workspace.positions_m,
            }
            array = arrays[self.name] if self.name in arrays else getattr(situation, self.name)
            array[:] = array[::-1].copy()
        return (5,)


@pytest.mark.parametrize(
    "name",
    [
        "search_points_m",
        "is_visible",
        "surface_distance_m",
        "mean",
        "variance",
        "labels",
        "points",
        "positions",
    ],
)
def test_what_is_shown_cannot_be_written_to(setup, name) -> None:
    before = setup.search_points_m.copy()
    with pytest.raises(ValueError, match="read-only"):
        list(Episode(setup, Writing(name=name), seed=0, map_settings=COARSE).steps(2))
    np.testing.assert_array_equal(setup.search_points_m, before)


@pytest.mark.parametrize(
    ("ranking", "told"),
    [
        ((-1,), r"Own named the pose -1; poses are whole numbers from 0 to \d+"),
        ((10**7,), "named the pose 10000000"),
        ((5.7,), "named the pose 5.7"),
        ((True,), "named the pose True"),
        ((None,), "named the pose None"),
        (None, r"Own\.rank returned None; it must yield or return indices of poses"),
    ],
)
def test_a_ranking_of_what_is_no_pose_ends_the_episode_before_the_probe_goes_there(
    setup, ranking, told
) -> None:
    episode = Episode(setup, Own(ranking), seed=0, map_settings=COARSE)
    with pytest.raises(ValueError, match=told):
        list(episode.steps(2))
    assert episode.sensed == []
    with pytest.raises(ValueError, match=told):
        Session(plan_organ(SMALL, COARSE), Own(ranking), map_settings=COARSE).propose()


@pytest.mark.parametrize("sure", [np.nan, 1.7, -0.1, "sure", None])
def test_a_confidence_that_is_no_probability_is_refused(setup, sure) -> None:
    episode = Episode(setup, Own(sure=sure), seed=0, map_settings=COARSE)
    with pytest.raises(ValueError, match=r"Own\.confidence returned .*; it must be a number from 0 to 1"):
        list(episode.steps(2, until_confident=0.9))


def test_indices_of_numpy_are_poses(setup) -> None:
    episode = Episode(setup, Own(np.array([7, 8])), seed=0, map_settings=COARSE)
    list(episode.steps(2))
    assert episode.sensed == [7, 7]
