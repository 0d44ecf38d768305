"""Engines made by name."""

from __future__ import annotations

from typing import Literal

from sim.errors import FieldError
from sim.extras import missing_text

from .engine import Engine

EngineName = Literal["local", "dask", "ray"]


def make_engine(name: EngineName, *, n_jobs: int, address: str | None = None) -> Engine:
    """The engine of that name.

    Args:
        name: `local` (processes of this machine), `dask` or `ray`.
        n_jobs: Number of processes, where the engine starts them itself.
        address: Address of the cluster's scheduler; None starts one on this machine.

    Raises:
        UsageError: The engine is not installed, or nothing answers at the address.
    """
    if name == "local":
        if address is not None:
            raise FieldError("address", address, "goes with the engines dask and ray.")
        from .local import LocalEngine

        return LocalEngine(n_jobs)
    try:
        if name == "dask":
            from .dask_engine import DaskEngine

            return DaskEngine(n_jobs, address)
        from .ray_engine import RayEngine

        return RayEngine(n_jobs, address)
    except ImportError as error:
        raise FieldError("engine", name, missing_text(name, "it")) from error
