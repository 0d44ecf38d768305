"""Trials of sweeps and of stop and go at equal times of the procedure, kept one a line, so that a run goes on later.

`benchmarks.sweeps` runs them and prints their table.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, process_time
from typing import Any

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from sim.episode.episode import Episode
from sim.episode.measures import NEVER, SENSED_GOAL
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import Setup, build_setup
from sim.episode.step import Step
from sim.findings.evidence import EpisodeWitness, Evidence
from sim.findings.findings import find
from sim.running.fields import config_of
from sim.running.parts import EpisodeParts, make_parts
from sim.running.run_episode import make_episode
from sim.running.sweep import SWEEP

TIMES_S = (30.0, 60.0, 120.0)
"""Times of the procedure at which contenders are compared [s]."""
MOST_ACTIONS = 150
"""A trial that is not at an end before ends there."""
N_PLANTED = 3
"""Tumours that are planted in a real organ."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Contender:
    """A planner and how it senses."""

    planner: str
    sense: str
    sensing_s: float = 2.0

    @property
    def sensing(self) -> str:
        """How it senses, as the table tells it."""
        return SWEEP if self.sense == SWEEP else f"stop, {self.sensing_s:g} s"

    @property
    def options(self) -> dict[str, Any]:
        """Its fields of an episode."""
        return {"planner": self.planner, "sense": self.sense, "sensing_s": self.sensing_s}


BASE = Contender("find-and-outline", "stop")
"""What all others are compared with."""
CONTENDERS = (
    BASE,
    Contender("find-and-outline", "stop", 0.1),
    *(
        Contender(name, SWEEP)
        for name in ("find-and-outline", "find-and-outline-paths", "boustrophedon", "ergodic", "a-star")
    ),
)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Which trials are run."""

    case: str
    """A scenario, or a folder of $SOUNDING_DATA/livers, in whose organ tumours are planted."""
    arm: str
    contenders: Sequence[Contender]
    seeds: range

    def parts(self, contender: Contender, seed: int) -> EpisodeParts:
        """What one trial is made of."""
        motion = "none" if self.arm == "none" else "kinematic"
        more = contender.options | {"arm": self.arm, "motion": motion, "seed": seed, "steps": MOST_ACTIONS}
        return make_parts(config_of(organ_of(self.case), **more))


def organ_of(case: str) -> dict[str, Any]:
    """The fields of an episode that name an organ."""
    if case in SCENARIOS:
        return {"scenario": case}
    file = Path(os.environ.get("SOUNDING_DATA", "../shared/data")) / "livers" / case / "segmentation.nii.gz"
    return {"organ": str(file), "n_tumours": N_PLANTED}


def run_plan(plan: Plan, file: Path, *, until_s: float) -> None:
    """Run the trials of a plan that a file does not hold yet, seed by seed, and add a line for each.

    Args:
        plan: The trials.
        file: One JSON object a line.
        until_s: Seconds after which no further trial begins.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    end_torn_line(file)
    done = {key_of(row) for row in rows_of([file])}
    trials = [(seed, each) for seed in plan.seeds for each in plan.contenders]
    is_open = [(plan.case, plan.arm, each.planner, each.sensing, seed) not in done for seed, each in trials]
    trials = [trial for trial, wanted in zip(trials, is_open, strict=True) if wanted]
    setup: Setup | None = None
    end_s = monotonic() + until_s
    with threadpool_limits(limits=1), file.open("a", encoding="utf-8") as lines:
        for seed, contender in tqdm(trials, desc=f"{plan.case}, {plan.arm}", unit="trial"):
            if monotonic() >= end_s:
                return
            parts = plan.parts(contender, seed)
            setup = setup or build_setup(parts.scenario, parts.arm, parts.map_settings, probe=parts.probe)
            named = {"case": plan.case, "arm": plan.arm, "seed": seed}
            named |= {"planner": contender.planner, "sensing": contender.sensing}
            lines.write(json.dumps(named | trial_row(parts, setup)) + "\n")
            lines.flush()


def end_torn_line(file: Path) -> None:
    """End what a kill left of a line, so that the next trial has a line of its own."""
    if file.is_file() and file.stat().st_size and not file.read_bytes().endswith(b"\n"):
        with file.open("ab") as lines:
            lines.write(b"\n")


def key_of(row: Row) -> tuple[Any, ...]:
    """What tells a trial from all others."""
    return tuple(row[name] for name in ("case", "arm", "planner", "sensing", "seed"))


def rows_of(files: Sequence[Path]) -> list[Row]:
    """The trials that files hold; part of a line that a kill left is none."""
    rows = []
    for file in files:
        lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
        for line in lines:
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return rows


def trial_row(parts: EpisodeParts, setup: Setup) -> Row:
    """What a trial did until the last of `TIMES_S` was over or all was sensed, and at least until 95 % was."""
    episode = make_episode(parts, setup)
    witness = EpisodeWitness(episode, parts.map_settings.prior_prevalence)
    steps, seconds, at = list[Step](), 0.0, dict[str, Row]()
    before, n_to_95 = copied(witness.evidence()), None
    computing_s, begin_s = 0.0, process_time()
    for step in episode.steps(parts.n_steps):
        # The time of this process alone: what else the machine does is none of it.
        computing_s += process_time() - begin_s
        seconds += step.procedure_s
        # What an action finds counts from its end on.
        for time_s in due(seconds, at):
            at[time_s] = standing(before, steps)
        steps.append(step)
        witness.note()
        before = copied(witness.evidence())
        if n_to_95 is None and (step.sensed_fraction or 0.0) >= SENSED_GOAL:
            n_to_95 = len(steps)
        if n_to_95 is not None and (len(at) == len(TIMES_S) or is_all_sensed(episode)):
            break
        begin_s = process_time()
    for time_s in due(float("inf"), at):
        at[time_s] = standing(before, steps)
    whole = totals_of(steps) | {"computing_s": computing_s}
    return {"is_sensed": n_to_95 is not None, **totals_of(steps[:n_to_95]), "at": at, "whole": whole}


def is_all_sensed(episode: Episode) -> bool:
    """Whether all was sensed that reachable poses can sense."""
    truth = episode.truth
    return bool((episode.first_seen[truth.is_attainable] != NEVER).all())


def due(seconds: float, at: Row) -> Iterator[str]:
    """The times that lie before a time of the procedure [s] and are not told of yet."""
    return iter([name for time_s in TIMES_S if time_s < seconds and (name := f"{time_s:g}") not in at])


def copied(evidence: Evidence) -> Evidence:
    """Evidence that later actions do not change."""
    first_seen, first_called = evidence.first_seen.copy(), evidence.first_called.copy()
    return replace(evidence, first_seen=first_seen, first_called=first_called)


def standing(evidence: Evidence, steps: Sequence[Step]) -> Row:
    """Lesions found and the scores after some actions."""
    findings = find(evidence)
    last = steps[-1] if steps else None
    auprc, sensed = (None, None) if last is None else (last.auprc, last.sensed_fraction)
    return {"n_found": findings.n_found, "n_lesions": len(findings.tumours), "auprc": auprc, "sensed": sensed}


def totals_of(steps: Sequence[Step]) -> Row:
    """Times, ways and counts of some actions."""
    scores = [step.sweep for step in steps]
    return {
        "procedure_s": sum(step.procedure_s for step in steps),
        "n_actions": len(steps),
        "n_readings": sum(1 if score is None else score.n_readings for score in scores),
        # Stop and go lifts the probe before each action but the first.
        "n_lift_offs": sum(
            int(i > 0) if score is None else score.n_lift_offs for i, score in enumerate(scores)
        ),
        "tip_path_m": sum(step.motion.tip_path_m for step in steps),
        "contact_path_m": sum(0.0 if score is None else score.contact_path_m for score in scores),
    }
