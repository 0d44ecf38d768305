"""How an organ is to lie, as people type it."""

from __future__ import annotations

import math
from typing import Any

from sim.errors import UsageError

MOST_MM = 3000.0
"""No organ stands farther from the arm's base than this."""


def pose_changes(words: tuple[str, ...]) -> dict[str, Any]:
    """Fields of the scenario that `--organ-pose` sets.

    Args:
        words: Nothing, `anterior-up`, `best`, three angles [degrees], or a position [mm] and a quaternion (wxyz).

    Raises:
        UsageError: Something else.
    """
    if not words or words == ("anterior-up",):
        return {}
    if words == ("best",):
        return {"organ_placing": "best"}
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) == 3 and all(abs(each) <= 360.0 for each in numbers):
        return {"organ_turn_rad": tuple(math.radians(each) for each in numbers)}
    is_pose = len(numbers) == 7 and all(abs(each) <= MOST_MM for each in numbers[:3])
    if is_pose and 0.0 < math.hypot(*numbers[3:]) < math.inf:
        return {
            "organ_position_m": tuple(each * 1e-3 for each in numbers[:3]),
            "organ_quaternion": tuple(numbers[3:]),
        }
    raise UsageError(
        f"--organ-pose {' '.join(words)}: anterior-up, best, three angles [degrees] up to 360, or seven numbers: "
        "X Y Z [mm] and QW QX QY QZ, not all zero."
    )
