"""The tables of a campaign, made from its journal: their rows have the order of the study, whatever ended first."""

from __future__ import annotations

import importlib
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mapping.storage import replacing
from sim.extras import EXTRAS
from sim.tables import columns_of, nan_for_none, write_csv

from .journal import Entry, Journal
from .lesions import LESION_TABLES, write_lesion_tables
from .study import LEADING, Study
from .trial_result import RECALL_LEVELS

TABLES = ("trials.csv", "trials.parquet", "timings.csv", "curves.npz", *LESION_TABLES)
CURVES = ("auprc", "sensed_fraction", "precision")
TARGET_CURVES = tuple(f"target_{name}" for name in CURVES)
"""The curves of a second class."""
CSV_BLOCK_BYTES = 1 << 26
"""How much of the CSV file is read at once to find the types of its columns."""


def write_tables(folder: Path, journal: Journal, study: Study) -> None:
    """Write trials.csv, timings.csv, the tables of lesions, curves.npz and, where pyarrow is installed, trials.parquet.

    Args:
        folder: The campaign's folder.
        journal: The trials that are done.
        study: Gives the order of the rows.
    """

    def entries() -> Iterator[Entry]:
        return journal.entries(trial.key for trial in study.trials())

    settings = columns_of(entry["settings"] for entry in entries())
    keys = [*LEADING, *(name for name in settings if name not in LEADING)]
    results = columns_of(entry["row"] for entry in entries())
    results = [name for name in results if name not in (*keys, "status", "error")]
    columns = [*keys, "status", *results, "error"]
    write_csv(folder / "trials.csv", (entry["row"] | entry["settings"] for entry in entries()), columns)
    timed = [*keys, *columns_of(entry["timings"] for entry in entries())]
    write_csv(folder / "timings.csv", (entry["settings"] | entry["timings"] for entry in entries()), timed)
    write_lesion_tables(folder, entries, keys)
    with replacing(folder / "curves.npz") as file:
        np.savez_compressed(file, **curve_arrays(entries()))  # type: ignore[arg-type]
    _write_parquet(folder)


def curve_arrays(entries: Iterator[Entry]) -> dict[str, np.ndarray]:
    """The curves of all rows, one after the other.

    Returns:
        `first` and `count`, shape (rows,): where each row's actions begin, and how many there are; `auprc` and
        `sensed_fraction` after each action, NaN where they are not defined; `precision`, shape (rows, 50), at `recall`,
        NaN in rows without a map. Where any row has a second class, `target_auprc`, `target_sensed_fraction` and
        `target_precision` are those of that class, NaN in rows without one.
    """
    counts, columns = array("q"), {name: array("f") for name in (*CURVES, *TARGET_CURVES)}
    has_target = False
    for entry in entries:
        curves = entry["curves"]
        n_actions = len(curves.get("sensed_fraction", []))
        counts.append(n_actions)
        has_target |= "target_sensed_fraction" in curves
        for name, column in columns.items():
            length = len(RECALL_LEVELS) if name.endswith("precision") else n_actions
            column.extend(nan_for_none(curves.get(name) or [None] * length))
    count = np.asarray(counts, dtype=np.int64)
    arrays = {"first": np.cumsum(count) - count, "count": count}
    for name in (*CURVES, *(TARGET_CURVES if has_target else ())):
        values = np.asarray(columns[name], dtype=np.float32)
        arrays[name] = values.reshape(-1, len(RECALL_LEVELS)) if name.endswith("precision") else values
    return arrays | {"recall": RECALL_LEVELS}


def _write_parquet(folder: Path) -> None:
    if not EXTRAS["parquet"].is_installed:
        return
    arrow_csv, parquet = (importlib.import_module(f"pyarrow.{name}") for name in ("csv", "parquet"))
    reading = arrow_csv.ReadOptions(block_size=CSV_BLOCK_BYTES)
    table = arrow_csv.read_csv(folder / "trials.csv", read_options=reading)
    with replacing(folder / "trials.parquet") as file:
        parquet.write_table(table, file)
