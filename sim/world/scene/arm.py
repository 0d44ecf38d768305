"""An arm: the file that it comes from, its flange, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.world.arms.errors import ArmError
from sim.world.arms.loading import LoadedArm, load_arm
from sim.world.models import MODELS_DIR

__all__ = ["MODELS_DIR", "ArmError", "ArmModel", "base_frame"]


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """An arm: the file it comes from, the site that carries the probe, and where it stands."""

    path: Path = MODELS_DIR / "arm.xml"
    """MJCF or URDF file of the arm."""
    flange: str | None = None
    """Site or body at the end of the chain; the probe is attached there, its +z along the +z of its frame. By default
    the first of `FLANGE_SITES` and `FLANGE_BODIES` that the arm has."""
    base_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the file's origin stands in the world [m]."""
    base_yaw_rad: float = 0.0
    """How the file is turned about the world's vertical [rad]."""

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """Maps the file's coordinates to the world, shape (4, 4)."""
        return base_frame(self.base_m, self.base_yaw_rad)

    def load(self) -> LoadedArm:
        """The arm, ready to be put into a scene.

        Raises:
            ArmError: The file is missing or broken, or holds no arm that can be used; see `load_arm`.
        """
        return load_arm(self.path, self.flange)


def base_frame(base_m: tuple[float, float, float], yaw_rad: float) -> NDArray[np.float64]:
    """The frame of a base that stands upright at a position [m], turned by a yaw [rad], shape (4, 4)."""
    T = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    T[:2, :2] = [[cos, -sin], [sin, cos]]
    T[:3, 3] = base_m
    return T
