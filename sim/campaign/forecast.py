"""The forecast of a study: how many trials it has, and about how long they take at most."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from tqdm import tqdm

from sim.campaign.engines.local import LocalEngine
from sim.episode.measures import ACTION_SECONDS
from sim.tables import markdown_table

from .journal import encoded
from .study import Study, Trial
from .trial_result import TrialResult

N_PROBED = 3
"""Actions of the first trial of each combination that are run to see how long they take."""
MAX_COMBINATIONS = 12
"""Combinations that are tried; the others are taken to be like the mean of these."""


@dataclass(frozen=True)
class Forecast:
    """What one combination of options is expected to take."""

    trial: Trial
    n_trials: int
    trial_s: float
    """Time of a trial that takes all its actions [s]."""
    entry_bytes: float
    """What such a trial adds to the journal."""
    error: str | None = None
    """Why the trial that was tried failed; None if it did not."""

    @property
    def core_s(self) -> float:
        """Time of all trials on one core [s]."""
        return self.n_trials * self.trial_s


def forecast_study(study: Study, *, n_jobs: int) -> list[Forecast]:
    """The forecasts for the first combinations of a study, each from a few actions of its first trial."""
    counts = dict(study.first_trials())
    tried = list(counts)[:MAX_COMBINATIONS]
    probes = {_probe(trial): trial for trial in tried}
    forecasts = {}
    with LocalEngine(n_jobs) as engine, tqdm(total=len(tried), desc="trying each combination") as progress:
        for outcome in engine.outcomes(list(probes)):
            if outcome is not None:
                trial = probes[outcome.trial]
                size = len(encoded(outcome.result.entry(outcome.trial)))
                forecasts[trial] = _forecast(trial, counts[trial], outcome.result, size)
                progress.update()
    return [forecasts[trial] for trial in tried]


def _probe(trial: Trial) -> Trial:
    steps = min(N_PROBED, trial.config.steps)
    return Trial(dataclasses.replace(trial.config, steps=steps, until_sensed=None))


def _forecast(trial: Trial, n_trials: int, result: TrialResult, size: int) -> Forecast:
    timings = result.timings
    actions_s = sum(timings.get(part, 0.0) for part in ACTION_SECONDS)
    per_action_s = actions_s / min(N_PROBED, trial.config.steps)
    n_curves = sum(not name.endswith("precision") for name in result.curves)
    # Each curve takes "0.123456," per action.
    more_bytes = 9 * n_curves * max(trial.config.steps - N_PROBED, 0)
    trial_s = timings.get("setup_s", 0.0) + per_action_s * trial.config.steps
    return Forecast(trial, n_trials, trial_s, size + more_bytes, result.row.get("error"))


def forecast_text(study: Study, forecasts: Sequence[Forecast], *, n_jobs: int) -> str:
    """A forecast as text for a terminal."""
    head = ("scenario", "planner", "arm", "trials", "actions at most", "s per trial at most")
    rows = [
        (
            forecast.trial.config.scenario,
            forecast.trial.config.planner,
            forecast.trial.config.arm,
            str(forecast.n_trials),
            str(forecast.trial.config.steps),
            f"{forecast.trial_s:.1f}",
        )
        for forecast in forecasts
    ]
    n_tried = sum(forecast.n_trials for forecast in forecasts)
    share = len(study) / n_tried
    core_s = share * sum(forecast.core_s for forecast in forecasts)
    size = share * sum(forecast.n_trials * forecast.entry_bytes for forecast in forecasts)
    lines = [
        f"{study.title}: {len(study)} trials",
        markdown_table(head, rows),
        f"at most {core_s / 3600:.2g} core hours, {core_s / n_jobs / 3600:.2g} hours with `jobs` "
        f"{n_jobs}, and {size / 1e6:.2g} MB of journal, if every trial takes all its actions",
    ]
    errors = [forecast.error for forecast in forecasts if forecast.error]
    if errors:
        lines.append(f"{len(errors)} of the {len(forecasts)} combinations tried fail: {errors[0]}")
    if len(forecasts) < len(list(study.first_trials())):
        lines.append(
            f"(from the first {len(forecasts)} combinations; the others are taken to be like their mean)"
        )
    if any(forecast.trial.config.until_sensed is not None for forecast in forecasts):
        lines.append("Trials that stop when enough was sensed take far less.")
    return "\n".join(lines)
