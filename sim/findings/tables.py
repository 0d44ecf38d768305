"""The files of findings, in SI units and the world frame: tumours.csv, false_findings.csv, and both in findings.json.

A second class has targets.csv and target_false_findings.csv, with the same columns.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mapping.storage import replacing
from sim.tables import write_csv

from .findings import FalseFinding, Findings, TumourFinding

TUMOURS, FALSE_FINDINGS, FINDINGS = "tumours.csv", "false_findings.csv", "findings.json"
TARGETS, FALSE_TARGETS = "targets.csv", "target_false_findings.csv"


def write_finding_tables(folder: Path, findings: Findings) -> None:
    """Write the two tables of each class to a run's folder, and findings.json."""
    write_csv(folder / TUMOURS, map(tumour_row, findings.tumours), list(tumour_row(None)))
    write_csv(folder / FALSE_FINDINGS, map(false_row, findings.false), list(false_row(None)))
    if findings.target is not None:
        bodies = [_of_target(tumour_row(each)) for each in findings.target.tumours]
        false = [_of_target(false_row(each)) for each in findings.target.false]
        write_csv(folder / TARGETS, bodies, list(_of_target(tumour_row(None))))
        write_csv(folder / FALSE_TARGETS, false, list(_of_target(false_row(None))))
    with replacing(folder / FINDINGS) as file:
        file.write((json.dumps(finding_summary(findings), indent=2, allow_nan=False) + "\n").encode())


def tumour_row(finding: TumourFinding | None) -> dict[str, Any]:
    """A row of tumours.csv; for None a row of empty cells, which tells the columns."""
    overlap = finding.overlap if finding else None
    is_missed = finding is not None and finding.is_found is False
    steps = ("first_seen_step", "sensed_step", "first_mapped_step")
    names = ("tumour", "is_found", *steps, "sensed_fraction", "true_volume_m3")
    row: dict[str, Any] = {name: getattr(finding, name, None) for name in names}
    row["mapped_volume_m3"] = 0.0 if is_missed else getattr(overlap, "mapped_volume_m3", None)
    row |= {name: getattr(overlap, name, None) for name in ("centroid_error_m", "dice")}
    row |= {name: getattr(finding, name, None) for name in ("surface_mean_m", "surface_hausdorff95_m")}
    row |= _place("true_centroid", finding.true_centroid_m if finding else None)
    row |= _place("mapped_centroid", overlap.mapped_centroid_m if overlap else None)
    return row | {f"true_{name}": getattr(finding, name, None) for name in ("diameter_m", "depth_m")}


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
