"""The findings of a run as the rows of the page's tables, in millimetres and millilitres."""

from __future__ import annotations

from typing import Any

from sim.findings.findings import FalseFinding, Findings, TumourFinding
from sim.findings.tables import FALSE_FINDINGS, FALSE_TARGETS, TARGETS, TUMOURS

NONE = "–"


def finding_rows(findings: Findings, *, name: str | None = None) -> dict[str, Any]:
    """Both tables with their cells as text, the probability from which the map calls a point tumour, and what to say.

    Args:
        findings: Findings of the tumours, or of a second class.
        name: What the second class is called; None for the tumours.
    """
    words = {"title": "Tumours", "kind": "tumour", "body": "tumour", "files": (TUMOURS, FALSE_FINDINGS)}
    if name is not None:
        words = {
            "title": name[:1].upper() + name[1:],
            "kind": name,
            "body": "body",
            "files": (TARGETS, FALSE_TARGETS),
        }
    return {
        **words,
        "probability": f"{findings.probability:g}",
        "has_map": all(each.is_found is not None for each in findings.tumours),
        "tumours": [_tumour(each) for each in findings.tumours],
        "false": [_false(each) for each in findings.false],
    }


def _tumour(each: TumourFinding) -> dict[str, str]:
    overlap = each.overlap
    return {
        "number": str(each.tumour),
        "found": {True: "found", False: "missed", None: NONE}[each.is_found],
        "seen": _step(each.first_seen_step),
        "sensed": _step(each.sensed_step),
        "attainable": NONE if each.attainable_fraction is None else f"{each.attainable_fraction:.0%}",
        "share": NONE if each.sensed_fraction is None else f"{each.sensed_fraction:.0%}",
        "mapped_from": _step(each.first_mapped_step),
        "true_ml": _ml(each.true_volume_m3),
        "mapped_ml": NONE if each.mapped_volume_m3 is None else _ml(each.mapped_volume_m3),
        "centroid_mm": NONE if overlap is None else _mm(overlap.centroid_error_m),
        "dice": NONE if each.dice is None else f"{each.dice:.2f}",
        "mean_mm": _mm(each.surface_mean_m),
        "hausdorff_mm": _mm(each.surface_hausdorff95_m),
    }


def _false(each: FalseFinding) -> dict[str, str]:
    return {
        "number": str(each.finding),
        "ml": _ml(each.volume_m3),
        "centre_mm": ", ".join(f"{value * 1e3:.0f}" for value in each.centroid_m),
        "probability": f"{each.highest_probability:.2f}",
        "away_mm": _mm(each.tumour_distance_m),
        "mapped_from": _step(each.first_mapped_step),
    }


def _step(step: int | None) -> str:
    return NONE if step is None else str(step)


def _mm(value_m: float | None) -> str:
    return NONE if value_m is None else f"{value_m * 1e3:.1f}"


def _ml(value_m3: float) -> str:
    return f"{value_m3 * 1e6:.2f}"
