"""An engine without processes: trials run in the test's own, which saves each call the start of a worker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sim.campaign.engines.engine import Engine, Outcome, run_there
from sim.campaign.study import Trial


class EngineHere(Engine):
    """Runs trials one after the other where it is called, with the work that the other engines do."""

    def __init__(self, *_arguments: object, **_more: object) -> None:
        """Take what `make_engine` takes, and heed none of it."""

    def outcomes(self, trials: Iterable[Trial]) -> Iterator[Outcome]:
        """See `Engine.outcomes`."""
        for trial in trials:
            yield Outcome(trial, run_there(trial))

    def close(self) -> None:
        """Nothing was started."""
