"""The entrant: a planner's text, the map that it is made for, and the digest of its source."""

from __future__ import annotations

import hashlib
import inspect
from dataclasses import dataclass
from pathlib import Path

import planner as planners
from planner import Planner, planner_names
from sim.running.fields import config_of
from sim.running.parts import planner_of


@dataclass(frozen=True, kw_only=True)
class Entrant:
    """A planner as a submission names it."""

    text: str
    """A built-in planner's name, or `module:Class`."""
    map_settings: str
    """The map that it is shown and scored by: paper or calibrated."""
    source_sha256: str
    """Digest of its source: the file of its class, or for a built-in one all files of the planners with numbers."""
    source: Path | None
    """The file of its class where that is a module of one file, which the submission then holds a copy of."""


def load_entrant(text: str) -> Entrant:
    """The planner that a text names.

    Raises:
        UsageError, PlugError: There is no such planner, or it cannot be made.
    """
    made = planner_of(config_of(planner=text))
    if text in planner_names():
        folder = Path(planners.__file__).parent
        files = sorted([*folder.rglob("*.py"), *folder.rglob("*.json")])
    else:
        files = [Path(inspect.getsourcefile(type(made)) or inspect.getfile(type(made)))]
    is_one_file = text not in planner_names() and "." not in type(made).__module__
    return Entrant(
        text=text,
        map_settings=_map_of(made),
        source_sha256=_digest(files),
        source=files[0] if is_one_file else None,
    )


def _map_of(made: Planner) -> str:
    return str(made.preferred_map)


def _digest(files: list[Path]) -> str:
    told = hashlib.sha256()
    for file in files:
        told.update(file.read_bytes())
    return told.hexdigest()
