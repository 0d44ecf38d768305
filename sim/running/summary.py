"""The summary of an episode, and the totals of its steps that it tells."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from mapping import MapMetrics, average_precision
from sim.episode.attainment import seeable_points
from sim.episode.episode import Episode
from sim.episode.measures import ACTION_SECONDS, SENSED_GOAL
from sim.episode.moving.held_force import HELD_CELLS, held_together
from sim.episode.step import Step
from sim.episode.sweeping.score import SWEEP_CELLS
from sim.episode.target_belief import TargetBelief
from sim.world.frames import rigid_inverse

from .config import DEFAULT_PROBE
from .parts import EpisodeParts

MANY_SKIPPED = 100
"""A notice is given when this many poses in a row are out of the arm's reach."""
SKIPPED_NOTE = (
    f"note: the arm reaches none of the {MANY_SKIPPED} poses chosen last; still looking for one that it reaches. "
    "`sounding reach` with the same arm and organ shows which it reaches; the organ pose `best` moves the organ."
)


@dataclass
class Totals:
    """What the steps of an episode add up to so far."""

    steps: list[Step] = field(default_factory=list)
    sensings_to_95: int | None = None
    """The action after which 95 % of the tumours was sensed; None before it."""
    target_sensings_to_95: int | None = None
    """The action after which 95 % of a second class was sensed; None before it."""
    n_skipped_poses: int = 0

    def add(self, step: Step) -> None:
        """Count one more step."""
        self.steps.append(step)
        self.n_skipped_poses += len(step.skipped)
        if self.sensings_to_95 is None and (step.sensed_fraction or 0.0) >= SENSED_GOAL:
            self.sensings_to_95 = step.step
        target_share = 0.0 if step.target is None else step.target.sensed_fraction
        if self.target_sensings_to_95 is None and target_share >= SENSED_GOAL:
            self.target_sensings_to_95 = step.step

    def seconds(self) -> dict[str, float]:
        """The computing time by part [s]."""
        return {name: sum(getattr(step, name) for step in self.steps) for name in ACTION_SECONDS}

    def motion(self) -> dict[str, float | None]:
        """The modelled time of the procedure, and the ways of joints and tip."""
        travels_rad = [step.motion.joint_travel_rad for step in self.steps]
        return {
            "motion_s": sum(step.motion.motion_s for step in self.steps),
            "procedure_s": sum(step.procedure_s for step in self.steps),
            "joint_travel_rad": None if None in travels_rad else sum(way for way in travels_rad if way),
            "tip_path_m": sum(step.motion.tip_path_m for step in self.steps),
        }

    def sweeps(self) -> dict[str, float | None]:
        """What was read on the way, and how often the probe was lifted; empty where it senses where it stops."""
        scores = [step.sweep for step in self.steps if step.sweep is not None]
        if not scores:
            return {}
        held = held_together([step.motion.held for step in self.steps if step.motion.held is not None])
        sums: dict[str, float | None] = {
            name: sum(getattr(score, name) for score in scores) for name in SWEEP_CELLS
        }
        return sums | ({} if held is None else {name: getattr(held, name) for name in HELD_CELLS})


def episode_summary(
    episode: Episode, totals: Totals, metrics: MapMetrics | None, parts: EpisodeParts
) -> dict[str, Any]:
    """The results of an episode, as summary.json and the rows of trials hold them.

    Args:
        episode: The episode after its last step.
        totals: The totals of its steps.
        metrics: Scores of its map; None without a map.
        parts: What it was made of. What the planner expects to be left is told where the episode may end by that.
    """
    last, names = totals.steps[-1] if totals.steps else None, parts.names
    tumour_of = episode.truth.anatomy.tumour_of(episode.setup.search_points_m)
    return {
        "scenario": episode.setup.scenario.name,
        "planner": names["planner"],
        "arm": names["arm"],
        **({} if names.get("probe", DEFAULT_PROBE) == DEFAULT_PROBE else {"probe": names["probe"]}),
        "seed": parts.seed,
        "n_sensings": len(totals.steps),
        "sensings_to_95": totals.sensings_to_95,
        "sensed_fraction": None if last is None else last.sensed_fraction,
        "attainable_fraction": episode.truth.attainable_fraction,
        "visible_fraction": float(seeable_points(episode.setup, episode.skipped).mean()),
        **({} if metrics is None else dataclasses.asdict(metrics)),
        "n_points_per_tumour": [
            int((tumour_of == i).sum()) for i in range(len(episode.truth.anatomy.tumours))
        ],
        **_target_summary(episode.target, totals),
        "confidence": episode.confidence(),
        **(_left(episode) if parts.asks_what_is_left else {}),
        **_body_summary(episode, last),
        "n_skipped_poses": totals.n_skipped_poses,
        **totals.motion(),
        **totals.sweeps(),
        **totals.seconds(),
    }


def _left(episode: Episode) -> dict[str, Any]:
    """How many lesions the planner counts and expects to be left, and the share that no pose could find."""
    left = episode.planner.what_is_left(episode.situation())
    if left is None:
        return {}
    return {
        "n_lesions_counted": left.n_found,
        "lesions_left_expected": left.expected_left,
        "unseeable_share": left.unseeable_share,
        "lesions_unseeable_expected": left.expected_unseeable,
    }


def _body_summary(episode: Episode, last: Step | None) -> dict[str, Any]:
    """How well it is known where the organ lies; empty where it lies as planned."""
    if episode.body is None or last is None or last.body is None:
        return {}
    figures: dict[str, Any] = dataclasses.asdict(last.body)
    if episode.prediction is not None and episode.truth.is_tumour.any():
        # A map that lies wholly beside the plan, and is else right, is right in the frame in which the probe senses.
        T = rigid_inverse(episode.body.T_world_rest_at_exhale) @ episode.body.T_world_rest_believed(0.0)
        truth = episode.truth.anatomy.is_tumour(episode.setup.search_points_m @ T[:3, :3].T + T[:3, 3])
        figures["auprc_own_frame"] = average_precision(episode.prediction.score, truth)
    return figures


def _target_summary(target: TargetBelief | None, totals: Totals) -> dict[str, Any]:
    """The results of an episode in the second class; empty where there is none."""
    if target is None:
        return {}
    last, metrics = totals.steps[-1].target if totals.steps else None, target.metrics()
    figures = {
        "name": target.name,
        "n_bodies": len(target.truth.anatomy.tumours),
        "sensings_to_95": totals.target_sensings_to_95,
        "sensed_fraction": None if last is None else last.sensed_fraction,
        "attainable_fraction": target.truth.attainable_fraction,
        **({} if metrics is None else dataclasses.asdict(metrics)),
    }
    return {f"target_{name}": value for name, value in figures.items()}


def progress_text(step: Step, episode: Episode) -> str:
    """What a progress bar tells after an action."""
    auprc = "–" if step.auprc is None else f"{step.auprc:.2f}"
    sensed = "–" if step.sensed_fraction is None else f"{step.sensed_fraction:.0%}"
    sure = f", sure {episode.confidence():.0%}" if episode.planner.tells_confidence else ""
    return f"AUPRC {auprc}, sensed {sensed}{sure}"
