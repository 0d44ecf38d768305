"""The surface of a probe of one's own: its points, its face, how it lies about its beam, and its room at the flange."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from geom_surface import geom_triangles
from probe_files import PLAIN, bent, bent_mesh, probe_file

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.ik.chain import Chain
from sim.world.motion.path_check import PathCheck
from sim.world.probes.probe import ProbeModel
from sim.world.scene.arm import MODELS_DIR, ArmError, ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.clearance_meter import ClearanceMeter
from sim.world.scene.probe_surface import FACE_RADIUS_M, ProbeSurface
from sim.world.scene.scene import Scene, build_scene

BALL_TOP_M = np.array([0.5, 0.0, 0.12])
DOWN = np.diag([1.0, -1.0, -1.0])
END = '<site name="tip" pos="0 0 0.12"/>'
BLOCK = '<geom name="block" type="box" size="0.03 0.02 0.05" pos="0 0 0.05"/><site name="tip" pos="0 0 0.1"/>'
"""A probe with a flat face of 60 by 40 mm."""


@pytest.fixture
def free(tmp_path, ball_anatomy, cone):
    """Makes the scene of a probe that flies freely."""

    def make(body: str) -> Scene:
        return build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=probe_file(tmp_path, body)))

    return make


def surface(scene: Scene) -> ProbeSurface:
    tip = scene.model.site(scene.tip_site).id
    return ProbeSurface(scene.model, sorted(scene.arm_geoms), tip, is_own=scene.has_own_probe)


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_points_stand_for_all_of_the_probe_but_its_face(tmp_path, ball_anatomy, cone, make) -> None:
    scene = build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=make(tmp_path)))
    model, found = scene.model, surface(scene)
    for geom in scene.arm_geoms:
        corners_m = geom_triangles(model, geom).reshape(-1, 3)
        faces = np.arange(len(corners_m)).reshape(-1, 3)
        dense_m, _ = trimesh.remesh.subdivide_to_size(corners_m, faces, 0.006)
        in_body_m = trimesh.transform_points(dense_m, _T(model.geom_pos[geom], model.geom_quat[geom]))
        tip = model.site(scene.tip_site)
        in_tip_m = trimesh.transform_points(in_body_m, np.linalg.inv(_T(tip.pos, tip.quat)))
        if model.geom(geom).name == "probe_face":
            assert geom not in found.in_tip_m  # the whole geom may touch
            continue
        is_flank = np.linalg.norm(in_tip_m, axis=1) > (0.0 if make is bent_mesh else FACE_RADIUS_M + 0.004)
        away_m = [np.linalg.norm(found.in_tip_m[geom] - each, axis=1).min() for each in in_tip_m[is_flank]]
        # Points 4 mm apart, and half a millimetre for round geoms, which the test encloses more widely.
        assert max(away_m) < 0.004 + 5e-4
        assert np.linalg.norm(in_tip_m, axis=1).max() < found.reach_m + 1e-3


def _T(at_m: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    T = trimesh.transformations.quaternion_matrix(quaternion)
    T[:3, 3] = at_m
    return T


@pytest.mark.parametrize(
    ("face", "is_free"),
    [
        ("", False),  # the ball's top, pressed 1 mm in, is 22 mm wide, and the default face 16 mm
        ('<site name="face" type="sphere" size="0.03" pos="0 0 0.1"/>', True),
        ('<site name="face" type="box" size="0.03 0.02 0.002" pos="0 0 0.1"/>', True),
        ('<site name="face" type="sphere" size="0.004" pos="0 0 0.1"/>', False),
        # A named face that is elsewhere is none at the tip.
        ('<geom name="face" size="0.01" pos="0 0 0.01"/>', False),
    ],
)
def test_what_may_touch_the_organ_is_the_face(free, ball_distance, face: str, is_free: bool) -> None:
    clearance = Clearance(free(BLOCK + face), ball_distance)
    distance_m, geom = clearance.probe_distances((BALL_TOP_M - [0.0, 0.0, 0.001])[None], DOWN[None])
    assert (distance_m[0] >= 0.0) == is_free
    if not is_free:
        assert distance_m[0] == pytest.approx(-0.0005, abs=5e-4)  # between 1 mm at the top and 0 at the rim
        assert clearance.name(int(geom[0])) == "probe_block"


def test_a_geom_named_face_may_touch_as_a_whole(free, ball_distance) -> None:
    shaft = '<geom name="shaft" type="capsule" size="0.02" fromto="0 0 0 0 0 0.05"/>'
    clearance = Clearance(free(BLOCK.replace('"block"', '"face"') + shaft), ball_distance)
    at_m = (BALL_TOP_M - [0.0, 0.0, 0.005])[None]
    assert (
        clearance.probe_distances(at_m, DOWN[None])[0][0]
        >= 0.0
        > clearance.organ_distance.distance_m(at_m)[0]
    )
    # The shaft, which is no face, ends 30 mm above the tip and enters where that is 40 mm deep.
    deeper_m = (BALL_TOP_M - [0.0, 0.0, 0.04])[None]
    distance_m, geom = clearance.probe_distances(deeper_m, DOWN[None])
    assert distance_m[0] < 0.0
    assert clearance.name(int(geom[0])) == "probe_shaft"


@pytest.mark.parametrize(
    ("body", "is_round"),
    [
        (PLAIN + '<site name="tip" pos="0 0 0.12"/>', True),
        (PLAIN + END + '<geom type="ellipsoid" size="0.03 0.03 0.01" pos="0 0 0.1"/>', True),
        (PLAIN + END + '<geom type="ellipsoid" size="0.03 0.02 0.01" pos="0 0 0.1"/>', False),
        (PLAIN + '<site name="tip" pos="0.001 0 0.12"/>', False),
        (PLAIN + END + '<site name="face" type="box" size="0.01 0.01 0.01" pos="0 0 0.12"/>', False),
        (BLOCK, False),
        (f'<body euler="0 30 0">{PLAIN}<site name="tip" pos="0 0 0.12"/></body>', True),
    ],
)  # fmt: skip
def test_a_probe_is_round_that_is_the_same_in_all_turns_about_its_beam(
    free, body: str, is_round: bool
) -> None:
    assert surface(free(body)).is_round == is_round


def test_the_face_of_a_probe_is_as_large_as_its_outline_along_the_beam(free) -> None:
    flat = BLOCK + '<site name="face" type="box" size="0.03 0.02 0.002" pos="0 0 0.1"/>'
    assert np.pi * surface(free(flat)).face_radius_m ** 2 == pytest.approx(0.06 * 0.04, rel=1e-6)
    ball = '<geom name="face" size="0.015" pos="0 0 0.1"/><site name="tip" pos="0 0 0.115"/>'
    # A ball's points are those of a polyhedron around it, 0.2 mm or less outside it.
    assert surface(free(ball)).face_radius_m == pytest.approx(0.015, abs=4e-4)
    assert surface(free(BLOCK)).face_radius_m == FACE_RADIUS_M


def test_the_embedded_probe_given_as_a_file_is_as_far_from_the_organ(
    ball_anatomy, ball_distance, cone
) -> None:
    own = ProbeModel(path=MODELS_DIR / "probe.xml")
    embedded, given = (
        Clearance(build_scene(ball_anatomy, cone, arm=None, **more), ball_distance)
        for more in ({}, {"probe": own})
    )
    assert given.probe.is_round
    rng = np.random.default_rng(0)
    tips_m = BALL_TOP_M + rng.uniform(-0.002, 0.002, (50, 3))
    frames = np.array(
        [
            trimesh.transformations.euler_matrix(np.pi + a, b, 0.0)[:3, :3]
            for a, b in rng.uniform(-1.5, 1.5, (50, 2))
        ]
    )
    distances_m = [each.probe_distances(tips_m, frames)[0] for each in (embedded, given)]
    # Its points are up to some 5 mm apart along the handle, those of a user's file 4 mm.
    np.testing.assert_allclose(*(np.minimum(each, 0.003) for each in distances_m), atol=1.5e-3)


def test_a_free_probe_stands_with_its_tip_on_the_pose_and_its_beam_along_the_normal(
    tmp_path, ball_anatomy, cone
) -> None:
    scene = build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=bent(tmp_path)))
    normal = np.array([0.36, -0.48, -0.8])
    positioner = FreePositioner(scene, Workspace(BALL_TOP_M[None], normal[None]))
    data = scene.new_data()
    for is_lifted, at_m in ((False, BALL_TOP_M), (True, BALL_TOP_M - 0.04 * normal)):
        positioner.place(data, 0, is_lifted=is_lifted)
        tip = data.site(scene.tip_site)
        np.testing.assert_allclose(tip.xpos, at_m, atol=1e-12)
        np.testing.assert_allclose(tip.xmat.reshape(3, 3)[:, 2], normal, atol=1e-12)


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_the_spheres_of_the_path_check_hold_the_whole_probe(
    tmp_path, ball_anatomy, ball_distance, cone, make
) -> None:
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=make(tmp_path)))
    clearance = Clearance(scene, ball_distance)
    check = PathCheck(scene, Chain(scene), ClearanceMeter(scene, clearance), clearance)
    model, tip = scene.model, scene.model.site(scene.tip_site)
    for geom in scene.arm_geoms:
        if model.geom_bodyid[geom] != tip.bodyid[0]:
            continue
        corners_m = geom_triangles(model, geom).reshape(-1, 3)
        faces = np.arange(len(corners_m)).reshape(-1, 3)
        dense_m, _ = trimesh.remesh.subdivide_to_size(corners_m, faces, 0.008)
        in_body_m = trimesh.transform_points(dense_m, _T(model.geom_pos[geom], model.geom_quat[geom]))
        in_tip_m = trimesh.transform_points(in_body_m, np.linalg.inv(_T(tip.pos, tip.quat)))
        away_m = np.linalg.norm(in_tip_m[:, None] - check._probe_at_m, axis=2) - check._probe_radius_m
        assert away_m.min(axis=1).max() < 4e-4  # what the test's own enclosure of round geoms adds
        # And no sphere is so large that lifted probes would seem to touch.
        assert check._probe_radius_m.max() < 0.02


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_a_probe_that_starts_in_the_flange_has_room(tmp_path, ball_anatomy, cone, make) -> None:
    assert (
        build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=make(tmp_path))).notices == ()
    )


def test_a_probe_that_reaches_back_into_the_arm_is_told(tmp_path, ball_anatomy, cone) -> None:
    box = '<geom name="box" type="box" size="0.02 0.02 0.15"/><site name="tip" pos="0 0 0.15"/>'
    (notice,) = build_scene(
        ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=probe_file(tmp_path, box))
    ).notices
    assert "reaches 150 mm behind its mount" in notice


FINGERS = """<mujoco><compiler angle="radian" autolimits="true"/>
<default><geom type="capsule" size="0.03" mass="1"/><joint axis="0 1 0" range="-2 2"/></default>
<worldbody><body name="post"><geom fromto="0 0 0.05 0 0 0.3"/>
 <body name="upper" pos="0 0 0.42"><joint name="turn" axis="0 0 1"/><joint name="lift"/>
  <geom fromto="0.02 0 0 0.38 0 0"/>
  <body name="fore" pos="0.45 0 0"><joint name="bend"/><geom fromto="0.02 0 0 0.3 0 0"/>
   <body name="wrist" pos="0.4 0 0"><joint name="roll" axis="1 0 0"/><joint name="nod"/>
    <geom type="sphere" size="0.02"/>
    <site name="flange" pos="0.03 0 0" quat="0.7071068 0 0.7071068 0"/>
    <body name="finger" pos="{at}"><joint type="slide" axis="0 1 0" range="0 0.02"/>
     <geom type="box" size="0.02 0.004 0.01"/></body></body></body></body></body></worldbody></mujoco>"""
"""An arm whose flange looks along +x, with a finger 10 mm beside a place in the wrist's frame."""


@pytest.mark.parametrize(
    ("at", "is_refused"), [("0.13 -0.01 0", True), ("0.13 0.04 0", False), ("0.13 0.0 0.06", False)]
)
def test_a_mesh_that_stands_in_a_finger_is_refused(
    tmp_path, ball_anatomy, cone, at: str, is_refused: bool
) -> None:
    """The upright mesh is 30 by 20 mm and 100 mm long; the bent one next to it would reach 60 mm to a side."""
    (tmp_path / "arm.xml").write_text(FINGERS.format(at=at))
    arm, probe = ArmModel(path=tmp_path / "arm.xml"), ProbeModel(path=bent_mesh(tmp_path))
    if not is_refused:
        assert mujoco.mj_name2id(
            build_scene(ball_anatomy, cone, arm=arm, probe=probe).model,
            mujoco.mjtObj.mjOBJ_BODY,
            "probe_probe",
        )
        return
    # The finger lies in the mesh's middle, whose sides are 10 mm away; the finger's points are up to 4 mm apart.
    with pytest.raises(ArmError, match=r"overlaps finger, which moves with the flange, by (8|9|10) mm"):
        build_scene(ball_anatomy, cone, arm=arm, probe=probe)
