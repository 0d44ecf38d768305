"""Trials on a Ray cluster, by Ray's own interface, which runs the trials of lost workers again."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Iterator

import ray  # pyright: ignore[reportMissingImports], an extra that need not be there
from ray.exceptions import RayError, WorkerCrashedError  # pyright: ignore[reportMissingImports]

from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult, lost_result
from sim.errors import FieldError
from sim.workers import ENVIRONMENT, MAX_TRIES, POLL_S

from .engine import Engine, Outcome, Work, run_there

TRIALS_PER_CPU = 2
"""Trials that each processor of the cluster is given: one runs, and the next is there when it ends."""


class RayEngine(Engine):
    """The processors of a cluster, or `n_jobs` of this machine."""

    def __init__(self, n_jobs: int, address: str | None, *, work: Work = run_there) -> None:
        """Connect to the cluster at an address, or start one here.

        Raises:
            UsageError: No cluster answers at the address.
        """
        more = {} if address is not None else {"num_cpus": n_jobs, "include_dashboard": False}
        environment = {name: text for name, text in ENVIRONMENT.items() if name.endswith("THREADS")}
        try:
            ray.init(
                address=address,
                runtime_env={"env_vars": environment},
                log_to_driver=False,
                logging_level=logging.ERROR,
                **more,
            )
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise FieldError("address", address, f"no Ray cluster answers there ({error}).") from error
        self._work = ray.remote(num_cpus=1, max_retries=MAX_TRIES - 1)(work)

    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome | None]:
        """See `Engine.outcomes`."""
        waiting = iter(trials)
        running = {}
        while True:
            n_cpus = max(int(ray.cluster_resources().get("CPU", 1)), 1)
            for trial in itertools.islice(waiting, max(TRIALS_PER_CPU * n_cpus - len(running), 0)):
                running[self._work.remote(trial)] = trial
            if not running:
                return
            done, _ = ray.wait(list(running), timeout=POLL_S)
            if not done:
                yield None
            for reference in done:
                yield Outcome(running.pop(reference), _result(reference))

    def close(self) -> None:
        """See `Engine.close`."""
        ray.shutdown()


def _result(reference: ray.ObjectRef) -> TrialResult:
    try:
        return ray.get(reference)
    except WorkerCrashedError:
        return lost_result(MAX_TRIES)
    except RayError as error:
        return TrialResult({"status": "failed", "error": f"{type(error).__name__}: {error}"})
