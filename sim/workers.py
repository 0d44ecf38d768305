"""Worker processes: the one way in which work is shared among processes of this machine.

Each worker is a pool of one process. So it is known whose work killed a process, and no two workers share a lock that
a dead one could keep. Nothing is waited for longer than the other side lives: what a dead worker had in hand is done
again once, and workers end with the process that started them.
"""

from __future__ import annotations

import os
import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from loky import ProcessPoolExecutor
from tqdm import tqdm

from sim.closeable import Closeable
from sim.errors import UsageError
from sim.notices import Notify, print_notice

Item = TypeVar("Item")
Result = TypeVar("Result")

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # A setup that is kept from item to item is not a leak.
    "LOKY_MAX_MEMORY_LEAK_SIZE": "2e9",
}
"""Environment of the worker processes."""
POLL_S = 0.5
"""A wait ends this often even when nothing has happened, so that Ctrl-C is heeded."""
MAX_TRIES = 2
"""An item whose worker dies is tried this many times."""
MIN_FIRST_DEATHS = 4
"""When workers die this often, and each twice, before any has finished an item, they cannot run here at all."""
GRACE_POLLS = 2
"""Polls after which a pool that has not noticed the death of its process is told of it."""
NO_WORKERS = (
    "worker processes cannot be started here ({}), so this process does the work alone. They need semaphores, "
    "which live in /dev/shm: mount a tmpfs there to use more processors."
)

_kept: dict[str, Callable[[Any], Any]] = {}
"""What this process, which is a worker, does with its items."""


@dataclass(frozen=True)
class Done(Generic[Item, Result]):
    """What became of an item."""

    item: Item
    index: int
    """The number of the item, from 0 in the order in which they were given."""
    result: Result | None
    """What the work returned; None where the item is lost."""
    n_deaths: int
    """How many workers died of it."""

    @property
    def is_lost(self) -> bool:
        """Whether the item killed its worker each time."""
        return self.n_deaths >= MAX_TRIES


@dataclass
class _Task(Generic[Item]):
    item: Item
    index: int
    process: ProcessPoolExecutor
    n_quiet_polls: int = 0


class Workers(Closeable, Generic[Item, Result]):
    """`n_jobs` worker processes that do one kind of work; one that dies is replaced.

    Where no process can be started, for example without /dev/shm, this process does the work itself and says so.
    """

    def __init__(self, work: Callable[[Item], Result], *, n_jobs: int, notify: Notify = print_notice) -> None:
        """Prepare the workers, which start with their first items.

        Args:
            work: What is done with an item. It is pickled once, so it may be large, as a MuJoCo model is; items must be
                small.
            n_jobs: Number of processes.
            notify: Told where this process does the work itself.
        """
        self._work = work
        self._running: dict[Future[Result], _Task[Item]] = {}
        self._n_deaths: dict[int, int] = {}
        self._max_first_deaths = max(MIN_FIRST_DEATHS, MAX_TRIES * n_jobs)
        self._work_file = _pickled(work)
        try:
            self._idle = [self._new_process() for _ in range(n_jobs)]
        except (OSError, ImportError, NotImplementedError) as error:
            self._idle = []
            notify(NO_WORKERS.format(getattr(error, "strerror", None) or error))
        self._is_alone = not self._idle

    def outcomes(self, items: Iterable[Item]) -> Iterator[Done[Item, Result] | None]:
        """What became of items as they end, in any order; None now and then while nothing has ended.

        Items are taken from the iterable as workers become free. What the work raises is raised here.

        Raises:
            UsageError: Workers die before any has finished an item.
        """
        numbered, again = enumerate(items), list[tuple[int, Item]]()
        if self._is_alone:
            yield from (Done(item, index, self._work(item), 0) for index, item in numbered)
            return
        self._n_deaths.clear()
        has_finished_any = False
        while True:
            while self._idle and (entry := again.pop() if again else next(numbered, None)) is not None:
                self._start(*entry)
            if not self._running:
                return
            ended, _ = wait(self._running, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in ended:
                task = self._running.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool as error:
                    self._replace_dead(task)
                    if not has_finished_any and sum(self._n_deaths.values()) >= self._max_first_deaths:
                        reason = str(error).splitlines()[0]
                        raise UsageError(f"worker processes die at once: {reason}") from error
                    if self._n_deaths[task.index] < MAX_TRIES:
                        again.append((task.index, task.item))
                    else:
                        yield Done(task.item, task.index, None, self._n_deaths[task.index])
                    continue
                except BaseException:
                    self._idle.append(task.process)
                    raise
                has_finished_any = True
                self._idle.append(task.process)
                yield Done(task.item, task.index, result, self._n_deaths.get(task.index, 0))
            if not ended:
                self._tell_of_deaths()
                yield None

    def in_order(self, items: Iterable[Item], *, lost: str) -> Iterator[Result]:
        """The results in the order of the items, as far as they are there.

        Args:
            items: What the work is done with.
            lost: What an item is called in the error, with what a person can do.

        Raises:
            UsageError: An item killed its worker each time.
        """
        waiting: dict[int, Result] = {}
        n_yielded = 0
        for done in self.outcomes(items):
            if done is None:
                continue
            if done.is_lost:
                raise UsageError(f"a worker process died {done.n_deaths} times of {lost}")
            waiting[done.index] = done.result  # pyright: ignore[reportArgumentType], None only where it is lost
            while n_yielded in waiting:
                yield waiting.pop(n_yielded)
                n_yielded += 1

    def close(self) -> None:
        """Stop what still runs, and end the processes."""
        for process in [*self._idle, *(task.process for task in self._running.values())]:
            process.shutdown(wait=True, kill_workers=True)
        self._idle.clear()
        self._running.clear()
        self._work_file.unlink(missing_ok=True)

    def _new_process(self) -> ProcessPoolExecutor:
        start = (os.getpid(), self._work_file)
        return ProcessPoolExecutor(1, initializer=_begin, initargs=start, env=ENVIRONMENT)

    def _start(self, index: int, item: Item) -> None:
        """Hand an item to an idle worker; one that died while idle is replaced."""
        process = self._idle.pop()
        try:
            future = process.submit(_do, item)
        except BrokenProcessPool:
            process = self._new_process()
            future = process.submit(_do, item)
        self._running[future] = _Task(item, index, process)

    def _replace_dead(self, task: _Task[Item]) -> None:
        task.process.shutdown(wait=False, kill_workers=True)
        self._idle.append(self._new_process())
        self._n_deaths[task.index] = self._n_deaths.get(task.index, 0) + 1

    def _tell_of_deaths(self) -> None:
        """Break the wait of pools whose process died in the middle of handing its result over.

        Such a pool reads on for the rest of the result, for ever, since it holds the writing end itself. The members
        are loky's own; there is no public way.
        """
        for task in self._running.values():
            processes = list(task.process._processes.values())
            if processes and not any(process.is_alive() for process in processes):
                task.n_quiet_polls += 1
                results: Any = task.process._result_queue
                if task.n_quiet_polls == GRACE_POLLS and results is not None:
                    results._writer.close()


def _pickled(work: Callable[[Any], Any]) -> Path:
    """A file that holds the work for the workers to read.

    It does not go through the pipe by which a process is started: a process that is killed before it has read all of a
    large text leaves whoever started it waiting for room in the pipe.
    """
    with tempfile.NamedTemporaryFile(prefix="sounding-", suffix=".pickle", delete=False) as file:
        pickle.dump(work, file)
    return Path(file.name)


def _begin(parent: int, work_file: Path) -> None:
    """Take the work, leave Ctrl-C to the process that started this one, and end when that one is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A bar's own lock is a semaphore of the system, which a process that is killed leaves behind.
    tqdm.set_lock(threading.RLock())
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _kept["work"] = pickle.loads(work_file.read_bytes())


def _do(item: Any) -> Any:
    return _kept["work"](item)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(POLL_S)
    os._exit(1)
