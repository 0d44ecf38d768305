"""The contenders of a comparison beside the limit: how many times the least possible each takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.bound.limit import Limit, load_limit, not_counted
from sim.bound.policy import CONFIDENCE
from sim.errors import FieldError
from sim.tables import markdown_table

from .comparison import SENSINGS, Comparison, horizon_of, measured
from .trial_groups import case_of

LIMIT_HEAD = ("contender", "seeds", "mean", "in hindsight", "times that", "any policy", "times that")
Limits = Mapping[str, Limit]
"""The limit of each case that has one."""


@dataclass(frozen=True, kw_only=True)
class Beside:
    """A contender beside the limit."""

    case: str
    contender: str
    n: int
    """Seeds whose hindsight optimum is known."""
    mean: float
    """Mean of the contender on these seeds, restricted as all its means are."""
    hindsight: float
    """Mean of the hindsight optimum on these seeds, restricted alike."""
    policy_mean: float
    """Mean of the contender on all its seeds."""
    policy: float | None
    """The least mean of any policy, restricted alike; None where none is proven."""
    got_there: bool
    """Whether any of its trials did; if none, its mean is but the number of actions that it was given."""

    def cells(self) -> tuple[str, ...]:
        """The cells of a row, in the order of `LIMIT_HEAD`."""
        hindsight = (
            ("–", "–") if not self.n else (f"{self.hindsight:.2f}", self._times(self.mean, self.hindsight))
        )
        policy = ("–", "–")
        if self.policy is not None:
            policy = (f"{self.policy:.2f}", self._times(self.policy_mean, self.policy))
        return (self.contender, str(self.n), f"{self.policy_mean:.2f}", *hindsight, *policy)

    def _times(self, mean: float, least: float) -> str:
        return f"{mean / least:.2f} x" if self.got_there and least > 0.0 else "–"


def load_limits(folders: Sequence[Path], comparison: Comparison) -> Limits:
    """The limits of the cases of a comparison.

    Args:
        folders: Folders that `sounding bound` wrote.
        comparison: What is compared.

    Raises:
        UsageError: A folder holds no bound that is finished, or one of another case.
    """
    limits: dict[str, Limit] = {}
    for folder in folders:
        limit = load_limit(folder)
        case = case_of(limit.case)
        if case not in comparison.cases:
            raise FieldError(
                "bound",
                folder,
                f"is of {case}, and the campaigns are of {'; '.join(comparison.cases)}. Run `sounding bound` with the "
                "scenario and the arm of a campaign.",
            )
        limits[case] = limit
    return limits


def beside_limit(comparison: Comparison, case: str, limits: Limits) -> list[Beside]:
    """The contenders of a case beside its limit; none where there is no limit, or nobody's actions were counted.

    Contenders are left out whose actions are not those that a bound counts.
    """
    limit = limits.get(case)
    groups = [
        group
        for group in comparison.groups_of(case)
        if comparison.score(case, group.contender, SENSINGS.key) is not None
        and not any(not_counted(entry["settings"]) for entry in group.entries)
    ]
    if limit is None or not groups:
        return []
    horizon = horizon_of(groups)
    rows = []
    for group in groups:
        needed, fewest = measured(group, SENSINGS, horizon), limit.in_hindsight(group.seeds)
        is_known = ~np.isnan(fewest)
        rows.append(
            Beside(
                case=case,
                contender=group.contender,
                n=int(is_known.sum()),
                mean=float(needed[is_known].mean()) if is_known.any() else math.nan,
                hindsight=float(np.minimum(fewest[is_known], horizon).mean()) if is_known.any() else math.nan,
                policy_mean=float(needed.mean()),
                policy=limit.least_mean(horizon),
                got_there=bool(np.isfinite(group.sensings_to_95()).any()),
            )
        )
    return rows


def limit_parts(comparison: Comparison, case: str, limits: Limits) -> list[str]:
    """The Markdown about the limit of a case: a table and what it means; nothing where there is no limit."""
    if case not in limits:
        return []
    rows = beside_limit(comparison, case, limits)
    restrictions = restrictions_of(comparison, case, rows)
    parts = [" ".join(restrictions)]
    if rows:
        table = markdown_table(LIMIT_HEAD, [list(row.cells()) for row in rows])
        parts = [table, " ".join([*restrictions, limit_note(limits[case])])]
    return [f"### {SENSINGS.label}, beside the least possible", *parts] if rows or restrictions else []


def restrictions_of(comparison: Comparison, case: str, rows: Sequence[Beside]) -> list[str]:
    """What a reader of the table has to know of contenders that did not get there, or are not in it."""
    notes, named = [], {row.contender for row in rows}
    horizon = horizon_of([group for group in comparison.groups_of(case) if group.contender in named])
    if np.isfinite(horizon):
        notes.append(f"Not every trial got there, so each counts at most {horizon:g} actions, on both sides.")
    for group in comparison.groups_of(case):
        why = next((why for entry in group.entries if (why := not_counted(entry["settings"]))), None)
        if why is not None:
            notes.append(f"{group.contender} is left out: {why}")
    return notes


def limit_note(limit: Limit) -> str:
    """What the columns of the limit mean, and of what the bound is proven."""
    text = "In hindsight: the fewest poses that are enough for whoever knows the truth, on the seeds that both have."
    if limit.policy is None:
        return text
    sure = limit.policy.least_mean(is_apart=True, confidence=CONFIDENCE)
    n = limit.policy.n_places
    text += (
        f" Any policy: the least mean of any that does not know it, from {n} drawn places. For means that are not "
        f"restricted it is at least {sure:.2f} with 95 % confidence."
    )
    if limit.policy.n_tumours > 1 and limit.policy.weighted is None:
        text += " Of several tumours that the scenario keeps apart nothing more is proven than the hindsight optimum."
    return text


def limit_rows(comparison: Comparison, limits: Limits) -> list[dict[str, Any]]:
    """The limits as rows of compare.csv, each a contender of its own."""
    rows: list[dict[str, Any]] = []
    for case in comparison.cases:
        for each in beside_limit(comparison, case, limits):
            known = {"in hindsight": each.hindsight if each.n else None, "any policy": each.policy}
            rows += [
                {
                    "case": case,
                    "measure": "limit",
                    "contender": name,
                    "against": each.contender,
                    "n": each.n,
                    "mean": value,
                }
                for name, value in known.items()
                if value is not None
            ]
    return rows
