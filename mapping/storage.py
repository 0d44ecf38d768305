"""Files that are written whole or not at all, and those of maps: npz with a format and a version, without pickle."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

HILBERT_MAP = "sounding hilbert map"
DETAILED_MAP = "sounding detailed map"
VERSIONS = {HILBERT_MAP: 4, DETAILED_MAP: 2}
"""The formats of saved maps, and the version of each that this release writes and reads."""


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A context with a file to write to, which takes the place of `path` once it is written whole."""
    partial = path.with_name(f".{path.name}.part")
    with partial.open("wb") as file:
        yield file
    partial.replace(path)


def write_arrays(path: Path, map_format: str, arrays: Mapping[str, NDArray]) -> None:
    """Writes arrays under their names, beside the format and its version.

    Args:
        path: The file; one that is there is replaced.
        map_format: One of `VERSIONS`.
        arrays: The arrays; none of objects.
    """
    stamp = {"format": np.array(map_format), "version": np.array(VERSIONS[map_format])}
    with replacing(path) as file:
        np.savez(file, allow_pickle=False, **stamp, **arrays)


def read_arrays(path: Path, *map_formats: str) -> tuple[str, dict[str, NDArray]]:
    """The format of a file and its arrays.

    Args:
        path: The file.
        map_formats: Formats that the caller can use.

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
    found, version = str(arrays.get("format")), arrays.get("version")
    if found not in VERSIONS:
        raise ValueError(
            f"{path} is no saved map: it holds {sorted(arrays)} and not the format '{HILBERT_MAP}'"
        )
    if found not in map_formats:
        raise ValueError(f"{path} holds a '{found}' in place of a '{map_formats[0]}'; load_map reads either")
    if version is None or not np.array_equal(version, VERSIONS[found]):
        raise ValueError(f"{path} is of version {version}; this release reads version {VERSIONS[found]}")
    return found, arrays


@contextmanager
def naming_the_file(path: Path) -> Iterator[None]:
    """A context in which whatever is wrong with a file's arrays becomes an error that names the file.

    Raises:
        ValueError: If an array is missing or holds what it should not.
    """
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{path} is no whole map: its array {error} is missing") from error
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is no whole map: {error}") from error


def put_under(prefix: str, arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Arrays under names that begin with a prefix, so that one file can hold several maps."""
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def taken_from(prefix: str, arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The arrays that `put_under` put under a prefix, by their own names."""
    start = f"{prefix}/"
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def checked_array(
    arrays: Mapping[str, NDArray], name: str, shape: tuple[int, ...], *, is_finite: bool = True
) -> NDArray[np.float64]:
    """A copy of a float array of a shape.

    Args:
        arrays: Arrays by name.
        name: Which one.
        shape: The shape that it has to have.
        is_finite: Whether all of it has to be finite; infinities may stand in it otherwise, but no NaN.

    Raises:
        ValueError: If it is missing, of another shape, or not finite.
    """
    if name not in arrays:
        raise ValueError(f"its array '{name}' is missing")
    values = np.array(arrays[name], dtype=np.float64)
    if values.shape != shape:
        raise ValueError(f"its array '{name}' has shape {values.shape} in place of {shape}")
    if np.isnan(values).any() or (is_finite and not np.isfinite(values).all()):
        raise ValueError(f"its array '{name}' is not finite")
    return values


def split_by_counts(arrays: Mapping[str, NDArray], name: str, n_rows: int, *, least: int = 0) -> list[slice]:
    """The rows of each reading, where those of all readings stand below one another.

    Args:
        arrays: Arrays by name.
        name: Which of them holds the number of rows of each reading, shape (R,).
        n_rows: Number of all rows.
        least: Least number of rows of a reading.

    Raises:
        KeyError: If the array is missing.
        ValueError: If it does not hold whole numbers that add up.
    """
    counts = np.asarray(arrays[name])
    if counts.ndim != 1 or counts.dtype.kind != "i" or np.any(counts < least) or counts.sum() != n_rows:
        raise ValueError(f"its array '{name}' does not hold the numbers of points of its readings")
    ends = np.cumsum(counts)
    return [slice(int(end - count), int(end)) for count, end in zip(counts, ends, strict=True)]
