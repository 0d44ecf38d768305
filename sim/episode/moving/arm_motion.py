"""The motion model of an arm: it jumps, follows its path exactly, or is simulated."""

from __future__ import annotations

import mujoco

from sim.world.body.settings import BodySettings
from sim.world.motion.contact_surface import ContactSurface
from sim.world.motion.joint_limits import JointLimits, is_embedded, limits_notice
from sim.world.motion.path_check import PathCheck
from sim.world.motion.path_search import PathSearch
from sim.world.motion.servo import ServoArm
from sim.world.motion.settings import MotionKind, MotionSettings, ServoSettings
from sim.world.motion.timing import PathTimer

from ..positioner import ArmPositioner
from ..setup import Setup
from .encounter import Encounter
from .force_motion import ForceMotion
from .jump_motion import JumpMotion
from .motion import MotionModel
from .organ_under_probe import BodyUnderProbe, PlannedOrgan
from .path_motion import PathMotion
from .servo_motion import ServoMotion
from .travel import Travel

SEARCH_M = BodySettings().contact_search_m
"""How far below its surface an organ as planned is looked for [m]."""


def make_motion_model(
    setup: Setup,
    kind: MotionKind = "none",
    settings: MotionSettings | None = None,
    servo: ServoSettings | None = None,
) -> MotionModel:
    """A fresh motion model for one episode on a setup.

    Args:
        setup: Gives arm, workspace and organ. A free probe always jumps.
        kind: `none` jumps from station to station, `kinematic` follows the path exactly, `servo` simulates the arm.
        settings: Speeds.
        servo: Stiffnesses and the force limit, which only `servo` needs.
    """
    settings, positioner = settings or MotionSettings(), setup.positioner
    if setup.arm is None or not isinstance(positioner, ArmPositioner):
        return JumpMotion(positioner, setup.scene.tip_site, None, settings)
    motion_model = _of_arm(setup, positioner, kind, settings, servo or ServoSettings())
    chain = positioner.search.chain
    notice = limits_notice(setup.arm.path, chain.names, chain.is_slide, settings)
    motion_model.notices = (notice,) if notice else ()
    return motion_model


def paths_of(
    setup: Setup, positioner: ArmPositioner, settings: MotionSettings
) -> tuple[PathSearch, PathTimer]:
    """What finds paths of a setup's arm, and what times them within its limits."""
    assert setup.arm is not None
    search = positioner.search
    paths = PathSearch(search, PathCheck(setup.scene, search.chain, search.meter, search.clearance))
    return paths, PathTimer(search.chain, limits_of(setup, positioner, settings))


def limits_of(setup: Setup, positioner: ArmPositioner, settings: MotionSettings) -> JointLimits:
    """How fast the joints between base and flange may be."""
    assert setup.arm is not None
    chain = positioner.search.chain
    return JointLimits.of_arm(setup.arm.path, chain.is_slide, settings, names=chain.names)


def _of_arm(
    setup: Setup, positioner: ArmPositioner, kind: MotionKind, settings: MotionSettings, servo: ServoSettings
) -> MotionModel:
    """The motion model of an arm."""
    assert setup.arm is not None
    model, search = setup.scene.model, positioner.search
    chain, path = search.chain, setup.arm.path
    hinges = [name for name, slides in zip(chain.names, chain.is_slide.tolist(), strict=True) if not slides]
    is_slide = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    names = [model.joint(joint).name.removeprefix("arm_") for joint in range(model.njnt)]
    limits = JointLimits.of_arm(path, is_slide, settings, names=names, hinges=hinges)
    if kind == "none":
        return JumpMotion(positioner, setup.scene.tip_site, limits, settings)
    paths, timer = paths_of(setup, positioner, settings)
    travel, tip_site = Travel(positioner, limits, settings), setup.scene.tip_site
    if kind == "kinematic":
        return PathMotion(positioner, paths, timer, settings, travel, tip_site)
    servo = servo or ServoSettings()
    organ, face_radius_m = ContactSurface(setup.organ), search.clearance.probe.face_radius_m
    arm = ServoArm(setup.scene, chain, organ, servo, is_panda=is_embedded(path), face_radius_m=face_radius_m)
    servos = ServoMotion(positioner, paths, timer, settings, travel, tip_site, arm=arm, servo=servo)
    if servo.press_n is None:
        return servos
    organ = PlannedOrgan(arm.stiffness_n_m, servo.pressing_n(arm.stiffness_n_m), SEARCH_M)
    return ForceMotion(servos, organ)


def motion_on_body(motion_model: MotionModel, body: Encounter) -> MotionModel | None:
    """The model that presses on a body by the servos of another; None where that has none.

    Args:
        motion_model: A fresh one of the same episode.
        body: The organ that need not be as planned.

    Raises:
        FieldError: The probe cannot press with its force.
    """
    if not isinstance(motion_model, ServoMotion):
        return None
    servo, own_n_m = motion_model.servo, motion_model.stiffness_n_m
    is_rigid = body.yielding is None
    organ = BodyUnderProbe(body, own_n_m, servo.pressing_n(own_n_m) if is_rigid else 0.0)
    return ForceMotion(motion_model, organ)
