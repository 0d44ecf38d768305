"""What became of each lesion in a trial, as the journal keeps it, and the tables of all trials' lesions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.findings.tables import FALSE_FINDINGS, FALSE_TARGETS, TABLE_COLUMNS, TARGETS, TUMOURS, finding_rows
from sim.tables import write_csv

from .journal import Entry

if TYPE_CHECKING:
    # The campaign's own process needs no simulator.
    from sim.findings.findings import Findings
    from sim.findings.free_response import FreeResponse

Row = dict[str, Any]
LESIONS = "lesions.csv"
LESION_TABLES = (LESIONS, FALSE_FINDINGS, TARGETS, FALSE_TARGETS)
"""The tables of a campaign's lesions; the last two only where a second class is mapped."""
FILES: dict[str, str] = dict(
    zip((TUMOURS, FALSE_FINDINGS, TARGETS, FALSE_TARGETS), LESION_TABLES, strict=True)
)
"""The table of a campaign that holds the rows of each table of a run."""
NUMBERS: dict[str, str] = {"tumour": "lesion", "target": "body"}
"""Columns of a run's tables that have another name in a campaign's, whose settings may name a file `tumour`."""
FREE_RESPONSE_DIGITS = 6
"""Decimals of the thresholds that are kept."""


def trial_findings(findings: Findings, response: FreeResponse | None) -> dict[str, Any]:
    """The findings of a trial as plain data: the columns of each table, and the counts at each threshold.

    Args:
        findings: The findings at the trial's end.
        response: The free response of its last map; None without a map.
    """
    kept: dict[str, Any] = {
        FILES[name]: {
            NUMBERS.get(column, column): [row[column] for row in rows] for column in TABLE_COLUMNS[name]
        }
        for name, rows in finding_rows(findings).items()
    }
    if response is not None:
        kept["free_response"] = {
            "probability": [round(float(p), FREE_RESPONSE_DIGITS) for p in response.probability],
            "n_found": response.n_found.tolist(),
            "n_false": response.n_false.tolist(),
            "own": response.own,
        }
    return kept


def rows_of(entry: Entry, table: str) -> list[Row] | None:
    """The rows of a table that a trial has; None where its journal is older than the findings, or it failed.

    Args:
        entry: The journal's entry of the trial.
        table: One of `LESION_TABLES`.
    """
    columns = entry.get("findings", {}).get(table)
    if columns is None:
        return None
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def write_lesion_tables(
    folder: Path, entries: Callable[[], Iterator[Entry]], settings: Sequence[str]
) -> None:
    """Write lesions.csv and false_findings.csv, and the same of a second class where any trial has one.

    Args:
        folder: The campaign's folder.
        entries: The trials' entries, in the order of the study, as often as they are asked for.
        settings: The columns of the settings, which stand first.
    """
    for name, table in FILES.items():
        if name in (TARGETS, FALSE_TARGETS) and not any(
            table in entry.get("findings", {}) for entry in entries()
        ):
            (folder / table).unlink(missing_ok=True)
            continue
        columns = [NUMBERS.get(column, column) for column in TABLE_COLUMNS[name]]
        write_csv(folder / table, _rows(entries(), table), [*settings, *columns])


def _rows(entries: Iterator[Entry], table: str) -> Iterator[Mapping[str, Any]]:
    for entry in entries:
        for row in rows_of(entry, table) or ():
            yield entry["settings"] | row
