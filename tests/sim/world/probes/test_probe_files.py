"""Probe files: what MuJoCo makes of them is what a scene has, and what cannot be used is refused with the remedy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from probe_files import PLAIN, bent, bent_mesh, probe_file

from sim.world.frames import quaternion_matrix
from sim.world.probes.errors import ProbeError
from sim.world.probes.probe import EMBEDDED, ProbeModel, named_probe
from sim.world.probes.rigid_probe import KINDS
from sim.world.scene.arm import MODELS_DIR, ArmModel
from sim.world.scene.scene import build_scene

TIP = '<site name="tip" pos="0 0 0.12"/>'
MM = PLAIN.replace("0.02", "20").replace("0.1", "100") + '<site name="tip" pos="0 0 120"/>'
TINY = '<geom size="0.00001"/><site name="tip" pos="0 0 0.00001"/>'
VISUAL = PLAIN.replace("/>", ' contype="0" conaffinity="0"/>') + TIP
TWO_JOINTS = f'<body><joint name="a" type="slide"/><joint name="b"/>{PLAIN}{TIP}</body>'
MESH = '<asset><mesh name="m" file="gone.stl"/></asset>'


@pytest.mark.parametrize(
    ("body", "extra", "message"),
    [
        (PLAIN, "", "no site named tip.*sites: none.*Add <site"),
        (PLAIN + '<site name="nose"/>', "", "no site named tip.*sites: nose"),
        (PLAIN + '<site name="tip" pos="0 0 0.08"/>', "", "own geom shaft within 40.0 mm.*lies inside.*Put the site"),
        (PLAIN + '<site name="tip" pos="0 0 0.12" euler="180 0 0"/>', "", "own geom shaft.*looks back into it"),
        (PLAIN + '<site name="tip" pos="0.02 0 0.05" euler="0 -60 0"/>', "", "own geom shaft.*looks back into it"),
        (TWO_JOINTS, "", "has 2 joints .a, b.*rigid.*`arm`"),
        (f"<body><freejoint/>{PLAIN}{TIP}</body>", "", "has 1 joint.*Remove the joints"),
        (TIP, "", "has no geoms.*Add the probe's shape"),
        (VISUAL, "", "no geom that collides"),
        (PLAIN + TIP + '<geom name="floor" type="plane" size="1 1 1"/>', "", "floor is a plane.*Remove it"),
        (MM, "", "reaches over 140 m.*at most 1 m.*scale"),
        (TINY, "", "0.02 mm long, at least 10 mm.*scaled twice"),
        (PLAIN.replace("0.1", "nan") + TIP, "", "probe.xml: "),
        ('<geom type="mesh" mesh="m"/>' + TIP, MESH, "gone.stl.*Put it there, or name its folder as meshdir"),
        (PLAIN + TIP + '<site name="face" type="mesh" mesh="m"/>', MESH, "probe.xml: "),
        (PLAIN + TIP + "</body>", "", "cannot compile this probe"),
    ],
)  # fmt: skip
def test_a_probe_that_cannot_be_used_is_refused_with_the_value_and_the_remedy(
    tmp_path, body: str, extra: str, message: str
) -> None:
    path = probe_file(tmp_path, body, extra)
    with pytest.raises(ProbeError, match=message) as caught:
        ProbeModel(path=path).load()
    assert str(path) in str(caught.value)


def test_what_is_no_probe_file_is_named(tmp_path) -> None:
    (tmp_path / "folder.xml").mkdir()
    for name, text in (("head.stl", "solid"), ("notes.txt", "hello"), ("page.xml", "<html/>")):
        (tmp_path / name).write_text(text)
    for name, message in (
        ("folder.xml", "this is a folder"),
        ("gone.xml", "no such probe file.*`probe`"),
        ("head.stl", "a mesh, which has no tip"),
        ("notes.txt", "reads probes from .xml and .urdf"),
        ("page.xml", "cannot compile this probe"),
        ("x" * 300, "no such probe file"),
    ):
        with pytest.raises(ProbeError, match=message):
            ProbeModel(path=tmp_path / name).load()
    with pytest.raises(ProbeError, match="`probe` defualt: no probe of that name.*Did you mean default"):
        named_probe("defualt")
    with pytest.raises(ProbeError, match="7 joints .joint1.*`arm`"):
        ProbeModel(path=MODELS_DIR / "arm.xml").load()


def test_a_tip_that_touches_nothing_is_told(tmp_path) -> None:
    for at, told in (
        ("0 0 0.15", "30 mm in front of the probe's geom shaft"),
        ("0.1 0 0.05", "nothing of the probe"),
    ):
        path = probe_file(tmp_path, PLAIN + f'<site name="tip" pos="{at}"/>')
        (notice,) = ProbeModel(path=path).load().notices
        assert told in notice
    assert ProbeModel(path=bent(tmp_path)).load().notices == ()


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_the_probe_in_a_scene_is_that_of_its_file(tmp_path, ball_anatomy, cone, make) -> None:
    path = make(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=path))
    data, own = scene.new_data(), mujoco.MjData(model)
    mujoco.mj_forward(model, own)
    flange = data.site("arm_flange")
    R = flange.xmat.reshape(3, 3)
    for geom in range(model.ngeom):
        ours = data.geom(f"probe_{model.geom(geom).name}")
        # MuJoCo keeps meshes in single precision.
        np.testing.assert_allclose(ours.xpos, flange.xpos + R @ own.geom_xpos[geom], atol=1e-7)
        if model.geom_dataid[geom] < 0:
            np.testing.assert_allclose(
                ours.xmat.reshape(3, 3), R @ own.geom_xmat[geom].reshape(3, 3), atol=1e-9
            )
    tip = data.site(scene.tip_site)
    np.testing.assert_allclose(tip.xpos, flange.xpos + R @ own.site("tip").xpos, atol=1e-9)
    np.testing.assert_allclose(tip.xmat.reshape(3, 3), R @ own.site("tip").xmat.reshape(3, 3), atol=1e-9)
    # Mass and moments about the flange's axes: a free body of the file's own has the same.
    body = scene.model.body("probe_probe")
    assert body.mass[0] == pytest.approx(model.body_mass.sum(), rel=1e-9)
    mujoco.mj_comPos(model, own)
    np.testing.assert_allclose(body.ipos, own.subtree_com[0], atol=1e-9)
    axes = quaternion_matrix(body.iquat)
    moments = axes @ np.diag(body.inertia) @ axes.T
    ours, theirs = np.sort(np.linalg.eigvalsh(moments)), np.sort(np.linalg.eigvalsh(_moments(model, own)))
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)


def _moments(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """The moments about the common centre, from many points of equal mass in each body's ellipsoid of inertia."""
    centre_m, total = data.subtree_com[0], np.zeros((3, 3))
    for body in range(1, model.nbody):
        a, b, c = model.body_inertia[body]
        # Six points on the principal axes, with the second moments of the body.
        second = np.array([b + c - a, a + c - b, a + b - c]) / 2.0 / max(model.body_mass[body], 1e-12)
        R = data.ximat[body].reshape(3, 3)
        for axis in range(3):
            for sign in (-1.0, 1.0):
                at_m = data.xipos[body] + sign * R[:, axis] * np.sqrt(3.0 * max(second[axis], 0.0)) - centre_m
                total += model.body_mass[body] / 6.0 * (at_m @ at_m * np.eye(3) - np.outer(at_m, at_m))
    return total


@pytest.mark.parametrize("make", [bent, bent_mesh])
def test_the_text_of_a_probe_is_a_probe_file_of_the_same_probe(tmp_path, make) -> None:
    probe = ProbeModel(path=make(tmp_path)).load()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "kept.xml").write_text(probe.mjcf())
    again = ProbeModel(path=elsewhere / "kept.xml").load()
    np.testing.assert_allclose(again.tip.at_m, probe.tip.at_m, atol=1e-12)
    for one, other in zip(probe.geoms, again.geoms, strict=True):
        assert (one.name, one.group, one.collides) == (other.name, other.group, other.collides)
        np.testing.assert_allclose(one.rgba, other.rgba)
        if one.vertices_m is None:
            np.testing.assert_allclose(one.shape.at_m, other.shape.at_m, atol=1e-12)
            np.testing.assert_allclose(one.shape.size_m, other.shape.size_m, atol=1e-12)
            continue
        placed = [
            np.sort(each.shape.at_m + each.vertices_m @ quaternion_matrix(each.shape.quaternion).T, axis=0)
            for each in (one, other)
        ]
        np.testing.assert_allclose(*placed, atol=1e-7)  # single precision


def test_names_of_the_arm_and_of_the_scene_may_be_those_of_the_probe(tmp_path, ball_anatomy, cone) -> None:
    geoms = (
        PLAIN + '<geom name="organ" size="0.01"/><geom name="link3_elbow" size="0.01"/><site name="flange"/>'
    )
    path = probe_file(tmp_path, f'<body name="link3">{geoms}<body name="mount">{TIP}</body></body>')
    model = build_scene(ball_anatomy, cone, arm=ArmModel(), probe=ProbeModel(path=path)).model
    assert (
        model.geom("probe_link3_elbow").bodyid
        == model.geom("probe_organ").bodyid
        == model.body("probe_probe").id
    )


def test_geoms_without_a_name_get_one_that_is_free(tmp_path) -> None:
    path = probe_file(tmp_path, f'<geom size="0.01"/><geom name="geom0" size="0.01"/>{PLAIN}{TIP}')
    assert [geom.name for geom in ProbeModel(path=path).load().geoms] == ["geom0_", "geom0", "shaft"]


def test_a_link_named_tip_is_the_tip_of_a_urdf(tmp_path) -> None:
    path = tmp_path / "probe.urdf"
    path.write_text(
        '<robot name="p"><link name="base"><collision><origin xyz="0 0 0.05"/><geometry>'
        '<cylinder radius="0.02" length="0.1"/></geometry></collision></link><link name="tip"/>'
        '<joint name="j" type="fixed"><parent link="base"/><child link="tip"/><origin xyz="0 0 0.1"/></joint></robot>'
    )
    probe = ProbeModel(path=path).load()
    np.testing.assert_allclose(probe.tip.at_m, (0.0, 0.0, 0.1), atol=1e-12)
    assert [KINDS[geom.shape.kind] for geom in probe.geoms] == ["cylinder"]


def test_what_is_drawn_and_what_collides_is_as_the_file_says(tmp_path, ball_anatomy, cone) -> None:
    path = probe_file(
        tmp_path,
        PLAIN.replace("/>", ' group="3"/>')
        + '<geom name="shown" size="0.01" contype="0" conaffinity="0" material="red" group="4"/>'
        + TIP,
        '<asset><material name="red" rgba="1 0 0 1"/></asset>',
    )
    model = build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=path)).model
    shown, shaft = model.geom("probe_shown"), model.geom("probe_shaft")
    assert (shown.group[0], shown.contype[0], shaft.group[0], shaft.contype[0]) == (2, 0, 3, 1)
    np.testing.assert_allclose(shown.rgba, (1.0, 0.0, 0.0, 1.0))


def test_a_probe_all_of_whose_geoms_are_hidden_is_drawn(tmp_path, ball_anatomy, cone) -> None:
    path = probe_file(tmp_path, PLAIN.replace("/>", ' group="3"/>') + TIP)
    model = build_scene(ball_anatomy, cone, arm=None, probe=ProbeModel(path=path)).model
    assert model.geom("probe_shaft").group[0] == 2


def test_the_embedded_probe_is_put_in_as_its_file_has_it() -> None:
    assert named_probe("default") is EMBEDDED
    assert EMBEDDED.load() is None
