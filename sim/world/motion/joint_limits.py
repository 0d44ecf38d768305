"""Limits of speed and acceleration of an arm's joints.

MJCF has no place for them. URDF has one for speeds, which MuJoCo drops, so they are read from the file itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from sim.world.scene.arm import MODELS_DIR

from .settings import MotionSettings

PANDA_SPEED = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
"""Published joint speeds of the Franka Emika Panda, the embedded arm [rad/s]."""
PANDA_ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Published joint accelerations of the same [rad/s^2]."""
OTHER_SPEED, OTHER_ACCELERATION = 1.0, 4.0
"""For arms whose limits nobody stated: slow for any arm of today [rad/s, rad/s^2]."""
SLIDE_SHARE = 0.25
"""Slides get this share of those two numbers, in m/s and m/s^2."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the joints of a chain, from the base on."""

    speed: NDArray[np.float64]
    """[rad/s or m/s], shape (n,)."""
    acceleration: NDArray[np.float64]
    """[rad/s^2 or m/s^2], shape (n,)."""

    @classmethod
    def of_arm(
        cls,
        arm_path: Path,
        is_slide: NDArray[np.bool_],
        settings: MotionSettings | None = None,
        *,
        names: Sequence[str] = (),
    ) -> JointLimits:
        """Published limits for the embedded arm, `OTHER_SPEED` and `OTHER_ACCELERATION` for any other.

        Speeds that a URDF file states come before `OTHER_SPEED`.

        Args:
            arm_path: MJCF or URDF file of the arm.
            is_slide: Which joints of the chain slide, shape (n,).
            settings: May name one limit for all joints.
            names: The joints' names in the file, n of them; none where nothing is to be looked up.
        """
        settings = settings or MotionSettings()
        is_panda = is_embedded(arm_path)
        share = np.where(is_slide, SLIDE_SHARE, 1.0)
        speed = np.array(PANDA_SPEED) if is_panda else OTHER_SPEED * share
        stated = urdf_speeds(arm_path) if names else {}
        if stated:
            speed = np.array(
                [stated.get(name, other) for name, other in zip(names, speed.tolist(), strict=True)]
            )
        acceleration = np.array(PANDA_ACCELERATION) if is_panda else OTHER_ACCELERATION * share
        if settings.joint_speed is not None:
            speed = np.full(len(is_slide), settings.joint_speed)
        if settings.joint_acceleration is not None:
            acceleration = np.full(len(is_slide), settings.joint_acceleration)
        return cls(speed, acceleration)

    def rest_to_rest_s(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shortest time of each joint over a distance from rest to rest [s].

        Args:
            distance: [rad or m], 0 or more, shape (..., n).
        """
        is_short = distance <= self.speed**2 / self.acceleration
        short_s = 2.0 * np.sqrt(distance / self.acceleration)
        return np.where(is_short, short_s, distance / self.speed + self.speed / self.acceleration)


def urdf_speeds(path: Path) -> dict[str, float]:
    """Speeds that a URDF file states for its joints by their names [rad/s, for slides m/s]; none for another file.

    A speed of 0, or one that is no number, states nothing.
    """
    if path.suffix != ".urdf":
        return {}
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        # The file was read by MuJoCo before, which is laxer about XML.
        return {}
    speeds = {}
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        try:
            speed = float(limit.get("velocity", "")) if limit is not None else math.nan
        except ValueError:
            continue
        if math.isfinite(speed) and speed > 0.0:
            speeds[joint.get("name", "")] = speed
    return speeds


def is_embedded(arm_path: Path) -> bool:
    """Whether a file is the embedded arm, a Panda by its numbers."""
    return arm_path == MODELS_DIR / "arm.xml"
