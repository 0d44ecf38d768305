"""Poses for a probe of one's own: its tip gets there, its true shape decides, and the turn about its beam is used."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from geom_surface import geom_triangles
from probe_files import bent, bent_mesh, probe_file

from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.paper_organ import solid_below
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.result import IkStatus
from sim.world.ik.search import IkSearch
from sim.world.probes.probe import ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid

BALL_CENTRE_M, BALL_RADIUS_M = np.array([0.5, 0.0, 0.06]), 0.06
PLATE = (
    '<geom name="shaft" type="capsule" size="0.01" fromto="0 0 0.02 0 0 0.08"/>'
    '<geom name="plate" type="box" size="0.02 0.003 0.035" pos="0 0 0.105"/><site name="tip" pos="0 0 0.14"/>'
)
"""A probe that ends in a plate, 40 mm wide along its x and 6 mm thick."""


def ball_poses(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses on the upper part of the ball: positions and inward normals, shape (n, 3) each."""
    rng = np.random.default_rng(0)
    polar, azimuth = rng.uniform(0.0, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    outward = np.column_stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    )
    return BALL_CENTRE_M + BALL_RADIUS_M * outward, -outward


def dense_points_m(scene, data, geom: int) -> np.ndarray:
    """Points all over a geom, at most 4 mm apart, world frame [m], made without the code under test."""
    corners_m = geom_triangles(scene.model, geom).reshape(-1, 3)
    faces = np.arange(len(corners_m)).reshape(-1, 3)
    points_m, _ = trimesh.remesh.subdivide_to_size(corners_m, faces, 0.004)
    return data.geom_xpos[geom] + points_m @ data.geom_xmat[geom].reshape(3, 3).T


def probe_geoms(scene) -> list[int]:
    body = scene.model.body("probe_probe").id
    return [geom for geom in sorted(scene.arm_geoms) if scene.model.geom_bodyid[geom] == body]


def test_a_bent_probe_brings_its_tip_to_the_pose_and_nothing_but_its_face_into_the_organ(
    tmp_path, ball_anatomy, ball_distance, cone
) -> None:
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=bent(tmp_path)))
    solver = Kinematics(scene, Clearance(scene, ball_distance))
    # From the numbers in the file: up the handle, and 80 mm on at 45 degrees towards +x.
    aside = np.array([np.sin(np.pi / 4), 0.0, np.cos(np.pi / 4)])
    tip_in_flange_m, beam_in_flange = np.array([0.0, 0.0, 0.09]) + 0.08 * aside, aside
    positions_m, normals = ball_poses(6)
    answers = solver.solve_many(positions_m, normals)
    assert all(answer.is_reached for answer in answers)
    data = mujoco.MjData(scene.model)
    for answer, position_m, normal in zip(answers, positions_m, normals, strict=True):
        for q, at_m in ((answer.q, position_m), (answer.q_standoff, position_m - 0.04 * normal)):
            data.qpos[:] = q
            mujoco.mj_forward(scene.model, data)
            flange = data.site("arm_flange")
            R = flange.xmat.reshape(3, 3)
            tip_m, beam = flange.xpos + R @ tip_in_flange_m, R @ beam_in_flange
            assert np.linalg.norm(tip_m - at_m) <= 1e-4  # the stated tolerances
            assert np.arccos(np.clip(beam @ normal, -1.0, 1.0)) <= 2e-3
            assert data.ncon == 0
            for geom in probe_geoms(scene):
                points_m = dense_points_m(scene, data, geom)
                gap_m = np.linalg.norm(points_m - BALL_CENTRE_M, axis=1) - BALL_RADIUS_M
                # Between points 4 mm apart the code under test sees nothing, and round geoms are enclosed by 0.5 mm.
                assert gap_m[np.linalg.norm(points_m - tip_m, axis=1) > 0.009].min(initial=1.0) > -1e-3


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_contacts_of_the_probe_with_table_and_arm_are_seen(
    tmp_path, ball_anatomy, ball_distance, cone, make
) -> None:
    """Against MuJoCo's distances between pairs of geoms, in configurations in which arm and table are all about."""
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=make(tmp_path)))
    model, data = scene.model, scene.new_data()
    clearance = Clearance(scene, ball_distance)
    table = np.flatnonzero((model.geom_bodyid == model.body("table").id) & (model.geom_contype != 0)).tolist()
    near = {model.body(f"arm_link{i}").id for i in (6, 7)}  # neighbours, which cannot meet the probe
    links = [g for g in scene.arm_geoms if model.geom_bodyid[g] not in near and g not in probe_geoms(scene)]
    links = [g for g in links if model.body(model.geom_bodyid[g]).name != "arm_link5"]
    low, high = model.jnt_range.T
    n_in_table = n_in_arm = 0
    for q in np.random.default_rng(3).uniform(low, high, (1200, len(low))):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        to_table_m, to_arm_m = (
            min(
                mujoco.mj_geomDistance(model, data, a, b, 1.0, None)
                for a in probe_geoms(scene)
                for b in others
            )
            for others in (table, links)
        )
        # Within a tenth of a millimetre the two ways need not agree.
        if min(to_table_m, to_arm_m) < -1e-4:
            assert clearance.collision(data) is not None
            n_in_table, n_in_arm = n_in_table + (to_table_m < 0.0), n_in_arm + (to_arm_m < 0.0)
    assert n_in_table > 20
    assert n_in_arm > 2


def trench(steep: float, *, is_pit: bool) -> tuple[Solid, DistanceGrid]:
    """An organ with a trench along y, or a round pit, whose bottom is at (0.5, 0, 0.03) and 12 mm wide."""
    x, y = np.meshgrid(np.linspace(-0.06, 0.06, 61), np.linspace(-0.06, 0.06, 61))
    beside_m = np.maximum((np.hypot(x, y) if is_pit else np.abs(x)) - 0.006, 0.0)
    z = 0.03 + np.minimum(steep * beside_m**2, 0.05)
    organ = solid_below(np.stack([x + 0.5, y, z], axis=-1), 0.0)
    return organ, DistanceGrid.from_solid(organ)


@pytest.mark.parametrize("turn_deg", [0.0, 90.0])
def test_a_plate_goes_into_a_trench_in_the_turn_in_which_it_fits(tmp_path, cone, turn_deg: float) -> None:
    organ, distance = trench(40.0, is_pit=False)
    anatomy = build_anatomy(organ, name="trench", rng=np.random.default_rng(0))
    # The same plate, modelled across or along the flange's x: which turn fits is not a matter of the file.
    path = probe_file(tmp_path, f'<body euler="0 0 {turn_deg}">{PLATE}</body>')
    scene = build_scene(anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=path))
    search = IkSearch(scene, Clearance(scene, distance))
    (result,) = search.search(np.array([[0.5, 0.0, 0.03]]), np.array([[0.0, 0.0, -1.0]])).results
    assert result.is_reached, result.explain()
    data = mujoco.MjData(scene.model)
    data.qpos[:] = result.q
    mujoco.mj_kinematics(scene.model, data)
    across = data.geom("probe_plate").xmat.reshape(3, 3)[:, 0]
    # Its corners, 20 mm from the beam, lie on the trench's bottom only where the plate lies along it.
    assert abs(across[0]) < 7.0 / 20.0


def test_a_plate_that_fits_in_no_turn_is_refused_at_once(tmp_path, cone) -> None:
    organ, distance = trench(40.0, is_pit=True)
    anatomy = build_anatomy(organ, name="pit", rng=np.random.default_rng(0))
    scene = build_scene(anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=probe_file(tmp_path, PLATE)))
    search = IkSearch(scene, Clearance(scene, distance))
    (result,) = search.search(np.array([[0.5, 0.0, 0.03]]), np.array([[0.0, 0.0, -1.0]])).results
    assert (result.status, result.n_iterations) == (IkStatus.COLLISION, 0)
    assert "However the arm stands, probe_plate penetrates organ" in result.explain()


def test_no_pose_is_refused_at_once_that_some_turn_leaves_free(
    tmp_path, ball_anatomy, ball_distance, cone
) -> None:
    """Tips in and about the ball: the room in the best of 60 turns is never more than what is granted."""
    scene = build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=bent(tmp_path)))
    clearance, rng = Clearance(scene, ball_distance), np.random.default_rng(1)
    directions = rng.normal(size=(25, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frames = np.array([trimesh.geometry.align_vectors((0, 0, 1), each)[:3, :3] for each in directions])
    tips_m = BALL_CENTRE_M + rng.uniform(0.04, 0.09, (25, 1)) * (-directions + 0.6 * rng.normal(size=(25, 3)))
    granted_m, _ = clearance.best_turn_distances(tips_m, frames)
    data = scene.new_data()
    tip = data.site(scene.tip_site)
    R_tip = tip.xmat.reshape(3, 3)
    points_m = np.vstack([dense_points_m(scene, data, geom) for geom in probe_geoms(scene)])
    points_m = (points_m - tip.xpos) @ R_tip
    points_m = points_m[np.linalg.norm(points_m, axis=1) > 0.0081]
    best_m = np.full(25, -np.inf)
    for turn in np.deg2rad(np.arange(0.0, 360.0, 6.0)):
        R_turn = trimesh.transformations.rotation_matrix(turn, (0, 0, 1))[:3, :3]
        world_m = tips_m[:, None] + points_m @ (frames @ R_turn).transpose(0, 2, 1)
        gap_m = np.linalg.norm(world_m - BALL_CENTRE_M, axis=2) - BALL_RADIUS_M
        best_m = np.maximum(best_m, gap_m.min(axis=1))
    is_refused = granted_m < 0.0
    # Of what is refused nothing is free; round geoms are enclosed by half a millimetre here.
    assert best_m[is_refused].max() < 5e-4
    assert is_refused.sum() >= 5
    # What is granted is 36th parts of a turn of what lies 60 mm beside the beam: 5 mm, and no deep pose gets more.
    assert is_refused[best_m < -0.006].all()
    assert (~is_refused).sum() >= 5
