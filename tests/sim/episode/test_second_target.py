"""A second class of targets: sensed and mapped beside the tumours, which know nothing of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from two_classes import options, sensed, setup_of, write_meshes

from mapping import HilbertMap, average_precision
from planner import RandomOrder, Workspace
from sim.episode.episode import Episode
from sim.episode.positioner import FreePositioner
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup
from sim.errors import UsageError
from sim.running.fields import config_of
from sim.running.parts import make_parts, planner_of
from sim.world.scene.scene import build_scene
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.sensor import SceneState


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    return write_meshes(tmp_path_factory.mktemp("two"))


@pytest.fixture(scope="module")
def setup(case) -> Setup:
    return setup_of(case)


@pytest.fixture(scope="module")
def both(case, setup):
    return sensed(options(case), setup)


def test_readings_label_each_class_as_an_independent_inside_test_does(both) -> None:
    episode, steps = both
    classes = {"is_occupied": episode.truth.anatomy, "is_target": episode.truth.anatomy.target}
    for name, anatomy in classes.items():
        n_inside = 0
        for step in steps:
            inside = np.zeros(len(step.reading.points_m), dtype=bool)
            for solid in anatomy.tumours:
                inside |= trimesh.Trimesh(solid.vertices_m, solid.faces).contains(step.reading.points_m)
            assert np.array_equal(getattr(step.reading, name), inside)
            n_inside += inside.sum()
        assert n_inside > 20


def test_rays_ask_for_one_class_where_bodies_overlap(ball_anatomy, cone) -> None:
    # The second class is the tumours themselves: nested, overlapping, and everywhere the same as they are.
    both = reading_in(dataclasses.replace(ball_anatomy, target=ball_anatomy), cone)
    assert np.array_equal(both.is_target, both.is_occupied)
    assert both.is_occupied.any()
    alone = reading_in(dataclasses.replace(ball_anatomy, tumours=(), target=ball_anatomy), cone)
    assert np.array_equal(alone.points_m, both.points_m)
    assert np.array_equal(alone.is_target, both.is_target)
    assert not alone.is_occupied.any()


def reading_in(anatomy, cone):
    """What the probe reads from above the middle of the ball."""
    scene = build_scene(anatomy, cone, arm=None)
    above = Workspace(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
    data = scene.new_data()
    FreePositioner(scene, above).place(data, 0, is_lifted=False)
    return ConeSensor().sense(SceneState(scene, data), np.random.default_rng(0))


class OneClassSensor(ConeSensor):
    def sense(self, state, rng):
        return dataclasses.replace(super().sense(state, rng), is_target=None)


def test_a_sensor_that_leaves_the_second_class_out_is_told_so(setup) -> None:
    episode = Episode(setup, RandomOrder(), seed=0, sensor=OneClassSensor())
    with pytest.raises(ValueError, match="has a second class, cysts, but is_target of the reading is None"):
        next(episode.steps(1))


def test_the_tumours_know_nothing_of_it(case, setup, both) -> None:
    episode, steps = sensed(options(case), dataclasses.replace(setup, given_targets=(), target_names=()))
    assert episode.target is None
    assert steps[-1].target is None
    assert steps[-1].reading.is_target is None
    for one, other in zip(steps, both[1], strict=True):
        assert (one.pose_index, one.auprc, one.sensed_fraction) == (
            other.pose_index,
            other.auprc,
            other.sensed_fraction,
        )
        assert np.array_equal(one.reading.points_m, other.reading.points_m)
    assert episode.prediction.latent_mean.tobytes() == both[0].prediction.latent_mean.tobytes()
    assert episode.prediction.latent_variance.tobytes() == both[0].prediction.latent_variance.tobytes()


def test_its_map_is_the_one_that_learns_its_labels_alone(case, setup) -> None:
    config = options(case)
    episode, steps = sensed(config, setup)
    own = HilbertMap(
        setup.hinges,
        make_parts(config).map_settings,
        query=setup.query,
        query_mask=setup.is_inside,
        hinge_mask=setup.hinge_mask,
    )
    for step in steps:
        own.update(step.reading.points_m, step.reading.is_target)
    expected = own.predict_lattice()
    assert episode.target.prediction.latent_mean.tobytes() == expected.latent_mean.tobytes()
    inside = np.zeros(len(setup.search_points_m), dtype=bool)
    for solid in episode.truth.anatomy.target.tumours:
        inside |= solid.contains(setup.search_points_m)
    assert steps[-1].target.auprc == average_precision(expected.score, inside)


def test_classes_that_change_places_change_maps(case, setup) -> None:
    """Planning for the targets is planning for tumours in their place."""
    changed = dataclasses.replace(
        setup,
        given_tumours=setup.given_targets,
        tumour_names=setup.target_names,
        given_targets=setup.given_tumours,
        target_names=setup.tumour_names,
    )
    for_target, steps = sensed(options(case, plan_for="target"), setup)
    for_tumours, others = sensed(options(case), changed)
    assert [step.pose_index for step in steps] == [step.pose_index for step in others]
    target = for_target.target.prediction
    assert target.latent_mean.tobytes() == for_tumours.prediction.latent_mean.tobytes()
    assert for_target.prediction.latent_mean.tobytes() == for_tumours.target.prediction.latent_mean.tobytes()
    assert target.probability[for_target.target.truth.is_target].mean() > 0.4  # of a prior of 2 %


def test_a_class_that_is_not_there_is_refused(setup, tmp_path) -> None:
    (tmp_path / "case.toml").write_text('target_files = ["cyst.stl"]\n')
    with pytest.raises(UsageError, match="go with an organ's own file"):
        load_scenario(str(tmp_path / "case.toml"))
    planner, alone = planner_of(config_of()), dataclasses.replace(setup, given_targets=())
    with pytest.raises(ValueError, match="no second class"):
        Episode(alone, planner, seed=0, plans_for_target=True)
