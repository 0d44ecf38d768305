"""Folders for those who name none: a name that says what ran, with a number behind it where that is taken."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from .ownership import LOCK

DEFAULT_PARENT = Path("renders")
OF_THE_CALL = ("config", "out", "overwrite", "live", "jobs")
"""Options that say where a run goes to and how it is shared, and nothing about what it finds."""


def default_folder(name: str, options: Mapping[str, Any], *, overwrite: bool = False) -> Path:
    """The folder of a run for which none was named: `renders/<name>`, or the first of `-2`, `-3`, ... that is free.

    Args:
        name: What ran.
        options: What config.json will keep of the options.
        overwrite: Whether the folder that holds a run of just these options is taken, to be replaced.
    """
    wanted = _of_the_run(json.loads(json.dumps(options, default=str)))
    return first_path(
        name, lambda path: is_free(path) or (overwrite and _of_the_run(_options_in(path)) == wanted)
    )


def first_path(name: str, is_good: Callable[[Path], bool]) -> Path:
    """The first of `renders/<name>`, `renders/<name>-2`, ... that is good."""
    return next(path for path in _candidates(DEFAULT_PARENT / name) if is_good(path))


def is_free(path: Path) -> bool:
    """Whether nothing is there, or an empty folder."""
    if not path.exists() and not path.is_symlink():
        return True
    return path.is_dir() and all(entry.name == LOCK for entry in path.iterdir())


def file_part(text: str) -> str:
    """A planner, an arm or another thing as a part of a folder's name: files without folder and ending."""
    stem = Path(text.rpartition(":")[2]).name
    return stem.split(".")[0] or stem


def _candidates(path: Path) -> Iterator[Path]:
    """A path, and then with numbers before its ending."""
    yield path
    is_picture = path.suffix == ".png"
    for number in itertools.count(2):
        yield path.with_name(f"{path.stem}-{number}.png" if is_picture else f"{path.name}-{number}")


def _of_the_run(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name not in OF_THE_CALL}


def _options_in(path: Path) -> dict[str, Any]:
    """The options that the config.json of a folder keeps; a text that nothing equals where there is none."""
    try:
        content = json.loads((path / "config.json").read_text(encoding="utf-8"))
        options = content["options"]
    except (OSError, ValueError, KeyError, TypeError):
        return {"": "no run"}
    return options if isinstance(options, dict) else {"": "no run"}
