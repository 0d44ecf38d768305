"""An event of a session: a reading, or a pose that was declined; as arrays of a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sim.world.sensing.reading import Reading

_OPTIONAL = ("is_target", "log_odds", "weight")
"""Arrays of a reading that it may lack."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Event:
    """What happened to a session."""

    number: int
    """Number of the event, from 1."""
    pose_index: int
    """The pose that was sensed or declined."""
    reading: Reading | None
    """What was sensed; None where the pose was declined."""
    reason: str
    """Why it was declined."""
    rng_state: Mapping[str, Any]
    """State of the planner's stream after it planned this action."""

    @classmethod
    def of_reading(cls, number: int, pose: int, reading: Reading, rng: np.random.Generator) -> Self:
        """The event of a reading."""
        return cls(
            number=number, pose_index=pose, reading=reading, reason="", rng_state=rng.bit_generator.state
        )

    @classmethod
    def of_refusal(cls, number: int, pose: int, reason: str, rng: np.random.Generator) -> Self:
        """The event of a pose that was declined."""
        return cls(
            number=number, pose_index=pose, reading=None, reason=reason, rng_state=rng.bit_generator.state
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The event as arrays by name."""
        arrays: dict[str, NDArray[Any]] = {
            "number": np.array(self.number),
            "pose_index": np.array(self.pose_index),
            "rng_state": np.array(json.dumps(self.rng_state)),
        }
        if self.reading is None:
            return arrays | {"reason": np.array(self.reason)}
        for name in ("points_m", "is_occupied", "T_world_probe", *_OPTIONAL):
            if (values := getattr(self.reading, name)) is not None:
                arrays[name] = values
        return arrays

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The event that arrays hold.

        Raises:
            KeyError, ValueError: One is missing or does not fit.
        """
        reading = None
        if "reason" not in arrays:
            reading = Reading(
                arrays["points_m"],
                arrays["is_occupied"],
                arrays["T_world_probe"],
                is_target=arrays.get("is_target"),
                log_odds=arrays.get("log_odds"),
                weight=arrays.get("weight"),
            )
        return cls(
            number=int(arrays["number"]),
            pose_index=int(arrays["pose_index"]),
            reading=reading,
            reason=str(arrays["reason"]) if reading is None else "",
            rng_state=json.loads(str(arrays["rng_state"])),
        )
