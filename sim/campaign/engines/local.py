"""Trials in processes of this machine."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult, lost_result
from sim.workers import Workers

from .engine import Engine, Outcome, Work, run_there


class LocalEngine(Engine):
    """`n_jobs` processes; one that dies is replaced."""

    def __init__(self, n_jobs: int, *, work: Work = run_there) -> None:
        """Prepare the processes, which start with their first trial.

        Args:
            n_jobs: Number of processes.
            work: What is done with a trial; by default it is run.
        """
        self._workers = Workers[Trial, TrialResult](work, n_jobs=n_jobs)

    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome | None]:
        """See `Engine.outcomes`."""
        for done in self._workers.outcomes(trials):
            if done is None:
                yield None
            else:
                yield Outcome(done.item, done.result or lost_result(done.n_deaths))

    def close(self) -> None:
        """See `Engine.close`."""
        self._workers.close()
