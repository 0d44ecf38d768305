"""Files that are written whole or not at all, and the map's: an npz with a format name and a version, read
without pickle.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

FORMAT = "sounding hilbert map"
VERSION = 3


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A file that takes the place of another once it is written whole, as a context manager."""
    partial = path.with_name(f".{path.name}.part")
    with partial.open("wb") as file:
        yield file
    partial.replace(path)


def write_arrays(path: Path, arrays: Mapping[str, NDArray]) -> None:
    """Writes arrays under their names, beside the format and its version."""
    with replacing(path) as file:
        np.savez(file, allow_pickle=False, format=np.array(FORMAT), version=np.array(VERSION), **arrays)


def read_arrays(path: Path) -> dict[str, NDArray]:
    """Returns the arrays of a file of this format and version.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file is damaged, of another kind, or of another version; the text says which.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise
    except (OSError, EOFError, ValueError, TypeError, AttributeError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no saved map: it is damaged or of another kind ({error})") from error
    if str(arrays.get("format")) != FORMAT:
        raise ValueError(f"{path} is no saved map: it holds {sorted(arrays)} and not the format '{FORMAT}'")
    if int(arrays["version"]) != VERSION:
        raise ValueError(f"{path} is of version {arrays['version']}; this release reads version {VERSION}")
    return arrays


def checked_array(arrays: Mapping[str, NDArray], name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Returns a copy of a float array of a shape, all finite.

    Raises:
        ValueError: If it is missing, of another shape, or not finite.
    """
    if name not in arrays:
        raise ValueError(f"its array '{name}' is missing")
    values = np.array(arrays[name], dtype=np.float64)
    if values.shape != shape:
        raise ValueError(f"its array '{name}' has shape {values.shape} in place of {shape}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"its array '{name}' is not finite")
    return values
