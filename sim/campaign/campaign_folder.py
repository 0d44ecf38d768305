"""The folder of a campaign: its study, its journal, and the tables that are made from the journal."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapping.storage import replacing
from sim.errors import UsageError, other_input
from sim.record.default_folders import is_free
from sim.record.locked_folder import LockedFolder
from sim.record.run_folder import describe_machine, now
from sim.running.config_file import inputs_of

from .journal import Journal
from .study import Study
from .tables import TABLES, write_tables

FORMAT = 1
STUDY, JOURNAL = "study.json", "journal.jsonl"
CODE = ("sounding", "commit", "packages")
"""The parts of a machine's description on which the rows depend."""


class CampaignFolder(LockedFolder):
    """A folder that one call owns while it is open, as a context manager."""

    journal: Journal
    """The trials that are done; it is open from `begin` on."""

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        """Claim a folder; an earlier campaign in it is removed when `overwrite` is set.

        Raises:
            UsageError: The folder holds something else, belongs to a running call, or cannot be written.
        """
        super().__init__(path, what="campaign", overwrite=False, marker=STUDY)
        if overwrite:
            for name in (STUDY, JOURNAL, *TABLES):
                (path / name).unlink(missing_ok=True)

    def begin(self, study: Study, *, any_version: bool = False) -> None:
        """Open the journal for a study.

        Raises:
            UsageError: The folder holds trials of another study, of other input files, or of another version.
        """
        present = {
            "format": FORMAT,
            "study": study.describe(),
            "inputs": _inputs(study),
            "machine": describe_machine(),
        }
        # The threads of this process say nothing: that of a trial always has one.
        present["machine"].pop("blas_threads")
        present["blas_threads_per_trial"] = 1
        before = read_study(self.path)
        present["started"] = now() if before is None else before.get("started", now())
        if before is not None:
            self._check_same(before, present, any_version=any_version)
        else:
            self._write_study(present)  # first: by it the folder is known for a campaign's
        self.journal = Journal(self.path / JOURNAL)
        strangers = self.journal.keys() - {trial.key for trial in study.trials()} if len(self.journal) else ()
        if strangers:
            self.journal.close()
            raise UsageError(
                f"{self.path}: holds another study; this one has no trial {min(strangers)}. "
                "Choose another `out`, or add `overwrite` to replace it."
            )
        self._write_study(present)

    def _write_study(self, content: Mapping[str, Any]) -> None:
        with replacing(self.path / STUDY) as file:
            file.write((json.dumps(content, indent=2) + "\n").encode())

    def _check_same(
        self, before: Mapping[str, Any], present: Mapping[str, Any], *, any_version: bool
    ) -> None:
        if name := other_input(before["inputs"], present["inputs"]):
            raise UsageError(
                f"{self.path}: was begun with another {name}. Choose another `out`, or add `overwrite`."
            )
        for name in () if any_version else CODE:
            old, new = before["machine"][name], present["machine"][name]
            if old != new:
                raise UsageError(
                    f"{self.path}: was begun with another version ({name} {old}, now {new}). Choose another "
                    "`out`, add `overwrite` to begin anew, or `any_version` to go on nevertheless."
                )

    def write_tables(self, study: Study) -> None:
        """Write trials.csv, timings.csv, the tables of lesions, curves.npz and, with pyarrow, trials.parquet.

        What is to be known about the trials' files goes to study.json.
        """
        write_tables(self.path, self.journal, study)
        entries = self.journal.entries(trial.key for trial in study.trials())
        notices = list(dict.fromkeys(text for entry in entries for text in entry.get("notices", ())))
        content = read_study(self.path)
        if notices and content is not None:
            self._write_study(content | {"notices": notices})

    def close(self) -> None:
        """Close the journal and unlock the folder."""
        if hasattr(self, "journal"):
            self.journal.close()
        super().close()


def read_study(path: Path) -> dict[str, Any] | None:
    """What the study.json of a folder says; None where there is no such file.

    Raises:
        UsageError: The file is broken, or has a format that this version does not read.
    """
    try:
        content = json.loads((path / STUDY).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise UsageError(f"{path / STUDY}: cannot be read ({error}).") from error
    if content.get("format") != FORMAT:
        raise UsageError(f"{path / STUDY}: format {content.get('format')}, but this version reads {FORMAT}.")
    return content


def can_hold(path: Path, study: Study) -> bool:
    """Whether a folder is free, or holds a campaign that a study can go on with."""
    if is_free(path):
        return True
    try:
        before = read_study(path)
    except UsageError:
        return False
    if before is None or not (path / JOURNAL).is_file():
        return False
    if other_input(before["inputs"], _inputs(study)):
        return False
    with Journal(path / JOURNAL) as journal:
        return journal.keys() <= {trial.key for trial in study.trials()}


def _inputs(study: Study) -> dict[str, Any]:
    """What the scenarios and files of a study hold, on which the rows depend as much as on the options."""
    inputs: dict[str, Any] = {}
    for trial, _ in study.first_trials():
        inputs |= inputs_of(trial.config)
    return inputs
