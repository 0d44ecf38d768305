"""The findings of an episode in a few numbers, as summary.json and the rows of trials hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .findings import Findings, TumourFinding

LARGE_M = 0.010
"""Diameter from which lesions are counted once more by themselves: smaller ones are missed by all (10 mm)."""


def lesion_measures(findings: Findings) -> dict[str, Any]:
    """How many lesions were found, how many findings are false, and how wrong the volume is.

    Values are None where they are not defined: without a map all that is about finding, and shares of no lesions. Those
    of a second class have names that begin with `target_`.
    """
    own = _measures(findings)
    if findings.target is None:
        return own
    return own | {f"target_{name}": value for name, value in _measures(findings.target).items()}


def _measures(findings: Findings) -> dict[str, Any]:
    lesions, has_map = findings.tumours, findings.has_map
    large = [each for each in lesions if each.diameter_m >= LARGE_M]
    return {
        "n_lesions": len(lesions),
        "n_lesions_found": findings.n_found if has_map else None,
        "lesions_found_fraction": _found_fraction(lesions, has_map=has_map),
        "n_lesions_10mm": len(large),
        "n_lesions_10mm_found": sum(bool(each.is_found) for each in large) if has_map else None,
        "lesions_10mm_found_fraction": _found_fraction(large, has_map=has_map),
        "n_false_findings": len(findings.false) if has_map else None,
        "volume_error_fraction": _volume_error(findings) if has_map else None,
    }


def _found_fraction(lesions: Sequence[TumourFinding], *, has_map: bool) -> float | None:
    if not has_map or not lesions:
        return None
    return sum(bool(each.is_found) for each in lesions) / len(lesions)


def _volume_error(findings: Findings) -> float | None:
    """All volume that the map calls tumour, false findings too, less the true one, over the true one."""
    true_m3 = sum(each.true_volume_m3 for each in findings.tumours)
    if not true_m3:
        return None
    mapped_m3 = sum(each.mapped_volume_m3 or 0.0 for each in findings.tumours)
    return (mapped_m3 + sum(each.volume_m3 for each in findings.false) - true_m3) / true_m3
