"""The entrant: a planner's text, the map that it is made for, and the digest of its source."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import planner as planners
from planner import Planner, planner_names
from sim.errors import UsageError
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
    files: tuple[Path, ...]
    """The files that the digest is of."""

    def source_bytes(self) -> bytes | None:
        """What the file of its class holds, for the submission; None where that holds no copy.

        Raises:
            UsageError: A file is no longer as it was when the digest was made.
        """
        contents = [file.read_bytes() if file.is_file() else b"" for file in self.files]
        if _digest(contents) != self.source_sha256:
            raise UsageError(
                f"{self.files[0] if len(self.files) == 1 else self.files[0].parent}: was changed while the benchmark "
                "ran. The trials of the task that ran then may be of another planner, and were set aside. Put back "
                "what it was and call again, which runs that task anew, or choose another `out`."
            )
        return None if self.source is None else contents[0]


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
        source_sha256=_digest(file.read_bytes() for file in files),
        source=files[0] if is_one_file else None,
        files=tuple(files),
    )


def _map_of(made: Planner) -> str:
    return str(made.preferred_map)


def _digest(contents: Iterable[bytes]) -> str:
    told = hashlib.sha256()
    for content in contents:
        told.update(content)
    return told.hexdigest()
