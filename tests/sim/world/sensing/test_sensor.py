"""What a sensor may look at, and sensors of one's own in episodes."""

from __future__ import annotations

import dataclasses
import itertools
import textwrap
from dataclasses import dataclass, replace

import numpy as np
import pytest
import trimesh

from planner import RandomOrder, Workspace
from sim.episode.episode import Episode
from sim.episode.positioner import FreePositioner
from sim.episode.truth import make_truth
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.scene.scene import build_scene
from sim.world.sensing import sensor as sensor_module
from sim.world.sensing.cone_pattern import cone_pattern
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor


@dataclass(frozen=True)
class MistakenSensor(Sensor):
    """The exact cone with a share of its labels wrong."""

    error_rate: float = 0.1

    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        exact = ConeSensor().sense(state, rng)
        is_wrong = rng.random(len(exact.points_m)) < self.error_rate
        return replace(exact, is_occupied=exact.is_occupied ^ is_wrong)


@pytest.fixture(scope="module")
def ball_sensor() -> type:
    """The example in `Sensor`'s docstring, made by the code that stands there."""
    text = Sensor.__doc__ or ""
    names = {**vars(sensor_module), "np": np, "replace": replace}
    exec(textwrap.dedent(text[text.index("        @dataclass") :]), names)
    return names["BallSensor"]


@pytest.fixture(scope="module")
def states_over_the_ball(ball_anatomy, cone) -> list:
    """States of a free probe about the ball, whose second class is one of its tumours in another place."""
    body = ball_anatomy.tumours[0].transformed(trimesh.transformations.translation_matrix([-0.01, 0.01, 0.0]))
    target = build_anatomy(ball_anatomy.organ, (body,), name="cysts", rng=np.random.default_rng(0))
    scene = build_scene(dataclasses.replace(ball_anatomy, target=target), cone, arm=None)
    poses = Workspace(
        np.array([[0.5, 0.0, 0.12], [0.52, 0.01, 0.1157], [0.5, 0.0, 0.06]]),
        np.array([[0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [1.0, 0.0, 0.0]]),
    )
    return [state_at(scene, FreePositioner(scene, poses), pose) for pose in range(3)]


def state_at(scene, positioner, pose: int) -> SceneState:
    data = scene.new_data()
    positioner.place(data, pose, is_lifted=False)
    return SceneState(scene, data)


def check_labels(state: SceneState, rng: np.random.Generator) -> tuple[int, int]:
    """Holds the solids' labels against the rays' all over the cone.

    Returns how many points lay outside the organ, and how many in a body.
    """
    directions_probe, ranges_m = cone_pattern(state.cone, n_rays=100, n_points_per_ray=20, rng=rng)
    origin_m, directions = state.T_world_probe[:3, 3].copy(), directions_probe @ state.T_world_probe[:3, :3].T
    points_m = (origin_m + ranges_m[..., None] * directions[:, None, :]).reshape(-1, 3)
    labels = state.labels(points_m)

    def is_within(surface) -> np.ndarray:
        return state.rays.winding(state.data, origin_m, directions, ranges_m, of=surface).ravel() > 0

    # The drawn meshes are of single precision, 3e-8 m at half a metre: none of the points lies that near to a surface.
    assert np.array_equal(labels.is_in_organ, is_within("organ"))
    assert np.array_equal(labels.is_tumour, is_within("tumour") & is_within("organ"))
    if labels.is_target is not None:
        assert np.array_equal(labels.is_target, is_within("target") & is_within("organ"))
    n_marked = labels.is_tumour.sum() + (labels.is_target.sum() if labels.is_target is not None else 0)
    return int((~labels.is_in_organ).sum()), int(n_marked)


@pytest.mark.parametrize("setup_name", ["sphere_setup", "sphere_arm_setup"])
def test_labels_of_the_solids_agree_with_those_of_the_rays(setup_name, request) -> None:
    setup = request.getfixturevalue(setup_name)
    truth = make_truth(setup, np.random.default_rng(0))
    tumour_m = truth.anatomy.detection_points_m.mean(axis=0)
    nearest_first = np.argsort(np.linalg.norm(setup.workspace.positions_m - tumour_m, axis=1)).tolist()
    reached = (pose for pose in nearest_first if setup.positioner.reach(pose).is_reached)
    states = (state_at(truth.scene, setup.positioner, pose) for pose in itertools.islice(reached, 25))
    rng = np.random.default_rng(1)
    counts = [check_labels(state, rng) for state in states]
    assert len(counts) == 25
    assert np.sum(counts, axis=0).min() > 20


def test_labels_agree_for_a_second_class_too(states_over_the_ball) -> None:
    rng = np.random.default_rng(2)
    counts = np.sum([check_labels(state, rng) for state in states_over_the_ball], axis=0)
    assert counts.min() > 20


def test_an_exact_reading_of_points_holds_those_in_the_organ_with_their_labels(states_over_the_ball) -> None:
    state, rng = states_over_the_ball[0], np.random.default_rng(3)
    points_m = rng.uniform([0.42, -0.08, 0.0], [0.58, 0.08, 0.16], (4000, 3))
    points_m[:1000] = rng.uniform([0.48, -0.02, 0.06], [0.52, 0.02, 0.1], (1000, 3))  # about the tumours
    reading, labels = state.exact_reading(points_m), state.labels(points_m)
    assert 0 < len(reading.points_m) < 4000
    assert np.array_equal(reading.points_m, points_m[labels.is_in_organ])
    assert np.array_equal(reading.is_occupied, labels.is_tumour[labels.is_in_organ])
    assert np.array_equal(reading.is_target, labels.is_target[labels.is_in_organ])
    assert np.array_equal(reading.T_world_probe, state.T_world_probe)
    # Tumours lie within the ball, so none of their points is left out.
    inside = np.any([tumour.contains(points_m) for tumour in state.scene.anatomy.tumours], axis=0)
    assert reading.is_occupied.sum() == inside.sum() > 20


def test_a_state_stays_valid_as_its_data_moves_on(sphere_setup) -> None:
    data = sphere_setup.scene.new_data()
    state, workspace = SceneState(sphere_setup.scene, data), sphere_setup.workspace
    seen = []
    for pose in (0, 5):
        sphere_setup.positioner.place(data, pose, is_lifted=False)
        seen.append(state.T_world_probe)
    for T, pose in zip(seen, (0, 5), strict=True):
        np.testing.assert_allclose(T[:3, 3], workspace.positions_m[pose], atol=1e-12)
    assert state.rays is state.rays
    seen[1][:] = 0.0  # a copy: what a sensor does with it does not move the probe
    np.testing.assert_allclose(state.T_world_probe[:3, 3], workspace.positions_m[5], atol=1e-12)


def test_points_of_the_probe_are_brought_to_the_world(states_over_the_ball) -> None:
    state = states_over_the_ball[0]  # looks down from (0.5, 0, 0.12)
    np.testing.assert_allclose(state.to_world_m([[0.0, 0.0, 0.03]]), [[0.5, 0.0, 0.09]], atol=1e-12)
    assert state.to_world_m(np.zeros((2, 5, 3))).shape == (2, 5, 3)


def test_a_sensor_of_ones_own_gives_the_same_bytes_for_the_same_rng(states_over_the_ball) -> None:
    sensor = MistakenSensor()
    for state in states_over_the_ball:
        first, again, other = (sensor.sense(state, np.random.default_rng(seed)) for seed in (8, 8, 9))
        exact = ConeSensor().sense(state, np.random.default_rng(8))
        for name in ("points_m", "is_occupied", "T_world_probe", "is_target"):
            assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
        assert first.points_m.tobytes() != other.points_m.tobytes()
        assert first.points_m.tobytes() == exact.points_m.tobytes()
        wrong = np.mean(first.is_occupied != exact.is_occupied)
        # Four standard deviations of a share of a tenth.
        assert abs(wrong - 0.1) < 4.0 * np.sqrt(0.09 / len(exact.points_m))


def test_the_sensor_of_the_docstring_holds_to_the_rules(ball_sensor, states_over_the_ball) -> None:
    sensor = ball_sensor(error_rate=0.0)
    for state in states_over_the_ball:
        first, again = (sensor.sense(state, np.random.default_rng(4)) for _ in range(2))
        assert first.points_m.tobytes() == again.points_m.tobytes()
        assert len(first.points_m) > 100
        assert state.scene.anatomy.organ.contains(first.points_m).all()
        middle_m = state.to_world_m([0.0, 0.0, state.cone.depth_m / 2.0])
        assert np.linalg.norm(first.points_m - middle_m, axis=1).max() < 0.02
        assert np.array_equal(first.is_occupied, state.labels(first.points_m).is_tumour)
        assert np.array_equal(first.is_target, state.labels(first.points_m).is_target)


def test_an_episode_senses_with_the_sensor_it_is_given(sphere_setup) -> None:
    def readings(sensor: Sensor | None) -> list[Reading]:
        episode = Episode(sphere_setup, RandomOrder(), seed=1, sensor=sensor)
        return [step.reading for step in episode.steps(3)]

    exact, none_wrong = readings(None), readings(MistakenSensor(error_rate=0.0))
    first, again = readings(MistakenSensor()), readings(MistakenSensor())
    assert exact[0].points_m.tobytes() == none_wrong[0].points_m.tobytes()
    assert exact[0].is_occupied.tobytes() == none_wrong[0].is_occupied.tobytes()
    assert [r.is_occupied.tobytes() for r in first] == [r.is_occupied.tobytes() for r in again]
    assert (first[0].is_occupied != exact[0].is_occupied).any()
