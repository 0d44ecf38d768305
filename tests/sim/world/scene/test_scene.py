"""The composed world: groups, any arm, the cone, the free probe."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim.world.scene.arm import ArmModel
from sim.world.scene.scene import Group, build_scene

ARM_IN_ODD_GROUPS = """<mujoco><worldbody><body name="a"><joint name="j1" axis="0 0 1" range="-1 1" limited="true"/>
<geom name="visual" size="0.05" group="4"/><geom name="hull" size="0.05" group="5"/>
<body name="b" pos="0.3 0 0"><joint name="j2" axis="0 1 0"/><geom size="0.04"/><site name="end" pos="0 0 0.1"/></body>
</body></worldbody></mujoco>"""


def test_everything_is_there_and_in_its_group(ball_anatomy, cone) -> None:
    model = build_scene(ball_anatomy, cone, arm=ArmModel()).model
    group = {model.geom(i).name: int(model.geom_group[i]) for i in range(model.ngeom)}
    assert group["organ"] == Group.ORGAN
    assert [group[f"tumour{i}"] for i in range(3)] == [Group.TUMOUR] * 3
    assert group["table"] == Group.SCENERY
    assert group["arm_link7"] == group["probe_head"] == Group.ARM
    assert model.nu == 7


def test_meshes_lie_where_the_anatomy_says(ball_anatomy, cone) -> None:
    """MuJoCo moves a mesh to its own frame; rays must still find the ball's true surface."""
    scene = build_scene(ball_anatomy, cone, arm=None)
    data, geom = scene.new_data(), np.empty(1, np.int32)
    groups = np.zeros(6, np.uint8)
    groups[Group.ORGAN] = 1
    for direction in np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0].T.copy():
        start_m = np.array([0.5, 0.0, 0.06]) - 0.2 * direction
        gap_m = mujoco.mj_ray(scene.model, data, start_m, direction, groups, 1, -1, geom)
        assert gap_m == pytest.approx(0.14, abs=2e-4)  # facets lie up to 0.1 mm inside the ball


def test_organ_and_tumours_are_free_of_hull_contacts(ball_anatomy, cone) -> None:
    model = build_scene(ball_anatomy, cone, arm=ArmModel()).model
    for name in ("organ", "tumour0"):
        assert model.geom(name).contype[0] == model.geom(name).conaffinity[0] == 0


def test_the_cone_has_the_volume_of_a_cone(ball_anatomy, cone) -> None:
    model = build_scene(ball_anatomy, cone, arm=None).model
    site = model.site("cone").id
    mesh = model.mesh("cone").id
    first, n = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices_m = model.mesh_vert[first : first + n]
    assert model.site_type[site] == mujoco.mjtGeom.mjGEOM_MESH
    assert np.ptp(vertices_m, axis=0).max() == pytest.approx(cone.depth_m, rel=1e-5)
    rim_m = cone.depth_m * np.tan(cone.half_angle_rad)
    assert np.sort(np.ptp(vertices_m, axis=0))[:2] == pytest.approx([2 * rim_m] * 2, rel=1e-5)


def test_any_arm_is_kept_out_of_the_groups_that_rays_ask_for(ball_anatomy, cone, tmp_path) -> None:
    path = tmp_path / "odd.xml"
    path.write_text(ARM_IN_ODD_GROUPS)
    model = build_scene(ball_anatomy, cone, arm=ArmModel(path=path, flange="end")).model
    of_arm = [i for i in range(model.ngeom) if model.body(model.geom_bodyid[i]).name.startswith("arm_")]
    assert len(of_arm) == 3
    assert not {int(model.geom_group[i]) for i in of_arm} & {Group.ORGAN, Group.TUMOUR}


def test_the_base_stands_where_it_is_put(ball_anatomy, cone) -> None:
    T_world_base = np.array([[0.0, -1, 0, 0.2], [1, 0, 0, -0.3], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    arm = ArmModel(base_m=(0.2, -0.3, 0.1), base_yaw_rad=np.pi / 2)
    scene = build_scene(ball_anatomy, cone, arm=arm)
    origin = build_scene(ball_anatomy, cone, arm=ArmModel())
    tip_m = origin.new_data().site("probe_tip").xpos
    moved_m = scene.new_data().site("probe_tip").xpos
    np.testing.assert_allclose(moved_m, T_world_base[:3, :3] @ tip_m + T_world_base[:3, 3], atol=1e-9)


def test_home_touches_nothing(ball_anatomy, cone) -> None:
    assert build_scene(ball_anatomy, cone, arm=ArmModel()).new_data().ncon == 0
