"""Threads of the BLAS while a reading is taken in.

NumPy and SciPy bring a BLAS each, and each keeps a pool of threads of its own. The products of a reading are small
and alternate between them, which leaves one pool spinning while the other works: on two cores a reading then takes
more than twice as long as on one thread.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[object]:
    """Returns a context in which NumPy's and SciPy's BLAS use one thread."""
    return _controller().limit(limits=1, user_api="blas")


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # finding the libraries takes milliseconds, limiting them microseconds
