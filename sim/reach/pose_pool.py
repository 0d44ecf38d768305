"""The processes that share the work of a study."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from planner import Workspace
from sim.world.ik.search import Answers, IkSearch

_work: dict[str, Callable[[Any], Any]] = {}
"""What a worker process does. It is inherited by forking, since a MuJoCo model is slow to send."""


@contextmanager
def forked_map(
    work: Callable[[Any], Any], *, n_jobs: int
) -> Iterator[Callable[[Sequence[Any]], Iterator[Any]]]:
    """A context with a `map` of one function over processes, whose results come in order.

    Args:
        work: What is done with each item. Items and results are sent; what the function closes over is inherited.
        n_jobs: Processes; with one, or on a system that cannot fork, this process does the work.
    """
    if n_jobs <= 1 or "fork" not in multiprocessing.get_all_start_methods():
        yield lambda items: map(work, items)
        return
    context = multiprocessing.get_context("fork")
    with context.Pool(n_jobs, initializer=_begin, initargs=(work,)) as pool:
        yield lambda items: pool.imap(_do, items)


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

    def answers(chunk: slice) -> Answers:
        return search.search(workspace.positions_m[chunk], workspace.normals[chunk])

    with forked_map(answers, n_jobs=min(n_jobs, len(chunks))) as share:
        yield share(chunks)


def _begin(work: Callable[[Any], Any]) -> None:
    """Keep what a worker process does with its items."""
    _work["do"] = work


def _do(item: Any) -> Any:
    return _work["do"](item)
