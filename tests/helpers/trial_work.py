"""What worker processes do with trials in tests: quick, and sometimes deadly. Importable by name in a worker."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult

DEADLY_SEED = 3


def quick(trial: Trial) -> TrialResult:
    seed = trial.config.seed
    row = {"status": "finished", "n_sensings": seed + 1, "sensed_fraction": 1 / (seed + 1)}
    return TrialResult(row, {"wall_s": 0.1}, {"sensed_fraction": [0.5] * (seed + 1)})


def deadly(trial: Trial) -> TrialResult:
    """Kills its process at one seed, every time."""
    if trial.config.seed == DEADLY_SEED:
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(trial)


def deadly_once(trial: Trial) -> TrialResult:
    """Kills its process at one seed, the first time; the file that `organ` names remembers."""
    assert trial.config.organ is not None
    marker = Path(trial.config.organ)
    if trial.config.seed == DEADLY_SEED and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(trial)


def hopeless(trial: Trial) -> TrialResult:
    os._exit(1)


def own_id(trial: Trial) -> TrialResult:
    return TrialResult({"status": "finished", "process": os.getpid()})
