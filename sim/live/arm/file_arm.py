"""The simulated arm of an arm's file: its joints between base and flange, at home."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.world.arms.body_tree import joints_above
from sim.world.ik.chain import MANY_TURNS_RAD
from sim.world.motion.joint_limits import JointLimits
from sim.world.scene.arm import ArmModel

from .simulated_arm import SimulatedArm, SimulatedArmSettings
from .timed_path import ArmLimits


def simulated_arm(arm: ArmModel, *, error: float = 0.0, seed: int = 0) -> SimulatedArm:
    """The arm of a file, at rest at home.

    Args:
        arm: Names the file.
        error: Largest error of a joint at the end of a path [rad or m]; each joint has one of its own, which stays.
        seed: Seed of these.

    Raises:
        WorldError: The file cannot be used.
    """
    loaded = arm.load()
    model = loaded.spec.compile()
    flange = int(model.site_bodyid[model.site(loaded.flange).id])
    joints = np.array(joints_above(model, flange), dtype=np.int64)
    names = tuple(model.joint(joint).name for joint in joints)
    is_slide = model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_SLIDE)
    low, high = model.jnt_range[joints].T
    is_limited = model.jnt_limited[joints].astype(bool)
    limits = ArmLimits(
        low=np.where(is_limited & (low > -MANY_TURNS_RAD), low, -np.inf),
        high=np.where(is_limited & (high < MANY_TURNS_RAD), high, np.inf),
        speed=JointLimits.of_arm(arm.path, is_slide, names=names).speed,
    )
    errors = np.random.default_rng(seed).uniform(-error, error, len(joints))
    settings = SimulatedArmSettings(names=names, limits=limits, start_q=loaded.home_q[joints], error_q=errors)
    return SimulatedArm(settings)
