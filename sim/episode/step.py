"""A step: one sensing action of an episode, and the poses that were skipped before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sim.world.ik.result import IkResult
from sim.world.sensing.reading import Reading

from .body_options import BodyScore
from .moving.motion import Motion, SkippedPose
from .sweeping.score import SweepScore
from .target_belief import TargetScore

Ending = Literal["steps", "sensed", "confident", "not_worth", "no_pose_left"]
"""What ends an episode: all its steps are done, enough is sensed, the planner is sure, more actions are not worth what
they would find, or the arm reaches no more."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Step:
    """One sensing action and its results."""

    step: int
    """Number of the action, from 1."""
    pose_index: int
    ik: IkResult
    reading: Reading
    sensed_fraction: float | None
    """Share of the tumours' detection points that lay in some cone so far; None without tumours."""
    auprc: float | None
    """Area under the map's precision-recall curve; None without tumours or without a map."""
    skipped: tuple[SkippedPose, ...]
    """Poses ranked before this one that the arm could not take."""
    motion: Motion
    """The way there from the last contact: lift, transfer, descent."""
    procedure_s: float
    """Modelled time of motion and sensing."""
    plan_s: float
    ik_s: float
    move_s: float
    sense_s: float
    update_s: float
    target: TargetScore | None = None
    """How a second class stands; None where none is mapped."""
    body: BodyScore | None = None
    """How well it is known where the organ lies; None where it lies as planned."""
    sweep: SweepScore | None = None
    """What was read on the way, and how often the probe was lifted; None where it is lifted for every action."""
