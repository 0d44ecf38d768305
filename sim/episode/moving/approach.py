"""The approach: the probe goes to the first pose of a ranking that it can be brought to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import perf_counter

import mujoco

from sim.world.ik.result import IkResult

from ..positioner import Positioner
from .motion import Motion, MotionModel, ProcedureStoppedError, SkippedPose, joined


@dataclass(kw_only=True)
class Approach:
    """How the probe was brought to a pose, or why it was brought to none."""

    pose: int = -1
    """Index of the pose; -1 where none was reached."""
    answer: IkResult | None = None
    """The inverse kinematics of that pose; None where none was reached."""
    motion: Motion | None = None
    """The way there, with those to poses that were missed before; None where none was reached."""
    skipped: list[SkippedPose] = field(default_factory=list)
    """Poses ranked before it that could not be taken."""
    ik_s: float = 0.0
    """Computing time of the inverse kinematics [s]."""
    move_s: float = 0.0
    """Computing time of the motion [s]."""


def approach_first(
    ranking: Iterable[int],
    positioner: Positioner,
    motion_model: MotionModel,
    data: mujoco.MjData,
    *,
    skipped: dict[int, SkippedPose],
    on_skipped: Callable[[int], None],
) -> Approach:
    """Bring the probe to the first pose of a ranking that it can be brought to.

    A pose to which there is no way now has none later either: the arm can always go back to where it is now. The way to
    a pose that was missed was gone all the same, and is part of the motion to the one that is had.

    Args:
        ranking: Indices of poses, best first.
        positioner: Tells whether a pose is within reach.
        motion_model: Moves the probe.
        data: The state of the scene, which is brought along.
        skipped: Gets the poses that could not be taken.
        on_skipped: Called whenever a pose is out of reach, with how many in a row are.

    Raises:
        ProcedureStoppedError: The arm stopped; its motion holds those before too.
    """
    found, missed = Approach(), list[Motion]()
    for pose in ranking:
        start_s = perf_counter()
        answer = positioner.reach(pose)
        reached_s = perf_counter()
        found.ik_s += reached_s - start_s
        reason = answer.explain()
        if answer.is_reached:
            motion = _moved(motion_model, data, pose, missed)
            found.move_s += perf_counter() - reached_s
            if motion.is_done:
                found.pose, found.answer, found.motion = pose, answer, motion
                return found
            reason = motion.reason
        skipped[pose] = SkippedPose(pose, reason)
        found.skipped.append(skipped[pose])
        on_skipped(len(found.skipped))
    return found


def _moved(motion_model: MotionModel, data: mujoco.MjData, pose: int, missed: list[Motion]) -> Motion:
    """The motion to a pose, together with those that missed others before it; one more is noted where this misses."""
    try:
        motion = motion_model.move(data, pose)
    except ProcedureStoppedError as error:
        error.motion = joined([*missed, error.motion])
        raise
    if motion.is_done:
        return joined([*missed, motion])
    if len(motion.time_s):
        missed.append(motion)
    return motion
