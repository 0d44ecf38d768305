"""Compiled loops: numba, which not everybody needs, and where its compiled code is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from sim.world.optional import optional_module

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compiled(loop: Loop) -> Loop:
    """A function of plain loops, compiled by numba on its first call and kept on the disk for the next process.

    Where neither the package's folder nor the user's can be written, it is compiled anew by each process.

    Raises:
        MissingPackageError: numba is not installed.
    """
    numba = optional_module("numba", "ultrasound", "ultrasound")
    try:
        return numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")(loop)
    except RuntimeError:
        # numba found no folder that it can write to.
        return numba.njit(fastmath=True, nogil=True, error_model="numpy")(loop)
