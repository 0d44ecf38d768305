"""The files of findings, in SI units and the world frame: tumours.csv, false_findings.csv, and both in findings.json.

A second class has targets.csv and target_false_findings.csv, with the same columns.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mapping.storage import replacing
from sim.tables import write_csv

if TYPE_CHECKING:
    # Whoever only writes tables, as the process of a campaign does, needs no simulator.
    from .findings import FalseFinding, Findings, TumourFinding

TUMOURS, FALSE_FINDINGS, FINDINGS = "tumours.csv", "false_findings.csv", "findings.json"
TARGETS, FALSE_TARGETS = "targets.csv", "target_false_findings.csv"


def write_finding_tables(folder: Path, findings: Findings) -> None:
    """Write the two tables of each class to a run's folder, and findings.json."""
    for name, rows in finding_rows(findings).items():
        write_csv(folder / name, rows, TABLE_COLUMNS[name])
    with replacing(folder / FINDINGS) as file:
        file.write((json.dumps(finding_summary(findings), indent=2, allow_nan=False) + "\n").encode())


def finding_rows(findings: Findings) -> dict[str, list[dict[str, Any]]]:
    """The rows of each table, by the table's name; the tables of a second class only where one is mapped."""
    rows = {
        TUMOURS: [tumour_row(each) for each in findings.tumours],
        FALSE_FINDINGS: [false_row(each) for each in findings.false],
    }
    if findings.target is None:
        return rows
    return rows | {
        TARGETS: [_of_target(tumour_row(each)) for each in findings.target.tumours],
        FALSE_TARGETS: [_of_target(false_row(each)) for each in findings.target.false],
    }


def tumour_row(finding: TumourFinding | None) -> dict[str, Any]:
    """A row of tumours.csv; for None a row of empty cells, which tells the columns."""
    overlap = finding.overlap if finding else None
    steps = ("first_seen_step", "sensed_step", "first_mapped_step")
    names = ("tumour", "is_found", *steps, "sensed_fraction", "true_volume_m3", "mapped_volume_m3")
    row: dict[str, Any] = {name: getattr(finding, name, None) for name in names}
    row["centroid_error_m"] = getattr(overlap, "centroid_error_m", None)
    names = ("dice", "surface_mean_m", "surface_hausdorff95_m")
    row |= {name: getattr(finding, name, None) for name in names}
    row |= _place("true_centroid", finding.true_centroid_m if finding else None)
    row |= _place("mapped_centroid", overlap.mapped_centroid_m if overlap else None)
    row |= {f"true_{name}": getattr(finding, name, None) for name in ("diameter_m", "depth_m")}
    names = ("attainable_fraction", "highest_probability")
    return row | {name: getattr(finding, name, None) for name in names}


def false_row(finding: FalseFinding | None) -> dict[str, Any]:
    """A row of false_findings.csv; for None a row of empty cells, which tells the columns."""
    names = ("finding", "volume_m3", "highest_probability", "tumour_distance_m", "first_mapped_step")
    row = {name: getattr(finding, name, None) for name in names}
    return row | _place("centroid", finding.centroid_m if finding else None)


def finding_summary(findings: Findings) -> dict[str, Any]:
    """All findings and their numbers, as findings.json holds them."""
    target = {} if findings.target is None else {"target": _of_target(_class_summary(findings.target))}
    return {"visible_fraction": findings.visible_fraction, **_class_summary(findings), **target}


def _class_summary(findings: Findings) -> dict[str, Any]:
    """The findings of one class and their numbers."""
    return {
        "called_from_probability": findings.probability,
        "n_tumours": len(findings.tumours),
        "n_tumours_found": findings.n_found,
        "n_false_findings": len(findings.false),
        "tumours": [tumour_row(finding) for finding in findings.tumours],
        "false_findings": [false_row(finding) for finding in findings.false],
    }


def _of_target(value: Any) -> Any:
    """A value of the second class: the keys say target in place of tumour."""
    if isinstance(value, dict):
        return {key.replace("tumour", "target"): _of_target(each) for key, each in value.items()}
    return [_of_target(each) for each in value] if isinstance(value, list) else value


def _place(name: str, point_m: Sequence[float] | Any) -> dict[str, Any]:
    return {
        f"{name}_{axis}_m": None if point_m is None else float(point_m[i]) for i, axis in enumerate("xyz")
    }


TABLE_COLUMNS: dict[str, tuple[str, ...]] = {
    TUMOURS: tuple(tumour_row(None)),
    FALSE_FINDINGS: tuple(false_row(None)),
    TARGETS: tuple(_of_target(tumour_row(None))),
    FALSE_TARGETS: tuple(_of_target(false_row(None))),
}
"""The columns of each table."""
