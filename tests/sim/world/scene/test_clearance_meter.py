"""What the clearance meter measures: the distances that there are, of the pairs that joints can change."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import FAR_M, Clearance
from sim.world.scene.clearance_meter import ClearanceMeter
from sim.world.scene.geom_pairs import standing_pairs
from sim.world.scene.scene import build_scene

TURRET = """<mujoco><compiler angle="radian"/><default><geom size="0.03" mass="1"/><joint range="-2 2"/></default>
<worldbody><body name="turret"><joint name="turn"/><geom name="drum" type="cylinder" size="0.05 0.04" pos="0 0 0.045"/>
<body name="reach" pos="0 0 0.4"><joint name="lift" axis="0 1 0"/>
<geom name="bar" type="capsule" fromto="0.1 0 0 0.4 0 0"/><body name="end" pos="0.45 0 0">
<joint name="nod" axis="0 1 0"/><geom name="ball" type="sphere"/><site name="flange" quat="0.7071 0 0.7071 0"/>
</body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def turret(tmp_path_factory, ball_anatomy, cone):
    """A drum that turns 5 mm above the table, whatever its joints do, and an arm on it."""
    path = tmp_path_factory.mktemp("arm") / "turret.xml"
    path.write_text(TURRET)
    return build_scene(ball_anatomy, cone, arm=ArmModel(path=path, base_m=(0.0, 0.3, 0.0)))


def random_q(scene, n: int) -> np.ndarray:
    low, high = scene.model.jnt_range.T
    return np.random.default_rng(0).uniform(low, high, (n, scene.model.nq))


@pytest.mark.parametrize("which", ["scene", "turret"])
def test_no_distance_is_told_too_large(which, request, ball_distance):
    """MuJoCo chose its pairs by the margins of bodies, which were left at none: links seemed up to 57 mm too far."""
    scene = request.getfixturevalue(which)
    meter, q = ClearanceMeter(scene, Clearance(scene, ball_distance)), random_q(scene, 400)
    told_m = np.minimum(meter.measure(q).contact_m, FAR_M)
    true_m = np.minimum(meter.with_padding(1e-3).measure(q).contact_m, FAR_M)
    is_free = true_m > 0.0
    # Both arms are of shapes whose contacts MuJoCo tells to half a millimetre.
    assert (np.abs(told_m - true_m)[is_free] < 1e-3).all()
    assert (told_m[is_free] < FAR_M).sum() > 20


def test_a_distance_that_no_joint_changes_counts_only_as_an_overlap(turret, ball_distance):
    model = turret.model
    drum, table = model.geom("arm_drum").id, model.body("table").geomadr[0]
    assert (min(drum, table), max(drum, table)) in standing_pairs(model)
    data = turret.new_data()
    mujoco.mj_kinematics(model, data)
    assert mujoco.mj_geomDistance(model, data, drum, table, 1.0, None) == pytest.approx(0.005)
    meter = ClearanceMeter(turret, Clearance(turret, ball_distance))
    for each in (meter, meter.with_padding(0.02)):
        found = each.measure(turret.home_q[None])
        assert found.is_free.all()
        assert found.contact_m[0] > 0.02
        sunk = each.at_base(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0.3], [0, 0, 1, -0.01], [0, 0, 0, 1]]))
        assert sunk.measure(turret.home_q[None]).contact_m[0] == pytest.approx(-0.005, abs=1e-6)
