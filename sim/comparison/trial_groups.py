"""Trial groups: the trials of one or more campaigns by case (what is to be found) and contender (what looks for it)."""

from __future__ import annotations

import json
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.campaign.campaign_folder import JOURNAL, read_study
from sim.campaign.journal import Entry, read_entries
from sim.campaign.study import SETUP_OPTIONS
from sim.errors import UsageError
from sim.running.fields import default_of
from sim.tables import nan_for_none


@dataclass(frozen=True, eq=False)
class TrialGroup:
    """The trials of one contender in one case, by rising seed."""

    case: str
    contender: str
    entries: tuple[Entry, ...]
    """Entries of the finished trials."""
    failed: tuple[Entry, ...]
    """Entries of all others, which failed or whose worker died."""

    @property
    def seeds(self) -> NDArray[np.int64]:
        """The seeds of `entries`, shape (n,)."""
        return np.array([entry["settings"]["seed"] for entry in self.entries], dtype=np.int64)

    @property
    def n_steps(self) -> int:
        """The largest number of sensing actions."""
        return int(self.setting("steps"))

    def setting(self, name: str) -> Any:
        """The value of an option, which is the same for the whole group."""
        return (self.entries or self.failed)[0]["settings"].get(name, default_of(name))

    def values(self, key: str) -> NDArray[np.float64]:
        """A column of the rows, shape (n,); NaN where it is empty or missing."""
        return np.array(nan_for_none(entry["row"].get(key) for entry in self.entries), dtype=np.float64)

    def sensings_to_95(self) -> NDArray[np.float64]:
        """The actions until 95 % of the tumours was sensed, shape (n,); infinite where that never came."""
        values = self.values("sensings_to_95")
        return np.where(np.isnan(values), np.inf, values)

    def curve(self, name: str) -> NDArray[np.float64]:
        """The values after each action, shape (n, longest); an episode that ended before keeps its last value."""
        curves = [entry["curves"].get(name) or [None] for entry in self.entries]
        longest = max((len(curve) for curve in curves), default=0)
        held = [[*curve, *[curve[-1]] * (longest - len(curve))] for curve in curves]
        return np.array([nan_for_none(row) for row in held], dtype=np.float64)


def load_groups(folders: Sequence[Path], *, seeds: Container[int] | None = None) -> list[TrialGroup]:
    """The groups of campaigns, in the order in which they were run.

    A case is all that decides about the truth: scenario, arm and probe. A contender is a planner with the settings
    that differ among the trials at hand, and the folder where several folders hold the same.

    Args:
        folders: Folders of campaigns; one that still runs may be among them.
        seeds: Seeds to look at; None for all.

    Raises:
        UsageError: A folder holds no campaign, or no trial is done yet.
    """
    names = shortest_names(folders)
    held = [(name, _entries(folder)) for folder, name in names.items()]
    entries = [(name, e) for name, es in held for e in es if seeds is None or e["settings"]["seed"] in seeds]
    if not entries:
        raise UsageError(f"{', '.join(map(str, folders))}: no trial is done there yet.")
    is_ambiguous = _is_ambiguous([e for _, e in entries], len(names))
    varying = _varying([entry["settings"] for _, entry in entries])
    groups: dict[tuple[str, str], list[Entry]] = {}
    for name, entry in entries:
        contender = _contender(entry["settings"], varying)
        if is_ambiguous:
            contender += f" ({name})"
        groups.setdefault((case_of(entry["settings"]), contender), []).append(entry)
    return [_group(case, contender, found) for (case, contender), found in groups.items()]


def notes_on(folders: Sequence[Path]) -> list[str]:
    """What a reader of a comparison should know about its campaigns: that versions differ, for example."""
    studies = [read_study(folder) or {} for folder in folders]
    machines = [study["machine"] for study in studies]
    notes = list(dict.fromkeys(text for study in studies for text in study.get("notices", ())))
    for name in ("sounding", "commit", "packages", "platform"):
        if len({json.dumps(machine.get(name), sort_keys=True) for machine in machines}) > 1:
            notes.append(f"The campaigns were run with different versions: {name} differs.")
    return notes


def shortest_names(folders: Sequence[Path]) -> dict[Path, str]:
    """The folders, each once, with the shortest ends of their paths that tell them all apart."""
    places = {folder.resolve(): folder for folder in dict.fromkeys(folders)}
    n_parts = 1
    while len({place.parts[-n_parts:] for place in places}) < len(places):
        n_parts += 1
    return {folder: "/".join(place.parts[-n_parts:]) for place, folder in places.items()}


def _entries(folder: Path) -> list[Entry]:
    if read_study(folder) is None or not (folder / JOURNAL).exists():
        raise UsageError(
            f"{folder}: holds no campaign and no run. Name folders that `sounding trials` or `sounding episode` wrote."
        )
    return list(read_entries(folder / JOURNAL))


def _group(case: str, contender: str, entries: list[Entry]) -> TrialGroup:
    entries = sorted(entries, key=lambda entry: entry["settings"]["seed"])
    is_finished = [entry["row"]["status"] == "finished" for entry in entries]
    return TrialGroup(
        case,
        contender,
        tuple(entry for entry, finished in zip(entries, is_finished, strict=True) if finished),
        tuple(entry for entry, finished in zip(entries, is_finished, strict=True) if not finished),
    )


def case_of(settings: Mapping[str, Any]) -> str:
    """The case that a trial's settings make."""
    more = [f"{n} {settings[n]}" for n in SETUP_OPTIONS if n in settings and n not in ("scenario", "arm")]
    return ", ".join([settings["scenario"], f"arm {settings['arm']}", *more])


def _contender(settings: dict[str, Any], varying: Sequence[str]) -> str:
    values = [(name, settings.get(name, default_of(name))) for name in varying]
    return ", ".join([settings["planner"], *(f"{name} {value}" for name, value in values)])


def _varying(settings: list[dict[str, Any]]) -> list[str]:
    """The options that tell contenders of one case apart."""
    apart: dict[str, None] = {}
    first: dict[tuple[str, str], dict[str, Any]] = {}
    hidden = (*SETUP_OPTIONS, "planner", "seed", "map")
    for each in settings:
        other = first.setdefault((case_of(each), each["planner"]), each)
        for name in (*each, *other):
            if name not in hidden and each.get(name, default_of(name)) != other.get(name, default_of(name)):
                apart[name] = None
    return list(apart)


def _is_ambiguous(entries: list[Entry], n_folders: int) -> bool:
    """Whether several folders hold trials of the same settings."""
    keys = [json.dumps(entry["settings"], sort_keys=True) for entry in entries]
    return n_folders > 1 and len(set(keys)) < len(keys)
