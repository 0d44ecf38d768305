"""Which mover an episode gets."""

from __future__ import annotations

import numpy as np

from .motion import Mover, StationMover
from .stage import Stage
from .world.motion_settings import JointLimits, MotionSettings


def make_mover(stage: Stage, settings: MotionSettings | None = None) -> Mover:
    """A fresh mover for one episode on a stage."""
    limits = None
    if stage.arm is not None:
        is_slide = stage.scene.model.jnt_type == 2
        limits = JointLimits.of_arm(stage.arm.path, np.asarray(is_slide), settings)
    return StationMover(stage.carrier, stage.scene.tip_site, limits, settings)
