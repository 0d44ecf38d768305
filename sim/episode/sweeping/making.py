"""The parts of a sweeping episode: its motion model on the ground of a setup."""

from __future__ import annotations

from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.path_check import PathCheck
from sim.world.motion.path_search import PathSearch
from sim.world.motion.settings import MotionKind, MotionSettings, ServoSettings
from sim.world.motion.timing import PathTimer

from ..moving.arm_motion import make_motion_model
from ..moving.force_motion import ForceMotion
from ..moving.motion import MotionModel
from ..positioner import ArmPositioner
from .ground import Ground
from .motion import SweepMotion
from .pressed_slide import PressedSlide
from .settings import SweepSettings
from .slides import ArmSlide, FreeSlide, Slide


def make_sweep_motion(
    ground: Ground,
    kind: MotionKind,
    settings: SweepSettings,
    speeds: MotionSettings,
    servo: ServoSettings | None = None,
) -> SweepMotion:
    """A fresh motion model for one sweeping episode.

    Args:
        ground: Where the probe glides; the episode is made of its setup.
        kind: `none` estimates the times of an arm, `kinematic` has its paths timed, `servo` simulates the arm.
        settings: How fast the probe glides, and how often it reads.
        speeds: Speeds of the flights between, and of the joints.
        servo: Stiffnesses, the force to hold and its limit, which only `servo` needs.

    Raises:
        ValueError: Servos have no force to hold.
    """
    setup = ground.setup
    inner = make_motion_model(setup, kind, speeds, servo)
    return SweepMotion(inner, ground, _slide(ground, inner, kind, settings, speeds), settings, speeds)


def _slide(
    ground: Ground, inner: MotionModel, kind: MotionKind, settings: SweepSettings, speeds: MotionSettings
) -> Slide:
    setup = ground.setup
    positioner = setup.positioner
    if setup.arm is None or not isinstance(positioner, ArmPositioner):
        return FreeSlide(positioner, settings.speed_m_s)
    search = positioner.search
    chain = search.chain
    limits = JointLimits.of_arm(setup.arm.path, chain.is_slide, speeds, names=chain.names)
    paths = PathSearch(search, PathCheck(setup.scene, chain, search.meter, search.clearance))
    timer = None if kind == "none" else PathTimer(chain, limits)
    slide = ArmSlide(positioner, paths, settings.speed_m_s, timer=timer, limits=limits)
    if kind != "servo" or timer is None:
        return slide
    if not isinstance(inner, ForceMotion):
        raise ValueError("servo.press_n=None: the servos of a sweep hold a force; name it")
    return PressedSlide(slide, inner, timer, settings.speed_m_s)
