"""Threads of the BLAS while a reading is taken in.

NumPy and SciPy bring a BLAS each, and each keeps a pool of threads of its own. The products of a reading are small
and alternate between them, which leaves one pool spinning while the other works: on two cores a reading then takes
more than twice as long as on one thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Holds NumPy's and SciPy's BLAS at one thread, as a context or a decorator."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # finding the libraries takes milliseconds, limiting them microseconds
