"""Episodes that a file keeps as they end, so that a benchmark, called again, goes on where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from sim.campaign.journal import Entry, Journal
from sim.campaign.study import key_of
from sim.closeable import Closeable
from sim.workers import Workers

Job = TypeVar("Job", bound=Hashable)
Row = dict[str, Any]


class KeptEpisodes(Closeable, Generic[Job]):
    """The rows of episodes, each known by its settings. A change of the code needs a new file."""

    def __init__(
        self,
        file: Path,
        play: Callable[[Job], Row],
        settings_of: Callable[[Job], dict[str, Any]],
        *,
        n_jobs: int,
    ) -> None:
        """Open the file, which is made where there is none. `play` runs in worker processes, and is sent to them."""
        file.parent.mkdir(parents=True, exist_ok=True)
        self.settings_of = settings_of
        self._journal = Journal(file)
        self._workers = Workers[Job, Row](play, n_jobs=n_jobs)

    def rows(self, jobs: Sequence[Job], label: str = "") -> list[Row]:
        """The rows of the jobs, in their order. Those that the file lacks are played first."""
        settings = {job: self.settings_of(job) for job in jobs}
        missing = [job for job in jobs if key_of(settings[job]) not in self._journal]
        played = self._workers.in_order(missing, lost="one episode.")
        bar = tqdm(played, total=len(missing), desc=label, unit="episode")
        for job, row in zip(missing, bar, strict=True):
            entry: Entry = {"settings": settings[job], "row": {"status": "finished", **row}}
            self._journal.append(entry)
        return [entry["row"] for entry in self._journal.entries([key_of(each) for each in settings.values()])]

    def close(self) -> None:
        """End the workers and close the file."""
        self._workers.close()
        self._journal.close()
