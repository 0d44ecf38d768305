"""The parts of a sweeping episode: its motion model on the ground of a setup."""

from __future__ import annotations

from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.path_check import PathCheck
from sim.world.motion.path_search import PathSearch
from sim.world.motion.settings import MotionKind, MotionSettings
from sim.world.motion.timing import PathTimer

from ..moving.arm_motion import make_motion_model
from ..positioner import ArmPositioner
from .ground import Ground
from .motion import SweepMotion
from .settings import SweepSettings
from .slides import ArmSlide, FreeSlide, Slide


def make_sweep_motion(
    ground: Ground,
    kind: MotionKind,
    settings: SweepSettings,
    speeds: MotionSettings,
) -> SweepMotion:
    """A fresh motion model for one sweeping episode.

    Args:
        ground: Where the probe glides; the episode is made of its setup.
        kind: `none` estimates the times of an arm, `kinematic` has its paths timed; `servo` is none of them.
        settings: How fast the probe glides, and how often it reads.
        speeds: Speeds of the flights between, and of the joints.

    Raises:
        ValueError: The kind is `servo`.
    """
    if kind == "servo":
        raise ValueError("a sweep has no servos: move it kinematically, or not at all")
    setup = ground.setup
    inner = make_motion_model(setup, kind, speeds)
    return SweepMotion(inner, ground, _slide(ground, kind, settings, speeds), settings, speeds)


def _slide(ground: Ground, kind: MotionKind, settings: SweepSettings, speeds: MotionSettings) -> Slide:
    setup = ground.setup
    positioner = setup.positioner
    if setup.arm is None or not isinstance(positioner, ArmPositioner):
        return FreeSlide(positioner, settings.speed_m_s)
    search = positioner.search
    chain = search.chain
    limits = JointLimits.of_arm(setup.arm.path, chain.is_slide, speeds, names=chain.names)
    paths = PathSearch(search, PathCheck(setup.scene, chain, search.meter, search.clearance))
    timer = PathTimer(chain, limits) if kind == "kinematic" else None
    return ArmSlide(positioner, paths, settings.speed_m_s, timer=timer, limits=limits)
