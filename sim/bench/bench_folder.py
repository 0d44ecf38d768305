"""The folder of a run of the benchmark: what was asked, a campaign for each task, and the submission."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mapping.storage import replacing
from sim.errors import UsageError
from sim.record.locked_folder import LockedFolder
from sim.record.run_folder import describe_machine

from .entrant import Entrant

FORMAT = 1
BENCH = "bench.json"


class BenchFolder(LockedFolder):
    """A folder that one call owns while it is open. What it holds of the same planner and key is kept."""

    def __init__(self, path: Path) -> None:
        """Claim a folder.

        Raises:
            UsageError: The folder holds something else, belongs to a running call, or cannot be written.
        """
        super().__init__(path, what="benchmark", overwrite=False, marker=BENCH)

    def begin(self, entrant: Entrant, committed: str | None) -> None:
        """Write who enters, and with which seeds.

        Args:
            entrant: The planner.
            committed: The commitment to the key of hidden seeds; None for public ones.

        Raises:
            UsageError: The folder holds the run of another planner, of another source of it, or with another key.
        """
        question = {
            "planner": entrant.text,
            "source of the planner": entrant.source_sha256,
            "map": entrant.map_settings,
            "key": committed,
        }
        before = _read(self.path / BENCH)
        for name, value in question.items() if before is not None else ():
            if before is not None and before.get("question", {}).get(name) != value:
                raise UsageError(
                    f"{self.path}: was begun with another {name}. Choose another `out`; what is there stays."
                )
        content = {"format": FORMAT, "sounding": describe_machine()["sounding"], "question": question}
        with replacing(self.path / BENCH) as file:
            file.write((json.dumps(content, indent=2) + "\n").encode())

    def campaign(self, task: str) -> Path:
        """The folder of a task's campaign."""
        return self.path / "campaigns" / task

    @contextmanager
    def set_aside_on_error(self, task: str) -> Iterator[None]:
        """A context whose error has a task's campaign kept under another name, so that the task is run anew."""
        try:
            yield
        except UsageError:
            self._set_aside(task)
            raise

    def _set_aside(self, task: str) -> None:
        folder, n = self.campaign(task), 1
        while (aside := folder.with_name(f"{task}-set-aside-{n}")).exists():
            n += 1
        folder.rename(aside)

    @property
    def submission(self) -> Path:
        """The folder to hand in."""
        return self.path / "submission"


def _read(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({error}).") from error
    return content if isinstance(content, dict) else {}
