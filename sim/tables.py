"""Tables as text: CSV for programs, Markdown for people and terminals."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from mapping.storage import replacing


class CsvTable:
    """A CSV table on an open text stream, written row by row."""

    def __init__(self, stream: TextIO, columns: Sequence[str]) -> None:
        """Write the head, which holds the columns' names."""
        self._columns = tuple(columns)
        self._writer = csv.writer(stream, lineterminator="\n")
        self._writer.writerow(self._columns)

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row; columns that it lacks stay empty.

        Raises:
            ValueError: The row has a column that the table has not.
        """
        if unknown := row.keys() - set(self._columns):
            raise ValueError(f"columns {sorted(unknown)} are not in the table, which has {self._columns}")
        self._writer.writerow([table_cell(row.get(name)) for name in self._columns])


def write_csv(path: Path, rows: Iterable[Mapping[str, Any]], columns: Sequence[str] | None = None) -> None:
    """Write a CSV file at once: a reader sees the old file or the new one, never half of it.

    Args:
        path: The file.
        rows: Its rows.
        columns: Its columns; by default those of all rows, in the order in which rows first have them.
    """
    if columns is None:
        rows = list(rows)
        columns = columns_of(rows)
    with replacing(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        table = CsvTable(text, columns)
        for row in rows:
            table.append(row)
        text.flush()
        text.detach()


def columns_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """The names of all columns, in the order in which rows first have them."""
    return list(dict.fromkeys(name for row in rows for name in row))


def table_cell(value: Any) -> Any:
    """The content of a table's cell: floats with all their digits, None empty, booleans as 0 or 1, lists as JSON."""
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, float | np.floating):
        return repr(float(value))
    if isinstance(value, list | dict):
        return json.dumps(value)
    return "" if value is None else value


def nan_for_none(values: Iterable[float | None]) -> list[float]:
    """The values, with NaN in the place of None."""
    return [np.nan if value is None else value for value in values]


def read_rows(path: Path) -> list[dict[str, str]]:
    """The whole rows of a CSV file: none where it is missing, and no last row that was cut short by a kill."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8-sig") as file:
        return [row for row in csv.DictReader(file) if None not in row.values() and None not in row]


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table with aligned columns."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |"
        for line in lines
    )
