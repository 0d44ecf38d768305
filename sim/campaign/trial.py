"""One trial of a campaign, as a worker process runs it: an episode without a folder, and its row."""

from __future__ import annotations

import math
import os
import sys
import threading
import traceback
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from mapping import Prediction, precision_recall_curve
from sim.episode.episode import Episode
from sim.episode.setup import Setup, build_setup
from sim.findings.evidence import EpisodeWitness, Evidence
from sim.findings.findings import find
from sim.findings.free_response import free_response
from sim.findings.measures import lesion_measures
from sim.running.fields import recorded
from sim.running.output import Output
from sim.running.parts import EpisodeParts, make_parts
from sim.running.run_episode import make_episode, record_episode
from sim.running.summary import Totals, episode_summary

from .journal import encoded
from .lesions import trial_findings
from .lookahead import Lookahead
from .study import Trial
from .trial_result import RECALL_LEVELS, TrialResult

CURVE_DIGITS = 6
"""Decimals of the curves that are kept; scores in the rows have all their digits."""
MEASURED = ("setup_s", "render_s", "wall_s")
"""Keys of a summary that hold measured seconds, besides those of the steps."""

_one_at_a_time = threading.Lock()
"""The kinematics of a setup serve one trial at a time, however many threads a cluster's worker has."""
_setups: dict[tuple[Any, ...], Setup] = {}
"""The setup of the last trial in this process, by what it was built from."""


def run_trial(trial: Trial) -> TrialResult:
    """The result of a trial, run with one BLAS thread. What it raises becomes its status, so that a campaign goes on.

    Args:
        trial: The episode to run. Where it names a folder, the episode's folder is written there too.
    """
    start_s = perf_counter()
    with _one_at_a_time, threadpool_limits(limits=1):
        try:
            result = _run(trial, start_s)
            encoded(result.entry(trial))  # what the journal cannot hold fails here, in the trial
            return result
        # The campaign's boundary: whatever fails, what a user brings along too, is a row and not the campaign's end.
        except (Exception, SystemExit) as error:
            row = {"status": "failed", "error": f"{type(error).__name__}: {error}"}
            return TrialResult(row, _costs(start_s), traceback=traceback.format_exc())


def _run(trial: Trial, start_s: float) -> TrialResult:
    parts = make_parts(trial.config)
    setup, stage_s = _setup(parts)
    if trial.folder is not None:
        write_trial_folder(trial)
    setup_start_s = perf_counter()
    planner = parts.planner
    is_blind = not (planner.needs_belief or planner.needs_readings)
    ahead = Lookahead(planner, setup.positioner) if is_blind and parts.sweep is None else planner
    casts_rays = parts.keeps_map or planner.needs_readings
    episode = make_episode(parts, setup, planner=ahead, casts_rays=casts_rays)
    setup_s = perf_counter() - setup_start_s
    totals, witness = Totals(), EpisodeWitness(episode, parts.map_settings.prior_prevalence)
    for step in episode.steps(parts.n_steps, **parts.stops):
        totals.add(step)
        witness.note()
    summary = episode_summary(episode, totals, episode.metrics(), parts)
    found_start_s = perf_counter()
    measures, findings = _findings(witness.evidence())
    summary |= {"ended_by": episode.ended_by, **measures}
    findings_s = perf_counter() - found_start_s
    measured = (*totals.seconds(), *MEASURED)
    row = {"status": "finished"} | {
        key: _plain(value) for key, value in summary.items() if key not in measured
    }
    timings = totals.seconds() | {"findings_s": findings_s, "setup_s": setup_s, "stage_s": stage_s}
    timings |= _costs(start_s)
    if isinstance(ahead, Lookahead):
        # These poses were solved while the planner ranked.
        timings |= {"plan_s": timings["plan_s"] - ahead.prepare_s, "ik_s": timings["ik_s"] + ahead.prepare_s}
    notices = tuple(dict.fromkeys((*setup.notices, *episode.notices)))
    poses = tuple(map(int, episode.sensed))
    return TrialResult(row, timings, _curves(episode, totals), findings, poses, notices=notices)


def _findings(evidence: Evidence) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the row of a trial says of its lesions, and what the journal keeps of them."""
    findings = find(evidence)
    return lesion_measures(findings), trial_findings(findings, free_response(evidence))


def write_trial_folder(trial: Trial) -> None:
    """Run a trial's episode on the setup of this process, and write its folder."""
    assert trial.folder is not None
    parts = make_parts(trial.config)
    output = Output(folder=trial.folder, options=recorded(trial.config), overwrite=True)
    record_episode(parts, output, setup=_setup(parts)[0], show_progress=False)


def _setup(parts: EpisodeParts) -> tuple[Setup, float]:
    """The setup of an episode, and the time that building it took; this process keeps the last one."""
    key = (parts.scenario, parts.arm, parts.probe, parts.map_settings.hinge_spacing_m)
    start_s = perf_counter()
    if key not in _setups:
        _setups.clear()
        _setups[key] = build_setup(parts.scenario, parts.arm, parts.map_settings, probe=parts.probe)
    return _setups[key], perf_counter() - start_s


def _curves(episode: Episode, totals: Totals) -> dict[str, list[float | None]]:
    curves: dict[str, list[float | None]] = {
        "sensed_fraction": [_rounded(step.sensed_fraction) for step in totals.steps]
    }
    if episode.prediction is not None:
        curves["auprc"] = [_rounded(step.auprc) for step in totals.steps]
        curves["precision"] = _final_precision(episode.prediction, episode.truth.is_tumour)
    if (target := episode.target) is not None:
        # With a second class every step has a score of it; the condition tells the type checker.
        scores = [step.target for step in totals.steps if step.target is not None]
        curves["target_sensed_fraction"] = [_rounded(score.sensed_fraction) for score in scores]
        if target.prediction is not None:
            curves["target_auprc"] = [_rounded(score.auprc) for score in scores]
            curves["target_precision"] = _final_precision(target.prediction, target.truth.is_target)
    return {name: values for name, values in curves.items() if values}


def _final_precision(prediction: Prediction, truth: NDArray[np.bool_]) -> list[float | None]:
    """The precision of a map at each of `RECALL_LEVELS`; empty where there is nothing to find."""
    if not truth.any():
        return []
    curve = precision_recall_curve(prediction.score, truth)
    return [_rounded(p) for p in precision_at(curve.recall, curve.precision)]


def precision_at(recall: NDArray[np.float64], precision: NDArray[np.float64]) -> NDArray[np.float64]:
    """The precision where each of `RECALL_LEVELS` is first met, as the area under the curve counts it, shape (50,).

    Args:
        recall: Rising recall, from 0 to 1, shape (K,).
        precision: Precision at each recall, shape (K,).
    """
    return precision[np.searchsorted(recall, RECALL_LEVELS - 1e-12)]


def _costs(start_s: float) -> dict[str, float]:
    """The wall time since the start, and the largest memory of this process."""
    return {
        "wall_s": perf_counter() - start_s,
        "peak_memory_mb": _peak_memory_mb(),
        "process": os.getpid(),
    }


def _peak_memory_mb() -> float:
    """The largest memory that this process had [MiB]; NaN on Windows, where Python cannot tell it."""
    if sys.platform == "win32":
        return math.nan
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), CURVE_DIGITS)


def _plain(value: Any) -> Any:
    """A value of a summary as JSON has it: NaN becomes None, and a path text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value
