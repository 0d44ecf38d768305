"""The poses of a study, shared among worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from planner import Workspace
from sim.workers import Workers
from sim.world.ik.search import Answers, IkSearch

LOST = "the same poses, for example of too little memory. With fewer `jobs` each process has more of it."


@contextmanager
def shared_map(
    work: Callable[[Any], Any], *, n_jobs: int
) -> Iterator[Callable[[Sequence[Any]], Iterator[Any]]]:
    """A context with a `map` of one function over processes, whose results come in order.

    Args:
        work: What is done with each item. It is sent to each process once, items and results always.
        n_jobs: Processes; with one, this process does the work.

    Raises:
        UsageError: Two worker processes died of the same item.
    """
    if n_jobs <= 1:
        yield lambda items: map(work, items)
        return
    with Workers[Any, Any](work, n_jobs=n_jobs) as workers:
        yield lambda items: workers.in_order(items, lost=LOST)


@contextmanager
def chunk_answers(
    search: IkSearch, workspace: Workspace, chunks: Sequence[slice], *, n_jobs: int
) -> Iterator[Iterator[Answers]]:
    """A context with an iterator over the answers to chunks of a workspace's poses, in order.

    Args:
        search: Solves for the arm.
        workspace: The poses.
        chunks: Which of the poses are solved together.
        n_jobs: Processes that share the chunks.
    """
    with shared_map(_ChunkSearch(search, workspace), n_jobs=min(n_jobs, len(chunks))) as share:
        yield share(chunks)


@dataclass(frozen=True, eq=False)
class _ChunkSearch:
    """What a worker does with a chunk of poses."""

    search: IkSearch
    workspace: Workspace

    def __call__(self, chunk: slice) -> Answers:
        return self.search.search(self.workspace.positions_m[chunk], self.workspace.normals[chunk])
