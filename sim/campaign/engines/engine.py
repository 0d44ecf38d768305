"""Engines: where the trials of a campaign run."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult
from sim.closeable import Closeable

Work = Callable[[Trial], TrialResult]
"""What a process does with a trial."""


@dataclass(frozen=True)
class Outcome:
    """A trial and its result."""

    trial: Trial
    result: TrialResult


class Engine(Closeable):
    """What runs trials in processes of its own. It is a context manager, whose end stops what still runs."""

    @abstractmethod
    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome | None]:
        """The outcomes of trials as they end, in any order; None now and then while no trial has ended.

        Trials are taken from the iterable as processes become free.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop the trials that still run, and end the processes."""


def run_there(trial: Trial) -> TrialResult:
    """The result of a trial, which is run in this process."""
    # Imported here, since it imports MuJoCo, which the campaign's own process never needs.
    from sim.campaign.trial import run_trial

    return run_trial(trial)
