"""The chain, the descent and the search of many poses: against MuJoCo, planted truths, and the limits."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.world.ik.chain import Chain
from sim.world.ik.damped_least_squares import AXIS_WEIGHT_M, CENTRING_GAIN, DAMPING, ERROR_DAMPING, descend
from sim.world.ik.result import IkStatus
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.ik.start_rounds import Round, StartRounds
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene
from sim.world.solids.distance_grid import DistanceGrid

POSITION_TOLERANCE_M, ANGLE_TOLERANCE_RAD = 1e-3, np.deg2rad(1.0)

SLIDING = """<mujoco><worldbody><body name="a" pos="0.1 0 0.2">
<joint name="rail" type="slide" axis="1 0 0" range="-0.2 0.9"/><geom size="0.03"/>
<body name="b" pos="0 0 0.3"><joint name="turn" axis="0 1 1" pos="0.01 0 0" range="-2 2"/><geom size="0.03"/>
<joint name="tilt" axis="1 0 0" range="-2 2"/>
<body name="finger" pos="0.05 0 0"><joint name="finger" type="slide" range="0 0.02"/><geom size="0.005"/></body>
<body name="c" pos="0 0.2 0.1" quat="0.9 0.1 0.3 0"><joint name="free" axis="0 0 1"/><geom size="0.02"/>
<site name="flange" quat="0.5 0.5 0.5 0.5"/></body></body></body></worldbody></mujoco>"""

GANTRY = """<mujoco><worldbody><body pos="0 0 1"><joint name="rail" type="slide" axis="1 0 0" range="-0.2 0.2"/>
<geom size="0.02"/><body><joint type="slide" axis="0 1 0" range="-0.5 0.5"/><geom size="0.02"/>
<body><joint type="slide" axis="0 0 1" range="-0.9 0"/><geom size="0.02"/>
<site name="flange" quat="0 1 0 0"/></body></body></body></worldbody></mujoco>"""


def free_configurations(search: IkSearch, clearance: Clearance, scene, count: int, seed: int) -> np.ndarray:
    """Random configurations of the whole scene that touch nothing, as `Clearance` alone decides."""
    rng, found, data = np.random.default_rng(seed), [], scene.new_data()
    while len(found) < count:
        data.qpos[:] = rng.uniform(*search.chain.search_range())
        mujoco.mj_kinematics(scene.model, data)
        if clearance.collision(data) is None:
            found.append(data.qpos.copy())
    return np.array(found)


@pytest.mark.parametrize("arm", ["default", "sliding"])
def test_chain_and_jacobian_equal_mujocos(tmp_path, ball_anatomy, cone, arm: str) -> None:
    path = tmp_path / "sliding.xml"
    path.write_text(SLIDING)
    scene = build_scene(ball_anatomy, cone, arm=ArmModel() if arm == "default" else ArmModel(path=path))
    chain, model, data = Chain(scene), scene.model, mujoco.MjData(scene.model)
    assert chain.n_joints == (7 if arm == "default" else 4)  # the finger is beside the chain
    tip = model.site("probe_tip").id
    q = np.random.default_rng(0).uniform(*chain.search_range(), (20, chain.n_joints))
    state = chain.forward(q)
    jacobian = chain.jacobian(state)
    for i in range(len(q)):
        data.qpos[:] = chain.full(q[i])
        mujoco.mj_forward(model, data)
        R = data.site_xmat[tip].reshape(3, 3)
        np.testing.assert_allclose(state.tips_m[i], data.site_xpos[tip], atol=1e-9)
        np.testing.assert_allclose(state.R_world_tip[i], R, atol=1e-9)
        velocity, turning = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacSite(model, data, velocity, turning, tip)
        expected = np.vstack([velocity, (R.T @ turning)[:2]])[:, chain.columns]
        np.testing.assert_allclose(jacobian[i], expected, atol=1e-9)


def test_the_wrists_bound_holds_in_every_configuration(search, scene) -> None:
    chain = search.chain
    state = chain.forward(np.random.default_rng(1).uniform(chain.low, chain.high, (5000, chain.n_joints)))
    assert search.too_far_m(state.tips_m, state.beams).max() <= 0.0


def test_a_descent_never_leaves_the_limits_and_opposite_beams_are_no_trap(search) -> None:
    chain = search.chain
    state = chain.forward(chain.home[None])
    answer = descend(
        chain,
        chain.home[None],
        state.tips_m + np.array([0.0, 0.1, 0.1]),
        -state.beams,
        position_tolerance_m=1e-4,
        angle_tolerance_rad=1e-3,
    )
    assert np.all((answer.q >= chain.low) & (answer.q <= chain.high))
    assert answer.angle_rad[0] < 1.0  # it started at pi, where the direction to turn is undefined


def test_a_step_minimises_what_the_module_says(search) -> None:
    """Against NumPy's least squares of the two terms stacked, with the turn of the beam by SciPy."""
    chain = search.chain
    low, high = chain.low, chain.high
    q = np.random.default_rng(2).uniform(
        low + 0.3 * (high - low), high - 0.3 * (high - low), (30, chain.n_joints)
    )
    there = chain.forward(q + np.random.default_rng(3).uniform(-0.05, 0.05, q.shape))
    step = descend(
        chain, q, there.tips_m, there.beams, position_tolerance_m=1e-9, angle_tolerance_rad=1e-9, max_steps=1
    )
    state = chain.forward(q)
    for i in range(len(q)):
        turn, _ = Rotation.align_vectors(state.R_world_tip[i].T @ there.beams[i], [0.0, 0.0, 1.0])
        weight = np.array([1.0, 1.0, 1.0, AXIS_WEIGHT_M, AXIS_WEIGHT_M])
        e = weight * np.append(there.tips_m[i] - state.tips_m[i], turn.as_rotvec()[:2])
        J = weight[:, None] * chain.jacobian(chain.forward(q[i : i + 1]))[0]
        z = CENTRING_GAIN * ((low + high) / 2.0 - q[i])
        root = np.sqrt(DAMPING + ERROR_DAMPING * e @ e)
        stacked = np.vstack([J, root * np.eye(chain.n_joints)])
        dq = np.linalg.lstsq(stacked, np.append(e, root * z), rcond=None)[0]
        assert np.abs(dq).max() < 0.5  # shorter than the cap, and too short to leave the limits
        # The damping is some 1e-6 of J J^T, so the inverse magnifies rounding a million times.
        np.testing.assert_allclose(step.q[i] - q[i], dq, atol=1e-8)


def test_the_most_comfortable_answer_of_the_first_starts_is_taken(search) -> None:
    """Each start by itself, and the comfort worked out from the answer's limits, clearance and way from home."""
    settings, chain, slack = search.settings, search.chain, np.ones(1, dtype=bool)
    rounds = StartRounds(chain, search.meter, search.clearance, settings)
    n_chosen = 0
    for angle_rad in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        outward = np.array([0.4 * np.cos(angle_rad), 0.4 * np.sin(angle_rad), np.sqrt(1.0 - 0.4**2)])
        pose = (np.array([[0.5, 0.0, 0.06]]) + 0.06 * outward, -outward[None])
        starts = search.starts.starts(*pose, 0, settings.n_compared)[0]
        tried = [
            rounds.attempt(Round(np.zeros(1, dtype=np.int64), start[None], *pose, slack)) for start in starts
        ]
        answers = np.array([each.q[0] for each in tried if each.is_valid[0]])
        assert len(answers)
        n_chosen += len(answers) > 1
        room = np.minimum(answers - chain.low, chain.high - answers).min(axis=1)
        clearance_m = search.meter.measure(chain.full(answers)).clearance_m
        comfort = np.minimum(np.minimum(room / 0.3, clearance_m / 0.03), 1.0)
        comfort -= 0.05 * np.abs(answers - chain.home).max(axis=1) / np.pi
        found = search.search(*pose).results[0].q[chain.columns]
        np.testing.assert_allclose(found, answers[np.argmax(comfort)], atol=1e-6)  # a batch rounds otherwise
    assert n_chosen >= 6  # there was a choice


def test_poses_of_free_configurations_are_all_solved(search, clearance, scene) -> None:
    """Reachable by construction; without a stand-off, which those configurations need not have."""
    q = free_configurations(search, clearance, scene, 200, seed=11)
    made = search.chain.forward(q)
    answers = search.with_settings(IkSettings(standoff_m=0.0)).search(made.tips_m, made.beams)
    assert answers.is_reached.all(), [r.explain() for r in answers.results if not r.is_reached]


@settings(max_examples=25)
@given(
    position_m=st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(-0.1, 1.2)),
    normal=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda v: np.linalg.norm(v) > 0.1
    ),
)
def test_every_reached_answer_satisfies_all_limits(scene, search, clearance, position_m, normal) -> None:
    at_m, along = np.array(position_m), np.array(normal) / np.linalg.norm(normal)
    result = search.search(at_m[None], along[None]).results[0]
    low, high = scene.model.jnt_range.T
    assert np.all((result.q >= low) & (result.q <= high))
    assert result.explain()
    if not result.is_reached:
        return
    data = mujoco.MjData(scene.model)
    for q, tip_m in ((result.q, at_m), (result.q_standoff, at_m - 0.04 * along)):
        data.qpos[:] = q
        mujoco.mj_forward(scene.model, data)
        assert np.all((q >= low) & (q <= high))
        assert np.linalg.norm(data.site("probe_tip").xpos - tip_m) < POSITION_TOLERANCE_M
        beam = data.site("probe_tip").xmat.reshape(3, 3)[:, 2]
        assert np.arctan2(np.linalg.norm(np.cross(beam, along)), beam @ along) < ANGLE_TOLERANCE_RAD
        assert clearance.collision(data) is None


def test_a_batch_answers_as_single_poses_do(search) -> None:
    rng = np.random.default_rng(3)
    positions_m = np.column_stack(
        [rng.uniform(0.3, 0.7, 20), rng.uniform(-0.2, 0.2, 20), rng.uniform(0.0, 0.3, 20)]
    )
    normals = np.tile([0.0, 0.0, -1.0], (20, 1))
    together = search.search(positions_m, normals)
    for i in range(0, 20, 4):
        alone = search.search(positions_m[i : i + 1], normals[i : i + 1]).results[0]
        assert alone.status is together.results[i].status
        np.testing.assert_allclose(alone.q, together.results[i].q, atol=1e-6)


def test_a_joint_at_its_limit_is_named(tmp_path, ball_anatomy, cone) -> None:
    """The gantry's rail ends at 0.2 m, and the pose is 0.1 m beyond."""
    path = tmp_path / "gantry.xml"
    path.write_text(GANTRY)
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    search = IkSearch(scene, Clearance(scene, DistanceGrid.from_solid(ball_anatomy.organ)))
    result = search.search(np.array([[0.3, 0.1, 0.3]]), np.array([[0.0, 0.0, -1.0]])).results[0]
    assert result.status is IkStatus.JOINT_LIMIT
    assert "rail is at its limit (+0.200 m)" in result.explain()
    assert "100.0 mm and 0.0 degrees off" in result.explain()


def test_the_seed_of_the_starts_changes_no_verdict(scene, clearance) -> None:
    rng = np.random.default_rng(5)
    positions_m = rng.uniform([0.1, -0.6, 0.0], [0.9, 0.6, 0.4], (300, 3))
    normals = rng.normal(size=(300, 3)) * 0.3 - [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    verdicts = [
        IkSearch(scene, clearance, IkSettings(start_seed=seed)).search(positions_m, normals).is_reached
        for seed in (0, 1)
    ]
    assert 0.2 < verdicts[0].mean() < 0.98  # both kinds occur
    assert (
        np.mean(verdicts[0] == verdicts[1]) > 0.98
    )  # on an organ 99.9 %; these poses lie at the rim of the reach
