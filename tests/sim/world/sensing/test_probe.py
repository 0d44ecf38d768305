"""Readings: even in the cone, inside the organ, labelled as the solids say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.scene.scene import build_scene
from sim.world.sensing.probe import Probe, ProbeSettings

POSES = Workspace(
    np.array([[0.5, 0.0, 0.12], [0.52, 0.01, 0.1157], [0.5, 0.0, 0.06]]),
    np.array([[0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [1.0, 0.0, 0.0]]),
)


@pytest.fixture(scope="module")
def sensing(ball_anatomy, cone):
    """(sense, anatomy): sense(pose, seed, settings) gives the reading at a pose."""
    scene = build_scene(ball_anatomy, cone, arm=None)
    positioner = FreePositioner(scene, POSES)

    def sense(pose: int, seed: int = 0, settings: ProbeSettings | None = None):
        data = scene.new_data()
        positioner.place(data, pose, is_lifted=False)
        return Probe(scene, settings).sense(data, np.random.default_rng(seed))

    return sense


@pytest.mark.parametrize("pose", [0, 1, 2])
def test_the_tip_is_where_the_pose_says(sensing, pose: int) -> None:
    T = sensing(pose).T_world_probe
    np.testing.assert_allclose(T[:3, 3], POSES.positions_m[pose], atol=1e-12)
    np.testing.assert_allclose(T[:3, 2], POSES.normals[pose], atol=1e-12)


@pytest.mark.parametrize("pose", [0, 1, 2])
def test_labels_equal_an_independent_inside_test(sensing, ball_anatomy, pose: int) -> None:
    """Overlapping and nested tumours included; pose 2 starts inside the organ."""
    reading = sensing(pose, settings=ProbeSettings(n_rays=200, n_points_per_ray=15))
    inside = np.zeros(len(reading.points_m), dtype=bool)
    for tumour in ball_anatomy.tumours:
        inside |= trimesh.Trimesh(tumour.vertices_m, tumour.faces).contains(reading.points_m)
    assert np.array_equal(reading.is_occupied, inside)
    assert pose == 2 or inside.sum() > 50


def test_points_lie_in_cone_and_organ(sensing, ball_anatomy, cone) -> None:
    reading = sensing(1)
    assert cone.contains(reading.points_m, POSES.positions_m[1], POSES.normals[1]).all()
    assert ball_anatomy.organ.contains(reading.points_m).all()


def test_points_are_even_in_volume(sensing, cone) -> None:
    """Of a cone cut at depth s the volume share is (s / depth)^3; about the axis it is the square of the radius."""
    reading = sensing(0, settings=ProbeSettings(n_rays=1000, n_points_per_ray=20))
    depth_m = POSES.positions_m[0][2] - reading.points_m[:, 2]
    share = np.sort((depth_m / cone.depth_m) ** 3)
    even = (np.arange(len(share)) + 0.5) / len(share)
    assert len(share) == 20_000  # the cone lies in the ball
    assert np.abs(share - even).max() < 0.01  # strata of 1/20 on each of 1000 rays
    radius_m = np.linalg.norm(reading.points_m[:, :2] - POSES.positions_m[0][:2], axis=1)
    slope = np.sort((radius_m / (depth_m * np.tan(cone.half_angle_rad))) ** 2)
    assert np.abs(slope - even).max() < 0.01


@pytest.mark.parametrize("seed", range(5))
def test_no_gaps_between_the_points(sensing, cone, seed: int) -> None:
    """A ball in which five points or more are expected holds some, wherever in the cone; random ones vary more."""
    reading = sensing(0, seed)
    rng = np.random.default_rng(seed)
    n_full = 10.0
    radius_m = (n_full / 1000 * cone.volume_m3 * 3.0 / (4.0 * np.pi)) ** (1 / 3)
    depth_m = cone.depth_m * np.cbrt(rng.uniform(0.05, 1.0, 2000))
    off_m = depth_m * np.tan(cone.half_angle_rad) * np.sqrt(rng.uniform(size=2000))
    angle_rad = rng.uniform(0.0, 2.0 * np.pi, 2000)
    centres_m = np.column_stack([off_m * np.cos(angle_rad), off_m * np.sin(angle_rad), depth_m])
    in_probe_m = (reading.points_m - reading.T_world_probe[:3, 3]) @ reading.T_world_probe[:3, :3]
    n_held = KDTree(in_probe_m).query_ball_point(centres_m, radius_m, return_length=True)
    expected = n_full * _share_in_cone(cone, centres_m, radius_m, rng)
    is_full = expected > 0.5 * n_full
    assert is_full.sum() > 1000
    assert n_held[is_full].min() > 0
    spread = np.std(n_held[is_full] / expected[is_full])
    assert spread < 0.9 / np.sqrt(expected[is_full].mean())  # 1 / sqrt for points drawn at random


def _share_in_cone(cone, centres_m: np.ndarray, radius_m: float, rng: np.random.Generator) -> np.ndarray:
    """Share of each ball that lies in the cone, by drawn points."""
    draws = rng.normal(size=(500, 3))
    draws *= (radius_m * np.cbrt(rng.uniform(size=500)) / np.linalg.norm(draws, axis=1))[:, None]
    points = centres_m[:, None] + draws
    inside = np.linalg.norm(points[..., :2], axis=2) <= points[..., 2] * np.tan(cone.half_angle_rad)
    return (inside & (points[..., 2] <= cone.depth_m)).mean(axis=1)


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
    assert len(Probe(scene).sense(data, np.random.default_rng(0)).points_m) == 0


def test_rays_ask_only_for_organ_and_tumours(ball_anatomy, cone) -> None:
    """A plate between probe and organ, in the arm's group, changes nothing."""
    scene = build_scene(ball_anatomy, cone, arm=None)
    model = scene.model
    hidden = model.geom("table").id
    data = scene.new_data()
    FreePositioner(scene, POSES).place(data, 0, is_lifted=False)
    before = Probe(scene).sense(data, np.random.default_rng(0))
    model.geom_pos[hidden] = [0.5, 0.0, 0.1]
    mujoco.mj_forward(model, data)
    after = Probe(scene).sense(data, np.random.default_rng(0))
    assert np.array_equal(before.is_occupied, after.is_occupied)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="n_rays=0"):
        ProbeSettings(n_rays=0)
