"""The pose pool: processes that share the poses of a study."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from planner import Workspace

from .world.ik_search import Answers, IkSearch

_work: dict[str, IkSearch | Workspace] = {}
"""What a worker process works on. It is inherited by forking, since a MuJoCo model is slow to send."""


@contextmanager
def chunk_answers(
    search: IkSearch, workspace: Workspace, chunks: Sequence[slice], *, n_jobs: int
) -> Iterator[Iterator[Answers]]:
    """An iterator over the answers to chunks of a workspace's poses, in order, as a context manager.

    Args:
        search: Solves for the arm.
        workspace: The poses.
        chunks: Which of them belong together.
        n_jobs: Processes; one, or a system that cannot fork, works in this process.
    """
    n_jobs = min(n_jobs, len(chunks))
    if n_jobs <= 1 or "fork" not in multiprocessing.get_all_start_methods():
        yield (search.search(workspace.positions_m[part], workspace.normals[part]) for part in chunks)
        return
    context = multiprocessing.get_context("fork")
    with context.Pool(n_jobs, initializer=_begin, initargs=(search, workspace)) as pool:
        yield pool.imap(_answer, chunks)


def _begin(search: IkSearch, workspace: Workspace) -> None:
    """Keep in a worker what all its chunks need."""
    _work["search"], _work["workspace"] = search, workspace


def _answer(chunk: slice) -> Answers:
    search, workspace = _work["search"], _work["workspace"]
    assert isinstance(search, IkSearch)
    assert isinstance(workspace, Workspace)
    return search.search(workspace.positions_m[chunk], workspace.normals[chunk])
