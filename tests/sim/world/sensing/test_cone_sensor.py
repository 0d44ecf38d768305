"""Readings: even in the cone, inside the organ, labelled as the solids say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.scene.scene import build_scene
from sim.world.sensing.cone_pattern import cone_pattern
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.sensor import SceneState

POSES = Workspace(
    np.array([[0.5, 0.0, 0.12], [0.52, 0.01, 0.1157], [0.5, 0.0, 0.06]]),
    np.array([[0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [1.0, 0.0, 0.0]]),
)


@pytest.fixture(scope="module")
def sensing(ball_anatomy, cone):
    """sense(pose, seed, sensor) gives the reading of a free probe at a pose."""
    scene = build_scene(ball_anatomy, cone, arm=None)
    positioner = FreePositioner(scene, POSES)

    def sense(pose: int, seed: int = 0, sensor: ConeSensor | None = None):
        data = scene.new_data()
        positioner.place(data, pose, is_lifted=False)
        return (sensor or ConeSensor()).sense(SceneState(scene, data), np.random.default_rng(seed))

    return sense


@pytest.mark.parametrize("pose", [0, 1, 2])
def test_the_tip_is_where_the_pose_says(sensing, pose: int) -> None:
    T = sensing(pose).T_world_probe
    np.testing.assert_allclose(T[:3, 3], POSES.positions_m[pose], atol=1e-12)
    np.testing.assert_allclose(T[:3, 2], POSES.normals[pose], atol=1e-12)


@pytest.mark.parametrize("pose", [0, 1, 2])
def test_labels_equal_an_independent_inside_test(sensing, ball_anatomy, pose: int) -> None:
    """Overlapping and nested tumours included; pose 2 starts inside the organ."""
    reading = sensing(pose, sensor=ConeSensor(n_rays=200, n_points_per_ray=15))
    inside = np.zeros(len(reading.points_m), dtype=bool)
    for tumour in ball_anatomy.tumours:
        inside |= trimesh.Trimesh(tumour.vertices_m, tumour.faces).contains(reading.points_m)
    assert np.array_equal(reading.is_occupied, inside)
    assert pose == 2 or inside.sum() > 50


def test_points_lie_in_cone_and_organ(sensing, ball_anatomy, cone) -> None:
    reading = sensing(1)
    assert cone.contains(reading.points_m, POSES.positions_m[1], POSES.normals[1]).all()
    assert ball_anatomy.organ.contains(reading.points_m).all()


def test_its_points_are_those_of_the_cone_pattern(sensing, cone) -> None:
    """The cone of pose 0 lies in the ball as a whole, so no point is left out."""
    reading = sensing(0, 6)
    directions, ranges_m = cone_pattern(cone, n_rays=100, n_points_per_ray=10, rng=np.random.default_rng(6))
    pattern_m = (ranges_m[..., None] * directions[:, None, :]).reshape(-1, 3)
    in_probe_m = (reading.points_m - reading.T_world_probe[:3, 3]) @ reading.T_world_probe[:3, :3]
    # A few roundings of coordinates of half a metre, 1e-16 each.
    np.testing.assert_allclose(in_probe_m, pattern_m, atol=1e-15)


def test_about_a_thousand_points_by_default_and_the_same_for_a_seed(sensing) -> None:
    first, again, other = sensing(0, 3), sensing(0, 3), sensing(0, 4)
    assert len(first.points_m) == 1000
    assert first.points_m.tobytes() == again.points_m.tobytes()
    assert not np.array_equal(first.points_m, other.points_m)


def test_a_probe_in_the_air_reads_nothing_beyond_the_organ(ball_anatomy, cone) -> None:
    scene = build_scene(ball_anatomy, cone, arm=None)
    data = scene.new_data()
    away = Workspace(np.array([[0.5, 0.0, 0.20]]), np.array([[0.0, 0.0, 1.0]]))
    FreePositioner(scene, away).place(data, 0, is_lifted=False)
    reading = ConeSensor().sense(SceneState(scene, data), np.random.default_rng(0))
    assert len(reading.points_m) == 0
    assert reading.is_target is None


def test_rays_meet_only_organ_and_tumours(ball_anatomy, cone) -> None:
    """A plate between probe and organ, in the arm's group, changes nothing."""
    scene = build_scene(ball_anatomy, cone, arm=None)
    model = scene.model
    hidden = model.geom("table").id
    data = scene.new_data()
    FreePositioner(scene, POSES).place(data, 0, is_lifted=False)
    state = SceneState(scene, data)
    before = ConeSensor().sense(state, np.random.default_rng(0))
    model.geom_pos[hidden] = [0.5, 0.0, 0.1]
    mujoco.mj_forward(model, data)
    after = ConeSensor().sense(state, np.random.default_rng(0))
    assert np.array_equal(before.is_occupied, after.is_occupied)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="n_rays=0"):
        ConeSensor(n_rays=0)
