"""Arms whose makers publish how fast their joints may turn, known by what a file calls its model and its joints.

MJCF has no place for such limits. The numbers are the makers' own; whoever reads a file is told which arm it was taken
for, since a file may call itself what it likes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

PANDA_SPEED = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
"""Published joint speeds of the Franka Emika Panda [rad/s]."""
PANDA_ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Published joint accelerations of the same [rad/s^2]."""

NUMBERED = r"(?:^|[_/-])(?:joint_?)?a?(\d)$|joint_?a?(\d)$"
"""Joints that are called joint1, panda_joint1, joint_1, joint_a1 or A1."""
OF_UR = r"(shoulder_pan|shoulder_lift|elbow|wrist_1|wrist_2|wrist_3)(?:_joint)?$"
UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@dataclass(frozen=True, kw_only=True)
class KnownArm:
    """An arm with published limits."""

    title: str
    """What its maker calls it."""
    models: tuple[str, ...]
    """How model names that mean it are written, in small letters and without separators."""
    joint_pattern: str
    """A regular expression with what tells the joints apart in its groups."""
    joints: tuple[str, ...]
    """What the groups hold for the joints from base to flange."""
    speed: tuple[float, ...]
    """Joint speeds [rad/s]."""
    acceleration: tuple[float, ...] | None = None
    """Joint accelerations [rad/s^2]; None where the maker publishes none."""
    source: str
    """Where the numbers were published."""


def _deg(*speeds: float) -> tuple[float, ...]:
    return tuple(np.deg2rad(speeds).tolist())


def _numbered(n: int) -> tuple[str, ...]:
    return tuple(str(number) for number in range(1, n + 1))


def _ur(name: str, *speeds: float) -> KnownArm:
    return KnownArm(
        title=f"Universal Robots {name}",
        models=(name.lower(),),
        joint_pattern=OF_UR,
        joints=UR_JOINTS,
        speed=_deg(*speeds),
        source=f"User Manual {name}, version 5.8",
    )


def _iiwa(title: str, model: str, *speeds: float) -> KnownArm:
    return KnownArm(
        title=title,
        models=(model,),
        joint_pattern=NUMBERED,
        joints=_numbered(7),
        speed=_deg(*speeds),
        source="KUKA, Spez LBR iiwa, axis data",
    )


def _xarm(n: int) -> KnownArm:
    return KnownArm(
        title=f"UFACTORY xArm {n}",
        models=(f"xarm{n}",),
        joint_pattern=NUMBERED,
        joints=_numbered(n),
        speed=_deg(*[180.0] * n),
        source="UFACTORY, xArm User Manual, technical specifications",
    )


KNOWN_ARMS = (
    KnownArm(
        title="Franka Emika Panda",
        models=("panda", "fer"),
        joint_pattern=NUMBERED,
        joints=_numbered(7),
        speed=PANDA_SPEED,
        acceleration=PANDA_ACCELERATION,
        source="Franka Control Interface documentation, Limits for Panda",
    ),
    KnownArm(
        title="Franka Research 3",
        models=("fr3",),
        joint_pattern=NUMBERED,
        joints=_numbered(7),
        # The controller lowers these near the ends of a joint's range.
        speed=(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
        acceleration=(10.0,) * 7,
        source="Franka Control Interface documentation, Limits for Franka Research 3",
    ),
    _ur("UR3e", 180, 180, 180, 360, 360, 360),
    _ur("UR5e", 180, 180, 180, 180, 180, 180),
    _ur("UR10e", 120, 120, 180, 180, 180, 180),
    _ur("UR16e", 120, 120, 180, 180, 180, 180),
    _iiwa("KUKA LBR iiwa 7 R800", "iiwa7", 98, 98, 100, 130, 140, 180, 180),
    _iiwa("KUKA LBR iiwa 14 R820", "iiwa14", 85, 85, 100, 75, 130, 135, 135),
    _xarm(6),
    _xarm(7),
    KnownArm(
        title="Kinova Gen3 with 7 joints",
        models=("gen3",),
        joint_pattern=NUMBERED,
        joints=_numbered(7),
        speed=(1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218),
        source="Kinova, kortex_description",
    ),
    KnownArm(
        title="Rethink Robotics Sawyer",
        models=("sawyer",),
        joint_pattern=r"(?:^|_)j(\d)$",
        joints=tuple("0123456"),
        speed=(1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545),
        source="Rethink Robotics, sawyer_description",
    ),
)


@dataclass(frozen=True)
class Recognised:
    """What a file was taken for."""

    arm: KnownArm
    model: str
    """What the file calls its model."""
    joints: tuple[str, ...]
    """The file's names of the arm's joints, from base to flange."""

    @property
    def speeds(self) -> dict[str, float]:
        """Joint speeds by the file's names [rad/s]."""
        return dict(zip(self.joints, self.arm.speed, strict=True))

    @property
    def accelerations(self) -> dict[str, float]:
        """Joint accelerations by the file's names [rad/s^2]; none where none are published."""
        return dict(zip(self.joints, self.arm.acceleration or (), strict=False))


def recognised(path: Path, hinges: Sequence[str]) -> Recognised | None:
    """The known arm that a file describes, or None.

    Both have to fit: a part of the model's name, and the hinges, all of the arm's in their order and no more of that
    kind.

    Args:
        path: MJCF or URDF file.
        hinges: Names of the hinges between base and flange in the file.
    """
    model = model_name(path)
    words = re.findall(r"[a-z0-9]+", model.lower())
    said = {*words, *(first + second for first, second in pairwise(words))}
    found = []
    for arm in KNOWN_ARMS:
        keys = {name: key for name in hinges if (key := _key(arm, name))}
        if said & set(arm.models) and tuple(keys.values()) == arm.joints:
            found.append(Recognised(arm, model, tuple(keys)))
    return found[0] if len(found) == 1 else None


def model_name(path: Path) -> str:
    """What a file calls its model; empty where it does not, or cannot be read."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        # The file was read by MuJoCo before, which is laxer about XML.
        return ""
    return root.get("model") or root.get("name") or ""


def _key(arm: KnownArm, joint: str) -> str | None:
    match = re.search(arm.joint_pattern, joint.lower())
    return next(filter(None, match.groups()), None) if match else None
