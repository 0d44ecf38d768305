"""Trials in processes of this machine, each a pool of its own, so that it is known which trial killed a process."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool

from loky import ProcessPoolExecutor

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult, lost_result
from sim.errors import UsageError

from .engine import MAX_TRIES, POLL_S, Engine, Outcome, Work, run_there

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # A setup that is kept from trial to trial is not a leak.
    "LOKY_MAX_MEMORY_LEAK_SIZE": "2e9",
}
"""Environment of the worker processes."""
MAX_FIRST_DEATHS = 4
"""When processes die this often before any has finished a trial, they cannot run here at all."""


class LocalEngine(Engine):
    """`n_jobs` processes; one that dies is replaced."""

    def __init__(self, n_jobs: int, *, work: Work = run_there) -> None:
        """Prepare the processes, which start with their first trial.

        Args:
            n_jobs: Number of processes.
            work: What is done with a trial; by default it is run.
        """
        self._work = work
        self._idle = [_new_process() for _ in range(n_jobs)]
        self._running: dict[Future[TrialResult], tuple[Trial, ProcessPoolExecutor]] = {}
        self._n_deaths: dict[Trial, int] = {}

    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome | None]:
        """See `Engine.outcomes`."""
        waiting, again = iter(trials), list[Trial]()
        has_finished_any = False
        while True:
            while self._idle and (trial := again.pop() if again else next(waiting, None)) is not None:
                self._start(trial)
            if not self._running:
                return
            done, _ = wait(self._running, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                trial, process = self._running.pop(future)
                try:
                    outcome = Outcome(trial, future.result())
                    has_finished_any = True
                    self._idle.append(process)
                except BrokenProcessPool as error:
                    outcome = self._replace_dead(trial, process)
                    if not has_finished_any and sum(self._n_deaths.values()) >= MAX_FIRST_DEATHS:
                        raise UsageError(f"worker processes die at once: {error}") from error
                    if outcome is None:
                        again.append(trial)
                        continue
                yield outcome
            if not done:
                yield None

    def _start(self, trial: Trial) -> None:
        """Hand a trial to an idle process; one that died while idle is replaced."""
        process = self._idle.pop()
        try:
            future = process.submit(self._work, trial)
        except BrokenProcessPool:
            process = _new_process()
            future = process.submit(self._work, trial)
        self._running[future] = (trial, process)

    def _replace_dead(self, trial: Trial, process: ProcessPoolExecutor) -> Outcome | None:
        """Replace a dead process, and return its trial's outcome if the trial is not to be tried again."""
        process.shutdown(wait=False, kill_workers=True)
        self._idle.append(_new_process())
        self._n_deaths[trial] = self._n_deaths.get(trial, 0) + 1
        if self._n_deaths[trial] < MAX_TRIES:
            return None
        return Outcome(trial, lost_result(self._n_deaths[trial]))

    def close(self) -> None:
        """See `Engine.close`."""
        for process in [*self._idle, *(process for _, process in self._running.values())]:
            process.shutdown(wait=True, kill_workers=True)
        self._idle.clear()
        self._running.clear()


def _new_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, initializer=_begin, initargs=(os.getpid(),), env=ENVIRONMENT)


def _begin(parent: int) -> None:
    """Leave Ctrl-C to the campaign, and end when the campaign's process is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(POLL_S)
    os._exit(1)
