"""The folder of a session: an event is a file on the disk before what follows from it is told. A kill loses nothing."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping import Prediction
from sim.episode.planned.planned_organ import PlannedOrgan
from sim.errors import UsageError, other_input, other_values
from sim.record.locked_folder import LockedFolder
from sim.record.ownership import LOCK, MANIFEST
from sim.record.run_folder import describe_machine

from .event import Event

MARKER = "session.json"
"""What the session is of, by which its folder is known."""
EVENTS = "events"
ADDED = ("simulate", "inputs")
"""Parts of a session's identity that older versions did not write."""
MAP = "map.npz"
"""The present map on its lattice, NaN outside the organ, as a run's folder has it."""


class SessionFolder(LockedFolder):
    """A folder that one session owns while it is open."""

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        """Make the folder of a session, or take up the one that is there.

        Args:
            path: The folder.
            identity: Plain data that decides what the session proposes; a folder goes on only with the same. What its
                `inputs` hold, the contents of files by their names, is compared one by one.

        Raises:
            UsageError: The folder holds something else or a session of another identity, another process writes there,
                or it cannot be written.
        """
        super().__init__(path, what="session", overwrite=True, marker=MARKER)
        try:
            self._begin(json.loads(json.dumps(identity)))
        except BaseException:
            self.close()
            raise

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it; a session that failed before anything was kept leaves no folder of it."""
        with suppress(OSError):
            if self._is_new and isinstance(error, Exception):
                (self.path / EVENTS).rmdir()  # fails, and leaves all as it is, where there is an event
                for name in (MARKER, LOCK):
                    (self.path / name).unlink()
                self.path.rmdir()
        super().__exit__(kind, error, trace)

    def _begin(self, identity: Any) -> None:
        marker = self.path / MARKER
        self._is_new = not marker.is_file()
        if self._is_new:
            if (self.path / MANIFEST).exists():
                raise UsageError(f"{self.path}: holds a run and no session. Choose another `out`.")
            (self.path / EVENTS).mkdir(exist_ok=True)
            content = {"machine": describe_machine(), "identity": identity}
            _write(marker, (json.dumps(content, indent=2) + "\n").encode())
            return
        try:
            content = json.loads(marker.read_text(encoding="utf-8"))
            # Sessions of older versions do not say what came later.
            known = {name: identity[name] for name in ADDED if name in identity} | content["identity"]
            content["identity"] = dict(known)
            other = other_input(known.pop("inputs", {}), identity.pop("inputs", {}))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise UsageError(f"{marker}: cannot be read ({error}). Choose another `out`.") from error
        if other:
            raise UsageError(
                f"{self.path}: holds a session that began with another {other}, so that its poses would be others. "
                "Give it as it was to go on, or choose another `out`."
            )
        if changed := other_values(known, identity):
            raise UsageError(
                f"{self.path}: holds a session that began with other values of {changed}. Give the same "
                "options to go on with it, or choose another `out`."
            )
        _write(marker, (json.dumps(content, indent=2) + "\n").encode())

    @contextmanager
    def appending(self, event: Event) -> Iterator[None]:
        """A context during which an event is written; when it is left the event is on the disk.

        To wait for a disk takes some ten milliseconds, in which another core can learn from the event.

        Raises:
            OSError: It could not be written; what was done in the context was done.
        """
        with ThreadPoolExecutor(max_workers=1) as pool:
            written = pool.submit(self.append, event)
            yield
        written.result()

    def append(self, event: Event) -> None:
        """Write an event; when this returns it is on the disk."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **event.arrays())
        _write(self.path / EVENTS / f"{event.number:05d}.npz", buffer.getvalue())

    def events(self) -> Iterator[Event]:
        """The events that are kept, in order.

        Raises:
            UsageError: A file is broken or missing.
        """
        files = sorted((self.path / EVENTS).glob("*.npz"))
        for number, file in enumerate(files, start=1):
            try:
                with np.load(file, allow_pickle=False) as arrays:
                    event = Event.of_arrays({name: arrays[name] for name in arrays.files})
                if event.number != number:
                    raise ValueError(f"it is event {event.number}, where event {number} is due")
            except (OSError, EOFError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
                raise UsageError(
                    f"{file}: cannot be read ({error}). Remove it and all that come after it to go on from there."
                ) from error
            yield event

    def write_map(self, organ: PlannedOrgan, prediction: Prediction) -> None:
        """Replace the map."""
        x_m, y_m, z_m = organ.query.axes_m
        arrays: dict[str, NDArray[Any]] = {
            "x_m": x_m,
            "y_m": y_m,
            "z_m": z_m,
            "is_inside": organ.on_lattice(np.ones(len(organ.search_points_m), dtype=bool), outside=False),
        }
        for name in ("probability", "latent_mean", "latent_variance"):
            values = getattr(prediction, name).astype(np.float32)
            arrays[name] = organ.on_lattice(values, outside=np.nan)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        _write(self.path / MAP, buffer.getvalue(), is_synced=False)


def _write(path: Path, content: bytes, *, is_synced: bool = True) -> None:
    """Replace a file at once, and wait until it is on the disk."""
    partial = path.with_name(f".{path.name}.part")
    with partial.open("wb") as file:
        file.write(content)
        if is_synced:
            file.flush()
            os.fsync(file.fileno())
    partial.replace(path)
    if is_synced and os.name != "nt":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
