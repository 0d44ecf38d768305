"""Contenders side by side on one seed: what each made of the same tumours, in numbers and, where a run has a folder, as
the map that it left behind.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sim.bound.limit import Limit
from sim.campaign.journal import Entry
from sim.campaign.study import Trial
from sim.report.frames import picture_address
from sim.report.page import REPORT
from sim.running.fields import config_of

from .trial_groups import TrialGroup

MOST_SEEDS = 40
"""Seeds whose numbers are listed."""
MOST_PICTURED = 3
"""Seeds whose maps are shown: the page holds the pictures itself."""
PICTURE_PX = 560
"""Width of a picture of a map."""


def seed_rows(groups: Sequence[TrialGroup], limit: Limit | None = None) -> list[dict[str, Any]]:
    """The numbers of all contenders by seed, as text; empty where nothing stands side by side.

    Args:
        groups: The contenders of one case.
        limit: The limit of the case, whose hindsight optimum then stands beside one contender too.
    """
    n_least = 2 if limit is None else 1
    if len(groups) < n_least:
        return []
    entries = [{each["settings"]["seed"]: each for each in group.entries} for group in groups]
    seeds = sorted(set().union(*entries))
    shared = [seed for seed in seeds if sum(seed in each for each in entries) >= n_least]
    return [
        {"seed": seed, "fewest": _fewest(limit, seed), "cells": [_cells(each.get(seed)) for each in entries]}
        for seed in shared[:MOST_SEEDS]
    ]


def seed_pictures(
    groups: Sequence[TrialGroup], folder: Path, campaigns: Sequence[Path]
) -> list[dict[str, Any]]:
    """The last maps of the contenders that have folders, from above, for the first seeds that two of them share.

    Args:
        groups: The contenders of one case.
        folder: The folder of the page, from which links start.
        campaigns: Folders of the campaigns.
    """
    found: dict[int, list[dict[str, str]]] = {}
    for group in groups:
        for entry in group.entries:
            run = run_folder(entry, campaigns)
            if run is not None and (run / "map_top.png").is_file():
                found.setdefault(int(entry["settings"]["seed"]), []).append(
                    {"name": group.contender, "run": str(run), "says": _says(run)}
                )
    pictured = [seed for seed in sorted(found) if len(found[seed]) > 1][:MOST_PICTURED]
    for seed in pictured:
        for item in found[seed]:
            run = Path(item.pop("run"))
            item["picture"] = picture_address(run / "map_top.png", PICTURE_PX)
            item["report"] = link(run / REPORT, folder) if (run / REPORT).is_file() else ""
    return [{"seed": seed, "items": found[seed]} for seed in pictured]


def run_folder(entry: Entry, campaigns: Sequence[Path]) -> Path | None:
    """The folder of a trial's episode; None where it has none."""
    name = Trial(config_of(entry["settings"])).name
    return next((each / "trials" / name for each in campaigns if (each / "trials" / name).is_dir()), None)


def link(page: Path, folder: Path) -> str:
    """The path from a folder to a page, as a link has it."""
    return Path(os.path.relpath(page, folder)).as_posix()


def _cells(entry: Entry | None) -> tuple[str, str, str]:
    """Actions to 95 %, share sensed and AUPRC of a trial."""
    row = {} if entry is None else entry["row"]
    forms = (("sensings_to_95", "{:d}"), ("sensed_fraction", "{:.0%}"), ("auprc", "{:.3f}"))
    actions, sensed, auprc = ("–" if row.get(key) is None else form.format(row[key]) for key, form in forms)
    return actions, sensed, auprc


def _fewest(limit: Limit | None, seed: int) -> str:
    """The hindsight optimum of a seed, with a dash where it is not known."""
    if limit is None or seed not in limit.fewest:
        return "–"
    fewest = limit.fewest[seed]
    return "never" if fewest is None else str(fewest)


def _says(run: Path) -> str:
    """How many tumours a run found."""
    with suppress(OSError, ValueError, KeyError):
        findings = json.loads((run / "findings.json").read_text(encoding="utf-8"))
        n, false = findings["n_tumours"], findings["n_false_findings"]
        return f"{findings['n_tumours_found']} of {n} found, {false or 'none'} false"
    return ""
