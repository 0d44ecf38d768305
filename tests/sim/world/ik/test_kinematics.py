"""IK answers, checked by forward kinematics, limits, contacts and the true organ surface."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from geom_surface import geom_triangles

from planner import Workspace
from sim.episode.positioner import ArmPositioner
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.result import IkStatus
from sim.world.ik.settings import IkSettings
from sim.world.scene.arm import ArmModel
from sim.world.scene.probe_surface import FACE_RADIUS_M
from sim.world.scene.scene import build_scene
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid

BALL_CENTRE_M, BALL_RADIUS_M = np.array([0.5, 0.0, 0.06]), 0.06


@pytest.fixture(scope="module")
def kinematics(scene, clearance):
    return Kinematics(scene, clearance)


def ball_pose(polar_rad: float, azimuth_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """A sensing pose on the ball: position and inward normal."""
    outward = np.array(
        [np.sin(polar_rad) * np.cos(azimuth_rad), np.sin(polar_rad) * np.sin(azimuth_rad), np.cos(polar_rad)]
    )
    return BALL_CENTRE_M + BALL_RADIUS_M * outward, -outward


def forward(scene, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, mujoco.MjData]:
    """Tip position, beam and state at joint positions, by MuJoCo alone."""
    data = mujoco.MjData(scene.model)
    data.qpos[:] = q
    mujoco.mj_forward(scene.model, data)
    return data.site("probe_tip").xpos, data.site("probe_tip").xmat.reshape(3, 3)[:, 2], data


@pytest.mark.parametrize("polar_deg", [0, 15, 30, 45])
@pytest.mark.parametrize("azimuth_deg", [0, 90, 180, 270])
def test_poses_on_a_ball_are_reached_and_the_answer_holds(
    scene, kinematics, polar_deg: int, azimuth_deg: int
) -> None:
    position_m, normal = ball_pose(np.deg2rad(polar_deg), np.deg2rad(azimuth_deg))
    answer = kinematics.solve(position_m, normal)
    assert answer.is_reached, answer.explain()
    low, high = scene.model.jnt_range.T
    for q, at_m in ((answer.q, position_m), (answer.q_standoff, position_m - 0.04 * normal)):
        tip_m, beam, data = forward(scene, q)
        assert np.linalg.norm(tip_m - at_m) < 1e-3
        assert np.arccos(np.clip(beam @ normal, -1, 1)) < np.deg2rad(1.0)
        assert np.all((q >= low) & (q <= high))
        assert data.ncon == 0
    assert answer.position_error_m == pytest.approx(
        np.linalg.norm(forward(scene, answer.q)[0] - position_m), abs=1e-12
    )


def test_only_the_face_touches_the_organ(scene, kinematics) -> None:
    """Against the analytic ball: no part of arm and probe beyond the face lies inside it."""
    answer = kinematics.solve(*ball_pose(0.4, 1.0))
    tip_m, _, data = forward(scene, answer.q)
    for geom in sorted(scene.arm_geoms):
        corners_m = geom_triangles(scene.model, geom).reshape(-1, 3)
        vertices_m, faces, _ = trimesh.remesh.subdivide_to_size(
            corners_m, np.arange(len(corners_m)).reshape(-1, 3), 0.004, return_index=True
        )
        assert len(faces)
        points_m = data.geom_xpos[geom] + vertices_m @ data.geom_xmat[geom].reshape(3, 3).T
        beyond = np.linalg.norm(points_m - tip_m, axis=1) > FACE_RADIUS_M
        gap_m = np.linalg.norm(points_m - BALL_CENTRE_M, axis=1) - BALL_RADIUS_M
        assert gap_m[beyond].min(initial=1.0) > -5e-4  # the ball's facets lie up to 0.1 mm inside it


def test_poses_of_random_free_configurations_are_solved(scene, clearance) -> None:
    """Poses that are reachable by construction, since a configuration with room to lift made them."""
    kinematics = Kinematics(scene, clearance, IkSettings(standoff_m=1e-4))
    rng, low, high = np.random.default_rng(5), *scene.model.jnt_range.T
    n_solved = n_made = 0
    while n_made < 40:
        q = rng.uniform(low, high)
        if kinematics.collision(q) is not None:
            continue
        n_made += 1
        tip_m, beam, _ = forward(scene, q)
        n_solved += kinematics.solve(tip_m, beam / np.linalg.norm(beam)).is_reached
    assert n_solved >= 38  # a pose at the very rim of the workspace may need more restarts than the default


def test_the_same_pose_has_the_same_answer(scene, clearance, kinematics) -> None:
    position_m, normal = ball_pose(0.3, 2.0)
    again = Kinematics(scene, clearance)
    again.solve(*ball_pose(0.6, 0.5))  # what was solved before must not matter
    assert kinematics.solve(position_m, normal).q.tobytes() == again.solve(position_m, normal).q.tobytes()


def test_a_pose_out_of_reach_is_too_far(kinematics) -> None:
    answer = kinematics.solve(np.array([1.6, 0.0, 0.1]), np.array([0.0, 0.0, -1.0]))
    assert answer.status is IkStatus.TOO_FAR
    assert answer.n_iterations == 0
    assert "closer" in answer.explain()


def test_a_pose_below_the_table_collides_and_says_with_what(kinematics) -> None:
    answer = kinematics.solve(np.array([0.4, 0.25, -0.01]), np.array([0.0, 0.0, -1.0]))
    assert answer.status is IkStatus.COLLISION
    assert "table" in answer.explain()


def test_a_probe_that_cannot_stand_there_is_refused_at_once(kinematics) -> None:
    """From inside the ball outwards the probe itself would fill the organ, whatever the arm does."""
    answer = kinematics.solve(BALL_CENTRE_M, np.array([0.0, 0.0, -1.0]))
    assert answer.status is IkStatus.COLLISION
    assert answer.n_iterations == 0
    assert "organ" in answer.explain()


def test_a_true_concavity_is_not_closed_by_its_hull(cone) -> None:
    """A pose at the bottom of a wide bowl, deep inside the convex hull, is reached."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 41), np.linspace(-0.1, 0.1, 41))
    z = 0.03 + 5.0 * (x**2 + y**2)
    from sim.world.anatomy.anatomy import build_anatomy
    from sim.world.anatomy.paper_organ import solid_below

    bowl: Solid = solid_below(np.stack([x + 0.5, y, z], axis=-1), 0.0)
    anatomy = build_anatomy(bowl, name="bowl", rng=np.random.default_rng(0))
    bowl_scene = build_scene(anatomy, cone, arm=ArmModel())
    positioner = ArmPositioner(
        bowl_scene,
        Workspace(np.array([[0.5, 0.0, 0.03]]), np.array([[0.0, 0.0, -1.0]])),
        DistanceGrid.from_solid(bowl),
    )
    assert positioner.reach(0).is_reached, positioner.reach(0).explain()


@pytest.mark.parametrize(
    ("position_m", "normal"),
    [
        ([np.nan, 0, 0], [0, 0, -1]),
        ([0.5, 0, 0.1], [0, 0, -2]),
        ([0.5, 0], [0, 0, -1]),
        ([0.5, 0, 0.1], [0, 0, 0]),
    ],
)
def test_a_bad_pose_is_refused(kinematics, position_m, normal) -> None:
    with pytest.raises(ValueError, match="position_m|normal"):
        kinematics.solve(np.array(position_m, dtype=float), np.array(normal, dtype=float))


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="standoff_m=-1"):
        IkSettings(standoff_m=-1.0)
