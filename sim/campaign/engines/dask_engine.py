"""Trials on a Dask cluster, by Dask's own interface, which runs the trials of lost workers again."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any

from distributed import (  # pyright: ignore[reportMissingImports], an extra that need not be there
    Client,
    Future,
    LocalCluster,
    wait,
)
from distributed.scheduler import KilledWorker  # pyright: ignore[reportMissingImports]

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult, lost_result
from sim.errors import FieldError
from sim.workers import POLL_S

from .engine import Engine, Outcome, Work, run_there

TRIALS_PER_THREAD = 2
"""Trials that each thread of the cluster is given: one runs, and the next is there when it ends."""
CONNECT_S = 20
"""How long a scheduler may take to answer."""


class DaskEngine(Engine):
    """The workers of a cluster, or `n_jobs` processes of this machine. A worker must have one thread and not more."""

    def __init__(self, n_jobs: int, address: str | None, *, work: Work = run_there) -> None:
        """Connect to the scheduler at an address, or start one here.

        Raises:
            UsageError: No scheduler answers at the address.
        """
        self._work = work
        self._cluster = None
        if address is None:
            self._cluster = LocalCluster(n_workers=n_jobs, threads_per_worker=1, dashboard_address=":0")
        try:
            self._client = Client(address or self._cluster, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise FieldError("address", address, f"no Dask scheduler answers there ({error}).") from error

    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome | None]:
        """See `Engine.outcomes`."""
        waiting = iter(trials)
        running = {}
        while True:
            n_threads = max(sum(_answered(self._client.nthreads()).values()), 1)
            for trial in itertools.islice(waiting, max(TRIALS_PER_THREAD * n_threads - len(running), 0)):
                running[self._client.submit(self._work, trial, pure=False)] = trial
            if not running:
                return
            try:
                done = _answered(wait(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED")).done
            except TimeoutError:
                yield None
                continue
            for future in done:
                yield Outcome(running.pop(future), _result(future))

    def close(self) -> None:
        """See `Engine.close`."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def _answered(answer: Any) -> Any:
    """An answer of the client, which is there at once; the client's annotations leave open whether it is awaited."""
    return answer


def _result(future: Future) -> TrialResult:
    try:
        return future.result()
    except KilledWorker as error:
        return lost_result(error.allowed_failures + 1)
