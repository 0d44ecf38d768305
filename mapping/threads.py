"""The number of BLAS threads while a reading is taken in.

NumPy and SciPy bring a BLAS each, and each keeps a pool of threads of its own. The products of a reading are small
and alternate between the two, so that one pool spins while the other works: on two cores a reading then takes more than
twice as long as on one thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context, or a decorator, that holds NumPy's and SciPy's BLAS at one thread."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    # Kept, since finding the libraries takes milliseconds and limiting them microseconds.
    return ThreadpoolController()
