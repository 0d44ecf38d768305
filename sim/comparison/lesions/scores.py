"""The lesions of contenders: the share found by diameter, over the actions and over the map's threshold.

Lesions of one organ share their fate, so all intervals are bootstraps over seeds, each with all of its lesions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.campaign.lesions import LESIONS, rows_of

from ..estimates import CONFIDENCE, MeanEstimate, ShareEstimate, mean_estimate, shares_by_cluster
from ..trial_groups import TrialGroup


@dataclass(frozen=True)
class DiameterClass:
    """Lesions of some diameters."""

    label: str
    sign: str
    """The label where there is little room."""
    low_m: float = 0.0
    """The least diameter."""
    high_m: float = math.inf
    """The diameter from which lesions belong to it no more."""


CLASSES = (
    DiameterClass("all", "all"),
    DiameterClass("below 5 mm", "< 5 mm", 0.0, 0.005),
    DiameterClass("5 to 10 mm", "5–10 mm", 0.005, 0.010),
    DiameterClass("10 to 20 mm", "10–20 mm", 0.010, 0.020),
    DiameterClass("20 mm and more", "≥ 20 mm", 0.020),
    DiameterClass("10 mm and more", "≥ 10 mm", 0.010),
)


MOST_ACTIONS = 200
"""Most numbers of actions at which shares are worked out."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeResponseCurve:
    """The share of lesions found against false findings, over the threshold of the map."""

    probability: NDArray[np.float64]
    """The probabilities from which the map would call a point tumour, rising, shape (K,)."""
    found: tuple[ShareEstimate, ...]
    """The share of lesions found at each."""
    false_per_run: NDArray[np.float64]
    """The mean number of false findings of a trial at each, shape (K,)."""
    own: int
    """Which of them is the map's own threshold."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LesionScore:
    """What became of the lesions of a contender's trials."""

    case: str
    contender: str
    n_trials: int
    by_diameter: tuple[ShareEstimate | None, ...]
    """The share found of each of `CLASSES`; None where there are no such lesions."""
    n_sensed: int
    """Lesions of which 95 % was sensed."""
    n_sensed_missed: int
    """Those of them that were missed all the same."""
    false_per_run: MeanEstimate
    response: FreeResponseCurve | None
    """None where the thresholds differ among the trials."""
    actions: NDArray[np.int64]
    """Numbers of actions, from 1 to that of the longest trial, shape (A,)."""
    mapped: tuple[ShareEstimate, ...]
    """The share of lesions of which the map had called some tumour by each of these."""
    seen: tuple[ShareEstimate, ...]
    """The share of lesions of which some cone had held a point by each of these."""

    def share_of(self, of: DiameterClass) -> ShareEstimate | None:
        """The share found of one of `CLASSES`; None where there are no such lesions."""
        return self.by_diameter[CLASSES.index(of)]


def lesion_scores(groups: Sequence[TrialGroup]) -> list[LesionScore]:
    """The scores of the groups whose trials tell of their lesions and kept a map.

    Groups of episodes that were stopped by what they had sensed are left out, as from all scores of last maps.
    """
    return [score for group in groups if (score := _score(group)) is not None]


def lesion_note(groups: Sequence[TrialGroup]) -> str:
    """A sentence where trials are older than what is kept of lesions; empty where none is."""
    entries = [entry for group in groups for entry in group.entries]
    n_old = sum(rows_of(entry, LESIONS) is None for entry in entries)
    if not n_old:
        return ""
    trials = "trial" if n_old == 1 else "trials"
    return (
        f"{n_old} of the {len(entries)} {trials} of this case ran before what became of each lesion was kept, and "
        "their contenders are left out here: run their campaign anew to see it."
    )


def _score(group: TrialGroup) -> LesionScore | None:
    tables = [rows for entry in group.entries if (rows := rows_of(entry, LESIONS)) is not None]
    if not tables or len(tables) < len(group.entries) or group.setting("until_sensed") is not None:
        return None
    false = group.values("n_false_findings")
    lesions = [(seed, row) for seed, rows in zip(group.seeds, tables, strict=True) for row in rows]
    if not lesions or not np.isfinite(false).all():
        return None
    seeds = np.array([seed for seed, _ in lesions], dtype=np.int64)
    is_found = _column(lesions, "is_found") == 1.0
    is_sensed = np.isfinite(_column(lesions, "sensed_step"))
    diameters_m = _column(lesions, "true_diameter_m")
    actions = _actions(max(int(entry["row"]["n_sensings"]) for entry in group.entries))
    return LesionScore(
        case=group.case,
        contender=group.contender,
        n_trials=len(tables),
        by_diameter=tuple(_share_of(each, diameters_m, is_found, seeds) for each in CLASSES),
        n_sensed=int(is_sensed.sum()),
        n_sensed_missed=int((is_sensed & ~is_found).sum()),
        false_per_run=_false_per_run(false),
        response=_response(group, tables),
        actions=actions,
        mapped=_by(actions, _column(lesions, "first_mapped_step"), seeds),
        seen=_by(actions, _column(lesions, "first_seen_step"), seeds),
    )


def _false_per_run(counts: NDArray[np.float64]) -> MeanEstimate:
    """The mean number of false findings, with the interval of a Poisson rate where there was none in any trial."""
    estimate = mean_estimate(counts)
    if counts.any():
        return estimate
    return replace(estimate, interval=(0.0, -math.log((1.0 - CONFIDENCE) / 2.0) / len(counts)))


def _column(lesions: Sequence[tuple[int, dict[str, Any]]], name: str) -> NDArray[np.float64]:
    """A column of the lesions' rows, shape (L,); infinite where it is empty, as for what never came."""
    return np.array([math.inf if row[name] is None else row[name] for _, row in lesions], dtype=np.float64)


def _share_of(
    of: DiameterClass,
    diameters_m: NDArray[np.float64],
    is_found: NDArray[np.bool_],
    seeds: NDArray[np.int64],
) -> ShareEstimate | None:
    belongs = (diameters_m >= of.low_m) & (diameters_m < of.high_m)
    if not belongs.any():
        return None
    return shares_by_cluster(is_found[belongs, None], np.ones(int(belongs.sum())), seeds[belongs])[0]


def _actions(longest: int) -> NDArray[np.int64]:
    """Numbers of actions from 1 on, so few that a chart can show them all."""
    return np.unique(np.linspace(1, longest, min(longest, MOST_ACTIONS)).round().astype(np.int64))


def _by(
    actions: NDArray[np.int64], steps: NDArray[np.float64], seeds: NDArray[np.int64]
) -> tuple[ShareEstimate, ...]:
    """The share of lesions whose step had come by each number of actions."""
    return tuple(shares_by_cluster(steps[:, None] <= actions, np.ones(len(steps)), seeds))


def _response(group: TrialGroup, tables: Sequence[Sequence[Any]]) -> FreeResponseCurve | None:
    kept = [entry["findings"].get("free_response") for entry in group.entries]
    thresholds = {tuple(each["probability"]) for each in kept if each}
    if len(thresholds) != 1 or not all(kept):
        return None
    probability = np.array(thresholds.pop())
    n_found, n_false = (
        np.array([each[name] for each in kept if each], dtype=np.float64) for name in ("n_found", "n_false")
    )
    n_lesions = np.array([len(rows) for rows in tables], dtype=np.float64)
    return FreeResponseCurve(
        probability=probability,
        found=tuple(shares_by_cluster(n_found, n_lesions, group.seeds)),
        false_per_run=n_false.mean(axis=0),
        own=int(group.entries[0]["findings"]["free_response"]["own"]),
    )
