"""What is said to a controller and by it: one JSON object a line, in the fields of ROS messages.

docs/arm-controller.md has the table. Every message may be lost: what matters is said again until the other side's
state shows that it was heard.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .controller import ArmState, Status
from .timed_path import ArmLimits, TimedPath

NS = 1_000_000_000
"""Nanoseconds in a second."""
MOST_BYTES = 16 * 2**20
"""Largest line: a path of ten minutes of seven joints has some 10 MB."""
MOST_JOINTS = 64
HELLO, BEAT, FOLLOW, STOP, ASK_RECORD = "hello", "beat", "follow", "stop", "ask-record"
"""What a controller is told: say what you are; go on, I am here; follow this path; come to rest. The last one, what it
noted, a simulated one alone understands."""
ARM, STATE, RECORD = "arm", "state", "record"
"""What a controller says: what it is, where the arm is, and, a simulated one, what it noted."""


class BrokenMessageError(ValueError):
    """A line is no message; the text says why."""


def line_of(op: str, **fields: Any) -> bytes:
    """A message as a line."""
    return (json.dumps({"op": op, **fields}, allow_nan=False, separators=(",", ":")) + "\n").encode()


def message_of(line: bytes) -> dict[str, Any]:
    """The message that a line holds.

    Raises:
        BrokenMessageError: It holds none.
    """
    try:
        message = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise BrokenMessageError(f"a line is not JSON ({error})") from error
    if not (isinstance(message, dict) and isinstance(message.get("op"), str)):
        raise BrokenMessageError("a line is not an object with an `op`")
    return message


def trajectory_of(path: TimedPath) -> dict[str, Any]:
    """A path in the fields of a trajectory_msgs/JointTrajectory of ROS 2."""
    ns = np.round(path.time_s * NS).astype(np.int64).tolist()
    rows = zip(ns, path.q.tolist(), path.speed.tolist(), strict=True)
    return {
        "joint_names": list(path.names),
        "points": [
            {"positions": q, "velocities": speed, "time_from_start": {"sec": at // NS, "nanosec": at % NS}}
            for at, q, speed in rows
        ],
    }


def path_of(trajectory: Any) -> TimedPath:
    """The path that such fields hold; it is not checked against any limits.

    Raises:
        BrokenMessageError: They hold none.
    """
    try:
        names, points = trajectory["joint_names"], trajectory["points"]
        times_s = [
            point["time_from_start"]["sec"] + point["time_from_start"]["nanosec"] / NS for point in points
        ]
        q = _numbers([point["positions"] for point in points], (len(points), len(names)))
        speed = _numbers([point["velocities"] for point in points], q.shape)
        return TimedPath(names=_names(names), time_s=_numbers(times_s, (len(points),)), q=q, speed=speed)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BrokenMessageError(f"a path cannot be read ({error})") from error


def arm_fields(names: tuple[str, ...], limits: ArmLimits) -> dict[str, Any]:
    """What an arm is; joints without limits have none in the message."""
    return {
        "joint_names": list(names),
        "low": [_finite_or_none(value) for value in limits.low.tolist()],
        "high": [_finite_or_none(value) for value in limits.high.tolist()],
        "speed": [_finite_or_none(value) for value in limits.speed.tolist()],
    }


def arm_of(message: Mapping[str, Any]) -> tuple[tuple[str, ...], ArmLimits]:
    """The joints and limits of such a message.

    Raises:
        BrokenMessageError: It has none.
    """
    try:
        names = _names(message["joint_names"])
        values = []
        for key, without in (("low", -math.inf), ("high", math.inf), ("speed", math.inf)):
            filled = [without if value is None else value for value in message[key]]
            values.append(_numbers(filled, (len(names),), is_finite=False))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BrokenMessageError(f"what the arm is cannot be read ({error})") from error
    return names, ArmLimits(low=values[0], high=values[1], speed=values[2])


def state_fields(state: ArmState, names: tuple[str, ...]) -> dict[str, Any]:
    """A state in the fields of a sensor_msgs/JointState, with what became of the path."""
    return {
        "stamp_s": state.stamp_s,
        "name": list(names),
        "position": state.q.tolist(),
        "velocity": state.speed.tolist(),
        "goal": state.goal,
        "status": state.status.value,
        "text": state.text,
        "seen": state.seen,
    }


def state_of(message: Mapping[str, Any], names: tuple[str, ...]) -> ArmState:
    """The state of a message, with its joints in our order.

    Raises:
        BrokenMessageError: It has none.
    """
    try:
        told = list(message["name"])
        if sorted(told) != sorted(names):
            raise ValueError("its joints are others")
        order = [told.index(name) for name in names]
        stamp_s, goal, seen = float(message["stamp_s"]), message["goal"], message["seen"]
        if not (math.isfinite(stamp_s) and isinstance(goal, int) and isinstance(seen, int)):
            raise ValueError("its stamp, its goal, or what it has seen is no number")
        return ArmState(
            stamp_s=stamp_s,
            q=_numbers(message["position"], (len(names),))[order],
            speed=_numbers(message["velocity"], (len(names),))[order],
            goal=goal,
            status=Status(message["status"]),
            text=str(message["text"])[:500],
            seen=seen,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BrokenMessageError(f"a state cannot be read ({error})") from error


def _names(names: Any) -> tuple[str, ...]:
    if not (
        isinstance(names, list)
        and 1 <= len(names) <= MOST_JOINTS
        and all(isinstance(name, str) for name in names)
        and len(set(names)) == len(names)
    ):
        raise ValueError("the names of its joints are none")
    return tuple(names)


def _numbers(values: Any, shape: tuple[int, ...], *, is_finite: bool = True) -> NDArray[np.float64]:
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != shape or (is_finite and not np.isfinite(numbers).all()) or np.isnan(numbers).any():
        raise ValueError("its numbers do not fit its joints")
    return numbers


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
