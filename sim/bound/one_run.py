"""A single run beside the limit: what a bound says of its seed, kept in its summary.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mapping.storage import replacing
from sim.campaign.study import SETUP_OPTIONS
from sim.errors import FieldError, UsageError
from sim.running.fields import default_of

from .folder import read_bound
from .limit import load_limit

SUMMARY, LIMIT = "summary.json", "limit"
"""The file that keeps the limit of a run, and its key there."""


def limit_of_run(bounds: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the first bound of a run's case says of the run; None where none is of its case.

    Args:
        bounds: Folders that `sounding bound` wrote.
        options: The run's options, as its config.json has them.

    Returns:
        `in_hindsight`, the fewest poses that are enough for the run's seed, None where it is not known or no poses are
        enough; `is_possible`, whether some poses are enough, None where that is not known; and `least_mean`, the least
        mean number of actions of any policy over all seeds, None where none is proven.

    Raises:
        UsageError: A folder holds no bound that is finished.
    """
    for folder in bounds:
        limit = load_limit(folder)
        if not _is_of_case(read_bound(folder), options):
            continue
        seed = int(options["seed"])
        return {
            "in_hindsight": limit.fewest.get(seed),
            "is_possible": limit.fewest[seed] is not None if seed in limit.fewest else None,
            "least_mean": limit.least_mean(math.inf),
        }
    return None


def keep_limit(folder: Path, bounds: Sequence[Path]) -> None:
    """Keep the limit of a run in its summary.json, which its report and account then tell of.

    Args:
        folder: The run's folder.
        bounds: Folders that `sounding bound` wrote.

    Raises:
        UsageError: The run has no summary yet, or no bound is of its case or none is finished.
    """
    try:
        options = json.loads((folder / "config.json").read_text(encoding="utf-8"))["options"]
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{folder}: holds no run of `sounding episode` that came to its end.") from error
    limit = limit_of_run(bounds, options)
    if limit is None:
        raise FieldError("bound", ", ".join(map(str, bounds)), other_case(folder, options))
    with replacing(folder / SUMMARY) as file:
        file.write((json.dumps({**summary, LIMIT: limit}, indent=2, allow_nan=False) + "\n").encode())


def other_case(folder: Path, options: Mapping[str, Any]) -> str:
    """Why bounds that are of another case than a run are refused, and what to do."""
    return (
        f"is not of the case of {folder} ({options['scenario']}, arm {options['arm']}). Run `sounding bound` with the "
        "scenario and the arm of the run."
    )


def _is_of_case(bound: Mapping[str, Any], options: Mapping[str, Any]) -> bool:
    """Whether a bound is of the organ, the tumours and the arm of a run, whose motion ends where it supposes."""
    asked = {**bound["case"], **bound["options"]}
    return options.get("motion", default_of("motion")) != "servo" and all(
        asked.get(name, default_of(name)) == options.get(name, default_of(name)) for name in SETUP_OPTIONS
    )
