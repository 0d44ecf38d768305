"""No recorded state of a motion touches what it must not, by another reckoning than the one that planned it.

Table, the arm itself and the probe: MuJoCo's contacts in every state. Organ: the triangles of every geom of arm and
probe, divided until each is proved clear of the organ's triangles or is smaller than a millimetre.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from geom_surface import geom_triangles, least_signed_distances_m

from mapping import MapSettings
from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.moving.motion import Phase
from sim.episode.scenario import SCENARIOS
from sim.world.motion.settings import ServoSettings
from sim.world.scene.arm import ArmModel
from sim.world.solids.surface_distance import SurfaceDistance

FACE_M = 0.008
"""What of the probe may touch the organ: its surface this near to the tip."""
POSES = {
    "sphere": (0, 14_399, 7_000, 119, 14_000, 3_333),
    "liver": (0, 4_000, 1_500, 300, 2_500, 3_200, 60),
}


class Touch:
    """Looks at the states of one setup's arm."""

    def __init__(self, setup) -> None:
        self.setup, self.exact = setup, SurfaceDistance(setup.organ)
        self._model, self._data = setup.scene.model, setup.scene.new_data()
        self._tip = self._model.site(setup.scene.tip_site).id
        self._triangles = {geom: geom_triangles(self._model, geom) for geom in setup.scene.arm_geoms}

    def contacts_m(self, states) -> np.ndarray:
        """Least distance of MuJoCo's contacts in each state, shape (T,) [m]."""
        return np.array([self._contact_m(state) for state in states])

    def organ_m(self, states, *, raised_m: float = 0.0, face_m: float = FACE_M) -> np.ndarray:
        """Least distance of arm and probe, but for the face, to the raised organ, shape (T,) [m].

        It is below 0 where they touch, and infinite where they are farther apart than about a millimetre.
        """
        places = [self._places(state) for state in states]
        at_m, R_world, tips_m = (np.array(part) for part in zip(*places, strict=True))
        at_m[..., 2] -= raised_m
        tips_m[:, 2] -= raised_m
        organ_m = np.full(len(states), np.inf)
        for geom, triangles_m in self._triangles.items():
            centre_m = at_m[:, geom]
            organ_m[self.setup.organ.contains(centre_m)] = -np.inf
            near = np.flatnonzero(self.exact.distance_m(centre_m) < self._model.geom_rbound[geom] * 1.02)
            world_m = centre_m[near, None, None] + triangles_m @ R_world[near, geom, None].transpose(
                0, 1, 3, 2
            )
            is_probe = self._model.geom_bodyid[geom] == self._model.site_bodyid[self._tip]
            least_m = least_signed_distances_m(
                world_m, self.exact, ignored_at_m=tips_m[near], ignored_m=face_m if is_probe else 0.0
            )
            organ_m[near] = np.minimum(organ_m[near], least_m)
        return organ_m

    def _contact_m(self, state) -> float:
        self._places(state)
        mujoco.mj_collision(self._model, self._data)
        return float(self._data.contact.dist.min()) if self._data.ncon else np.inf

    def _places(self, state) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        data = self._data
        data.qpos[:] = state
        mujoco.mj_kinematics(self._model, data)
        rotations = data.geom_xmat.reshape(-1, 3, 3).copy()
        return data.geom_xpos.copy(), rotations, data.site_xpos[self._tip].copy()


@pytest.fixture(scope="module", params=["sphere", "liver"])
def touch(request) -> Touch:
    if request.param == "sphere":
        return Touch(request.getfixturevalue("sphere_arm_setup"))
    build = request.getfixturevalue("setups_are_built_once")
    return Touch(build(SCENARIOS["liver"], ArmModel(), MapSettings()))


@pytest.fixture(scope="module")
def transfers(touch):
    """Kinematic motions from pose to pose, across the organ."""
    motion_model, data = make_motion_model(touch.setup, "kinematic"), touch.setup.scene.new_data()
    poses = [
        pose for pose in POSES[touch.setup.scenario.name] if touch.setup.positioner.reach(pose).is_reached
    ]
    moved = [motion_model.move(data, pose) for pose in poses]
    assert len(moved) > 4
    assert all(motion.is_done for motion in moved)
    return moved


def test_no_recorded_state_touches_what_it_must_not(touch, transfers) -> None:
    for motion in transfers:
        assert touch.contacts_m(motion.states).min() >= 0.0
        assert touch.organ_m(motion.states).min() >= 0.0
        lifted = motion.states[motion.phases == Phase.TRANSFER]
        assert touch.organ_m(lifted[::8], raised_m=0.001, face_m=0.0).min() >= 0.0  # a millimetre is left


def test_servos_touch_the_organ_with_the_probes_face_alone(touch) -> None:
    motion_model = make_motion_model(touch.setup, "servo", servo=ServoSettings(press_m=0.0015))
    # At 2 mm the rim of the face would just be level with the organ, and the polyhedra here enclose the round probe.
    motion = motion_model.move(touch.setup.scene.new_data(), POSES[touch.setup.scenario.name][2])
    assert touch.contacts_m(motion.states).min() >= 0.0
    states = motion.states[np.r_[0 : len(motion.states) : 3, -1]]
    assert touch.organ_m(states).min() >= 0.0
    assert touch.organ_m(states[-1:], face_m=0.0)[0] < 0.0


def test_this_reckoning_sees_what_does_touch(touch, transfers) -> None:
    end = transfers[1].states[-1:]
    assert abs(touch.organ_m(end, face_m=0.0)[0]) < 6e-4  # the face rests on the organ
    assert touch.organ_m(end, raised_m=0.02)[0] < 0.0  # the head is inside a raised one
    sunk, folded = touch.setup.scene.home_q.copy(), touch.setup.scene.home_q.copy()
    sunk[1], folded[3] = 1.7, -3.05  # the shoulder bent through the table, the elbow folded onto the probe
    assert touch.contacts_m([sunk, folded]).max() < 0.0
