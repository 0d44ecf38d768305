"""The result of a trial, as plain data that processes hand over and the journal keeps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .study import Trial

RECALL_LEVELS = np.arange(1, 51) / 50
"""Levels at which a trial's precision is kept."""


@dataclass(frozen=True)
class TrialResult:
    """The result of a trial."""

    row: dict[str, Any]
    """Status and summary, which are the same wherever and whenever the trial runs."""
    timings: dict[str, float] = field(default_factory=dict)
    """Measured seconds by part, and the largest memory of the process."""
    curves: dict[str, list[float | None]] = field(default_factory=dict)
    """AUPRC and sensed share after each action, and precision at each of `RECALL_LEVELS` at the end.

    The curves of a second class have names that begin with `target_`.
    """
    findings: dict[str, Any] = field(default_factory=dict)
    """What became of each lesion, as `trial_findings` makes it; empty where the trial failed."""
    poses: tuple[int, ...] = ()
    """The poses that were sensed, in order."""
    traceback: str | None = None
    """Where the error of a failed trial was raised; None for a finished one."""

    notices: tuple[str, ...] = ()
    """What is to be known about the trial's files."""

    def entry(self, trial: Trial) -> dict[str, Any]:
        """The journal's entry of the trial."""
        more = {"traceback": self.traceback} if self.traceback else {}
        more |= {"notices": list(self.notices)} if self.notices else {}
        more |= {"findings": self.findings} if self.findings else {}
        more |= {"poses": list(self.poses)} if self.poses else {}
        parts = {"row": self.row, "timings": self.timings, "curves": self.curves}
        return {"settings": trial.settings} | parts | more


def lost_result(n_deaths: int) -> TrialResult:
    """The result of a trial whose worker process died each time."""
    error = f"its worker process died {n_deaths} times, for example of too little memory"
    return TrialResult({"status": "worker died", "error": error})
