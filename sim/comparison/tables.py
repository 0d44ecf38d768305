"""A comparison as tables: cells as text, Markdown for people, CSV for programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sim.tables import markdown_table

from .comparison import SENSINGS, Comparison, Pairing, Score
from .estimates import MeanEstimate
from .lesions.tables import lesion_markdown
from .limits import Limits, limit_parts
from .texts import interval_text, number_text

SCORE_HEAD = ("contender", "trials", "mean ± sd", "95 % interval", "median [95 %]", "never", "failed")
PAIR_HEAD = ("pair", "seeds", "mean difference [95 %]", "wins / ties / losses", "win rate [95 %]")


def markdown(comparison: Comparison, notes: Sequence[str] = (), limits: Limits | None = None) -> str:
    """All tables, case by case, with the limit of the cases that have one."""
    parts = ["# Comparison", *notes]
    for case in comparison.cases:
        parts += [f"## {case}", *failures(comparison, case), *lesion_markdown(comparison, case)]
        scores = [score for score in comparison.scores if score.case == case]
        pairings = [pairing for pairing in comparison.pairings if pairing.case == case]
        for measure in dict.fromkeys(score.measure for score in scores):
            better = "lower" if measure.lower_is_better else "higher"
            parts.append(f"### {measure.label} ({better} is better)")
            by_measure = [score for score in scores if score.measure == measure]
            parts.append(score_table(by_measure))
            if note := horizon_note(by_measure[0].horizon):
                parts.append(note)
            pairs = [pairing for pairing in pairings if pairing.measure == measure]
            if pairs:
                parts.append(pair_table(pairs))
            if measure is SENSINGS:
                parts += limit_parts(comparison, case, limits or {})
    return "\n\n".join(parts) + "\n"


def horizon_note(horizon: float) -> str:
    """What to say where means are restricted; empty where every trial got there."""
    if math.isinf(horizon):
        return ""
    return (
        f"Not every trial got there. Means are restricted to {horizon:.0f} actions: a trial that needs more, or never "
        "gets there, counts with that number. Medians are of all trials."
    )


def score_table(scores: Sequence[Score]) -> str:
    """The scores by one measure as a Markdown table."""
    return markdown_table(SCORE_HEAD, [list(score_cells(score).values()) for score in scores])


def score_cells(score: Score) -> dict[str, str]:
    """The cells of a score, in the order of `SCORE_HEAD`."""
    form, estimate = score.measure.form, score.estimate
    return {
        "name": score.contender,
        "n": str(estimate.n),
        "mean": f"{form.format(estimate.mean)} ± {number_text(estimate.deviation, form)}",
        "interval": interval_text(estimate.interval, form),
        "median": f"{number_text(score.median, form)} {interval_text(score.median_interval, form)}",
        "never": f"{score.n_never} of {estimate.n}" if score.measure is SENSINGS else "–",
        "failed": str(score.n_failed),
    }


def pair_table(pairings: Sequence[Pairing]) -> str:
    """The pairings by one measure as a Markdown table; differences are first minus second."""
    return markdown_table(PAIR_HEAD, [list(pair_cells(pairing).values()) for pairing in pairings])


def pair_cells(pairing: Pairing) -> dict[str, str]:
    """The cells of a pairing, in the order of `PAIR_HEAD`."""
    form, estimate = pairing.measure.form, pairing.estimate
    difference = estimate.difference
    n_losses = estimate.n - estimate.n_wins - estimate.n_ties
    return {
        "name": f"{pairing.first} − {pairing.second}",
        "n": str(estimate.n),
        "difference": f"{form.format(difference.mean)} {interval_text(difference.interval, form)}",
        "wins": f"{estimate.n_wins} / {estimate.n_ties} / {n_losses}",
        "rate": f"{estimate.win_rate:.0%} {interval_text(estimate.win_interval, '{:.0%}')}",
    }


def flat_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """The scores and pairings as rows of one CSV file, with all their digits."""
    return [*map(_score_row, comparison.scores), *map(_pairing_row, comparison.pairings)]


def _score_row(score: Score) -> dict[str, Any]:
    return {
        "case": score.case,
        "measure": score.measure.key,
        "contender": score.contender,
        "against": "",
        **_estimate_cells(score.estimate),
        "median": score.median,
        "median_low": score.median_interval[0],
        "median_high": score.median_interval[1],
        "horizon": score.horizon,
        "n_never": score.n_never,
        "n_failed": score.n_failed,
    }


def _pairing_row(pairing: Pairing) -> dict[str, Any]:
    estimate = pairing.estimate
    return {
        "case": pairing.case,
        "measure": pairing.measure.key,
        "contender": pairing.first,
        "against": pairing.second,
        **_estimate_cells(estimate.difference),
        "n_wins": estimate.n_wins,
        "n_ties": estimate.n_ties,
        "win_rate": estimate.win_rate,
        "win_low": estimate.win_interval[0],
        "win_high": estimate.win_interval[1],
    }


def _estimate_cells(estimate: MeanEstimate) -> dict[str, Any]:
    return {
        "n": estimate.n,
        "mean": estimate.mean,
        "deviation": estimate.deviation,
        "low": estimate.interval[0],
        "high": estimate.interval[1],
    }


def failures(comparison: Comparison, case: str) -> list[str]:
    """A sentence about the trials of a case that have no result; nothing where all have one."""
    failed = [(group, entry) for group in comparison.groups_of(case) for entry in group.failed]
    if not failed:
        return []
    group, entry = failed[0]
    return [
        f"{len(failed)} trials of this case have no result and are left out, the first being {group.contender}, seed "
        f"{entry['settings']['seed']}: {entry['row']['error']}"
    ]
