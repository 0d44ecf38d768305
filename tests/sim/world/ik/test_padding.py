"""Padding: the room that every answer keeps, by an independent distance, and what more of it does."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from sim.world.ik.kinematics import Kinematics
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import FAR_M, Clearance
from sim.world.scene.geom_pairs import GeomPairs
from sim.world.scene.scene import build_scene
from tests.helpers.convex_distance import convex_distance_m, projected

BOXES = """<mujoco model="boxes">
<default><geom type="box" contype="1" conaffinity="1" mass="1"/>
<joint axis="0 1 0" range="-150 150" limited="true"/></default>
<worldbody><body name="post"><geom name="post" size="0.05 0.05 0.15" pos="0 0 0.2"/>
<body name="shoulder" pos="0 0 0.42"><joint name="turn" axis="0 0 1"/><joint name="lift"/>
<geom name="upper" size="0.18 0.06 0.05" pos="0.2 0 0"/>
<body name="elbow" pos="0.45 0 0"><joint name="bend"/><geom name="fore" size="0.16 0.05 0.04" pos="0.18 0 0"/>
<body name="wrist" pos="0.4 0 0"><joint name="roll" axis="1 0 0"/><joint name="nod"/>
<geom name="cuff" type="cylinder" size="0.03 0.02"/><site name="flange" quat="0.7071 0 0.7071 0"/>
</body></body></body></body></worldbody></mujoco>"""
APART = (("post", "fore"), ("post", "cuff"), ("upper", "cuff"))
"""Geoms of the arm that no joint and no exclusion keeps out of each other's way."""
CENTRE_M, RADIUS_M = np.array([0.5, 0.0, 0.06]), 0.06


@pytest.fixture(scope="module")
def boxes(tmp_path_factory, ball_anatomy, cone):
    path = tmp_path_factory.mktemp("arm") / "boxes.xml"
    path.write_text(BOXES)
    return build_scene(ball_anatomy, cone, arm=ArmModel(path=path))


@pytest.fixture(scope="module")
def box_search(boxes, ball_distance):
    return IkSearch(boxes, Clearance(boxes, ball_distance), IkSettings(max_restarts=11))


def poses(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses all over the ball, also such as bring the arm near to the table."""
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(n, 3))
    normals[:, 2] = -np.abs(normals[:, 2]) - 0.2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return CENTRE_M - RADIUS_M * normals, normals


def padded(search: IkSearch, padding_m: float) -> IkSearch:
    return search.with_settings(dataclasses.replace(search.settings, padding_m=padding_m))


def colliding(model: mujoco.MjModel, *bodies: str) -> list[int]:
    """Geoms of some bodies that take part in collisions."""
    return [
        geom
        for geom in range(model.ngeom)
        if model.body(int(model.geom_bodyid[geom])).name in bodies and model.geom_contype[geom]
    ]


def independent_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Pairs that must keep the padding, told by what the arm is: links apart, and all that moves over the table."""
    table = colliding(model, "table")
    moving = colliding(model, "arm_shoulder", "arm_elbow", "arm_wrist", "probe_probe")
    probe = colliding(model, "probe_probe")
    of_arm = [(model.geom(f"arm_{a}").id, model.geom(f"arm_{b}").id) for a, b in APART]
    with_probe = [(model.geom(f"arm_{name}").id, geom) for name in ("post", "upper") for geom in probe]
    return [*of_arm, *with_probe, *((a, b) for a in table for b in moving)]


@pytest.mark.parametrize("padding_m", [0.008, 0.025])
def test_every_answer_keeps_the_padding_by_an_independent_distance(boxes, box_search, padding_m):
    model, data = boxes.model, boxes.new_data()
    answers = padded(box_search, padding_m).search(*poses(24))
    assert answers.is_reached.sum() > 5
    pairs = independent_pairs(model)
    links = colliding(model, "arm_shoulder", "arm_elbow", "arm_wrist")
    for result in (answers.results[row] for row in np.flatnonzero(answers.is_reached)):
        for q in (result.q, result.q_standoff):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            for first, second in pairs:
                # What lies farther apart than the spheres around it is not looked at.
                far_m = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second])
                if far_m - model.geom_rbound[first] - model.geom_rbound[second] < padding_m:
                    # Both distances are within a micrometre.
                    assert convex_distance_m(model, data, first, second) >= padding_m - 2e-6
            for link in links:
                assert distance_to_ball_m(model, data, link) >= padding_m


def distance_to_ball_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """How far a geom is from the ball [m]; the organ's triangles lie in it and are no nearer."""
    return float(np.linalg.norm(projected(model, data, geom, CENTRE_M) - CENTRE_M)) - RADIUS_M


def test_more_padding_never_reaches_more(box_search):
    reached = [padded(box_search, mm * 1e-3).search(*poses(80)).is_reached for mm in (0, 3, 10, 30)]
    for less, more in pairwise(reached):
        assert not (more & ~less).any()
    assert reached[-1].sum() < reached[0].sum()


def test_no_padding_is_the_search_as_it_was(box_search):
    plain, none = box_search.search(*poses(20)), padded(padded(box_search, 0.02), 0.0).search(*poses(20))
    np.testing.assert_array_equal(plain.q, none.q)
    np.testing.assert_array_equal(plain.clearance_m, none.clearance_m)


def test_what_fails_for_want_of_padding_says_which_pair_is_too_near(box_search):
    plain, wide = box_search.search(*poses(80)), padded(box_search, 0.03).search(*poses(80))
    lost = np.flatnonzero(plain.is_reached & ~wide.is_reached)
    details = [wide.results[row].detail for row in lost]
    assert any("comes too close to" in detail for detail in details)
    kept = ~plain.is_reached
    assert [wide.results[row].detail for row in np.flatnonzero(kept)] == [
        plain.results[row].detail for row in np.flatnonzero(kept)
    ]


def test_kinematics_keeps_the_padding_after_mink(boxes, ball_distance):
    settings = IkSettings(max_restarts=11, padding_m=0.025)
    kinematics = Kinematics(boxes, Clearance(boxes, ball_distance), settings)
    answers = [answer for answer in kinematics.solve_many(*poses(15)) if answer.is_reached]
    assert len(answers) > 3
    for answer in answers:
        assert kinematics.search.meter.measure(np.stack([answer.q, answer.q_standoff])).is_free.all()


def test_the_pairs_are_those_between_which_mujoco_finds_contacts(scene, boxes):
    for each in (scene, boxes):
        model, data = each.model, each.new_data()
        rng, pairs = np.random.default_rng(1), GeomPairs(each.model)
        n_touching = 0
        for _ in range(300):
            data.qpos[:] = each.home_q + rng.uniform(-1.5, 1.5, model.nq)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            touches = data.ncon > 0 and float(data.contact.dist.min()) < -1e-4
            least_m, geoms = pairs.least_distance(model, data, FAR_M)
            # Contacts and distances agree about depth to far less than this.
            assert touches == (least_m < -1e-4) or abs(least_m) < 1e-3
            if touches and least_m < -1e-3:
                found = {tuple(sorted(pair)) for pair in data.contact.geom.tolist()}
                assert geoms in found
                n_touching += 1
        assert n_touching > 10


def test_distances_of_pairs_are_true_where_contacts_with_a_margin_are_not():
    turned = "0.9 0.3 0.2 0.25"
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom name="a" type="box" size="0.05 0.04 0.03"/><body name="b" pos="0.13 0.03 0.02">'
        f'<joint/><geom name="b" type="box" size="0.05 0.04 0.03" quat="{turned}"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    for angle_rad in np.linspace(-0.8, 0.8, 17):
        data.qpos[0] = angle_rad
        mujoco.mj_kinematics(model, data)
        true_m = convex_distance_m(model, data, 0, 1)
        assert true_m > 5e-3
        assert GeomPairs(model).least_distance(model, data, FAR_M)[0] == pytest.approx(true_m, abs=2e-6)


def test_a_padding_out_of_range_is_refused():
    for padding_m in (-1e-3, 0.031, float("nan")):
        with pytest.raises(ValueError, match="padding_m="):
            IkSettings(padding_m=padding_m)
