"""Planners, sensors and maps may be anybody's: what is shown cannot be written to, what is answered is looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from mapping import MapSettings, MapSpace, Prediction
from planner import Planner
from sim.episode.body_options import BodyOptions
from sim.episode.episode import Episode
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.live.session import Session
from sim.world.body.settings import BodySettings
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.reading import Reading

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


@pytest.mark.parametrize("worth", [None, 1, "yes"])
def test_what_is_neither_yes_nor_no_does_not_end_an_episode_as_not_worth_it(
    setup, monkeypatch, worth
) -> None:
    monkeypatch.setattr(Own, "is_worth_going_on", lambda self, situation: worth)
    told = f"Own.is_worth_going_on returned {worth!r}; it must be True or False"
    with pytest.raises(ValueError, match=told):
        list(Episode(setup, Own(), seed=0, map_settings=COARSE).steps(2, miss_cost=9.0))
    session = Session(plan_organ(SMALL, COARSE), Own(), map_settings=COARSE, miss_cost=9.0)
    session.sensed.append(5)
    with pytest.raises(ValueError, match=told):
        session.propose()


class Tells:
    """A sensor that changes an exact reading."""

    def __init__(self, change: Callable[[Reading], Any]) -> None:
        self.change = change

    def sense(self, state, rng):
        return self.change(ConeSensor().sense(state, rng))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda reading: None, "Tells.sense returned None; it must return a Reading"),
        (lambda reading: (reading.points_m, reading.is_occupied), "Tells.sense returned a tuple; it must"),
        (
            lambda reading: replace(reading, points_m=reading.points_m * np.nan),
            "value in points_m that is no",
        ),
        (
            lambda reading: replace(reading, T_world_probe=np.full((4, 4), np.inf)),
            "value in T_world_probe that",
        ),
        (lambda reading: replace(reading, is_target=reading.is_occupied), "the scene has no second class"),
        # In millimetres, and in the probe's frame, whose origin lies 0.4 m from the organ.
        (
            lambda reading: replace(reading, points_m=reading.points_m * 1e3),
            r"points \d+ mm outside the organ",
        ),
        (
            lambda reading: reading.moved(np.linalg.inv(reading.T_world_probe)),
            r"points \d+ mm outside the organ",
        ),
    ],
)
def test_what_a_sensor_returns_and_is_no_reading_of_the_organ_is_refused(setup, change, told) -> None:
    for body in (None, BodyOptions(settings=BodySettings(registration_m=0.02))):
        episode = Episode(setup, Own(), seed=0, map_settings=COARSE, sensor=Tells(change), body=body)
        with pytest.raises(ValueError, match=told):
            list(episode.steps(1))


def test_noise_about_the_organ_is_no_mistake_of_frames(setup) -> None:
    rng = np.random.default_rng(0)
    noisy = Tells(
        lambda reading: replace(
            reading, points_m=reading.points_m + rng.normal(0, 5e-3, reading.points_m.shape)
        )
    )
    for body in (None, BodyOptions(settings=BodySettings(registration_m=0.02, tracking_m=0.01))):
        episode = Episode(setup, Own(), seed=0, map_settings=COARSE, sensor=noisy, body=body)
        assert len(list(episode.steps(2))) == 2


class Says:
    """A map that predicts the same mean and variance everywhere."""

    def __init__(self, space: MapSpace, mean: float = 0.0, variance: float = 1.0) -> None:
        self.prediction = Prediction(*np.broadcast_arrays(mean, np.full(len(space.points_m), variance)))

    def update(self, points_m, is_occupied) -> None: ...

    def predict_lattice(self) -> Prediction:
        return self.prediction

    def save(self, path) -> None: ...


@pytest.mark.parametrize(("mean", "variance"), [(np.inf, 1.0), (np.nan, 1.0), (0.0, -1.0), (0.0, np.inf)])
def test_a_belief_that_is_none_is_told_with_the_map_it_came_from(setup, mean, variance) -> None:
    episode = Episode(setup, Own(), seed=0, tumour_map=lambda space: Says(space, mean, variance))
    with pytest.raises(
        ValueError, match=r"Says\.predict_lattice returned .* with finite variances of 0 or more"
    ):
        list(episode.steps(1))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (
            lambda space: None,
            "`tumour_map` returned None; a map has the methods update, predict_lattice, save",
        ),
        (lambda space: space, "`tumour_map` returned a MapSpace without update and predict_lattice and save"),
    ],
)
def test_a_factory_that_makes_no_map_does_not_run_without_one(setup, make, told) -> None:
    with pytest.raises(ValueError, match=told):
        Episode(setup, Own(), seed=0, tumour_map=make)
