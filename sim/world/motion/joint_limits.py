"""Limits of speed and acceleration of an arm's joints.

MJCF has no place for them. URDF has one for speeds, which MuJoCo drops, so they are read from the file itself. What a
file does not state comes from the arm's maker, where the arm is known (`known_arms`).
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

from .known_arms import PANDA_ACCELERATION, PANDA_SPEED, recognised
from .settings import MotionSettings

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
        hinges: Sequence[str] | None = None,
    ) -> JointLimits:
        """The limits of an arm's joints.

        What `settings` names comes first, then the speeds that a URDF states, then what the maker publishes, of the
        embedded arm and of `KNOWN_ARMS`, then `OTHER_SPEED` and `OTHER_ACCELERATION`.

        Args:
            arm_path: MJCF or URDF file of the arm.
            is_slide: Which joints slide, shape (n,).
            settings: May name one limit for all joints.
            names: The joints' names in the file, n of them; none where nothing is to be looked up.
            hinges: Names of the hinges between base and flange, by which the arm is known; by default all of `names`
                that do not slide.
        """
        settings = settings or MotionSettings()
        share = np.where(is_slide, SLIDE_SHARE, 1.0)
        if is_embedded(arm_path):
            speed, acceleration = np.array(PANDA_SPEED), np.array(PANDA_ACCELERATION)
        else:
            stated = _stated(arm_path, _hinges(names, is_slide) if hinges is None else hinges, names)
            speed, acceleration = (
                np.array(
                    [by_name.get(name, other) for name, other in zip(names, others.tolist(), strict=True)]
                )
                if names
                else others
                for by_name, others in zip(
                    stated, (OTHER_SPEED * share, OTHER_ACCELERATION * share), strict=True
                )
            )
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


def limits_notice(
    arm_path: Path, names: Sequence[str], is_slide: NDArray[np.bool_], settings: MotionSettings | None = None
) -> str | None:
    """Which limits an arm moves with, and where they come from, as a sentence.

    None where a person stated both, and for the embedded arm, whose limits are told elsewhere.

    Args:
        arm_path: MJCF or URDF file of the arm.
        names: Names of the joints between base and flange.
        is_slide: Which of them slide, shape (n,).
        settings: May name one limit for all joints.
    """
    settings = settings or MotionSettings()
    if is_embedded(arm_path) or None not in (settings.joint_speed, settings.joint_acceleration):
        return None
    limits = JointLimits.of_arm(arm_path, is_slide, settings, names=names)
    known, of_file = recognised(arm_path, _hinges(names, is_slide)), urdf_speeds(arm_path)
    speeds, accelerations = _listed(limits.speed), _listed(limits.acceleration)
    of_slide = (" (m/s of a slide)", " (m/s² of a slide)") if is_slide.any() else ("", "")
    parts, doubt, remedies = [], "", []
    if settings.joint_speed is None:
        remedies.append("`joint_speed`")
        stated = [name for name in names if name in of_file]
        whose = (
            "are the file's own" if len(stated) == len(names) else "are assumed, since nothing states others"
        )
        if known is not None and len(stated) < len(names):
            whose = f"are those published for it ({known.arm.source})"
        if 0 < len(stated) < len(names):
            whose = f"{whose}, but of {', '.join(stated)}, which the file states"
        parts.append(f"joint speeds of {speeds} rad/s{of_slide[0]} {whose}")
    if settings.joint_acceleration is None:
        remedies.append("`joint_acceleration`")
        is_published = known is not None and known.arm.acceleration is not None
        parts.append(
            f"accelerations of {accelerations} rad/s² are {'published too' if is_published else 'assumed'}"
        )
    if known is not None:
        doubt = f"this was taken for a {known.arm.title}, by its model's name `{known.model}` and its joints' names; "
    tail = "If it is another arm, give its own by" if known is not None else "Give others by"
    return f"{arm_path.name}: {doubt}{'; '.join(parts)}. {tail} {' and '.join(remedies)}."


def _listed(values: NDArray[np.float64]) -> str:
    """Values for a person, one where all are the same."""
    shown = [f"{value:.4g}" for value in values.tolist()]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)


def _hinges(names: Sequence[str], is_slide: NDArray[np.bool_]) -> list[str]:
    return [name for name, slides in zip(names, is_slide.tolist(), strict=False) if not slides]


def _stated(
    path: Path, hinges: Sequence[str], names: Sequence[str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Speeds and accelerations that are published or stated for joints by their names; none without `names`."""
    if not names:
        return {}, {}
    known = recognised(path, hinges)
    published = (known.speeds, known.accelerations) if known is not None else ({}, {})
    return published[0] | urdf_speeds(path), published[1]


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
