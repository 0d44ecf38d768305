"""The page of a comparison: `report.html`, with tables, intervals, curves and links to the runs that have folders."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapping.storage import replacing
from sim.campaign.campaign_folder import read_study
from sim.campaign.trial_result import RECALL_LEVELS
from sim.report.page import REPORT, environment

from .comparison import SENSINGS, Comparison, Measure, Pairing, Score
from .estimates import reached_shares, spread_of
from .lesions.page import lesion_part
from .limits import Limits, beside_limit, limit_note, restrictions_of
from .series_charts import N_COLOURS, Series, legend, series_chart, span_of, strip
from .side_by_side import link, run_folder, seed_pictures, seed_rows
from .tables import failures, horizon_note, pair_cells, score_cells
from .trial_groups import TrialGroup

TEMPLATES = Path(__file__).resolve().parent / "assets"


def write_comparison_page(
    folder: Path,
    comparison: Comparison,
    *,
    notes: Sequence[str],
    campaigns: Sequence[Path],
    views: Path | None = None,
    limits: Limits | None = None,
) -> Path:
    """Write the report of a comparison, and return the file.

    Args:
        folder: The folder to write to.
        comparison: What is compared.
        notes: Sentences about the campaigns.
        campaigns: Folders of the campaigns, in which the folders of episodes are looked for.
        views: Folder of the runs that were drawn again.
        limits: The limit of each case that has one.
    """
    names = list(dict.fromkeys(group.contender for group in comparison.groups))
    n_trials = sum(len(group.entries) for group in comparison.groups)
    text = environment(TEMPLATES).get_template("comparison.html.j2").render(
        title=_title(names, campaigns),
        studies=[_study(path) for path in campaigns],
        lede=_lede(comparison, names, n_trials),
        notes=notes,
        cases=[_case(comparison, case, names, folder, campaigns, limits or {}) for case in comparison.cases],
        views=_views(views, folder),
    )  # fmt: skip
    with replacing(folder / REPORT) as file:
        file.write(text.encode(errors="surrogateescape"))
    return folder / REPORT


def _title(names: Sequence[str], campaigns: Sequence[Path]) -> str:
    """The contenders where they are few, and else the campaigns."""
    if 2 <= len(names) <= 3:
        return " against ".join(names)
    return ", ".join(path.resolve().name for path in campaigns)


def _study(path: Path) -> dict[str, str]:
    """Where a campaign's rows come from: folder, title, day, version and command."""
    study = read_study(path) or {}
    machine = study.get("machine", {})
    commit = str(machine.get("commit") or "")
    version = f"Sounding {machine.get('sounding', '')}{f', commit {commit[:8]}' if commit else ''}"
    return {
        "name": path.resolve().name,
        "title": str(study.get("study", {}).get("title", "")),
        "day": str(study.get("started", ""))[:10],
        "version": version + ("+" if commit.endswith("+") else ""),
        "command": shlex.join(["sounding", *map(str, machine.get("command", []))]),
    }


def _lede(comparison: Comparison, names: Sequence[str], n_trials: int) -> str:
    cases = len(comparison.cases)
    return (
        f"{n_trials:,} trials of {len(names)} {'contender' if len(names) == 1 else 'contenders'} in {cases} "
        f"{'case' if cases == 1 else 'cases'}. Contenders with one seed face the same tumours. Intervals hold 95 %."
    )


def _case(
    comparison: Comparison,
    case: str,
    names: Sequence[str],
    folder: Path,
    campaigns: Sequence[Path],
    limits: Limits,
) -> dict[str, Any]:
    groups = comparison.groups_of(case)
    scores = [score for score in comparison.scores if score.case == case]
    pairings = [pairing for pairing in comparison.pairings if pairing.case == case]
    measures = dict.fromkeys(score.measure for score in scores)
    return {
        "title": case,
        "failures": failures(comparison, case),
        "legend": legend(names),
        "charts": _charts(comparison, case, groups, names),
        "lesions": lesion_part(comparison, case, names),
        "measures": [
            _measure(
                measure,
                [score for score in scores if score.measure == measure],
                [pairing for pairing in pairings if pairing.measure == measure],
                names,
            )
            for measure in measures
        ],
        "contenders": [(group.contender, f"c{names.index(group.contender) % N_COLOURS}") for group in groups],
        "limit": _limit(comparison, case, limits),
        "has_limit": case in limits,
        "seeds": seed_rows(groups, limits.get(case)),
        "pictures": seed_pictures(groups, folder, campaigns),
        "runs": [runs for group in groups if (runs := _runs(group, folder, campaigns))],
    }


def _charts(
    comparison: Comparison, case: str, groups: Sequence[TrialGroup], names: Sequence[str]
) -> list[dict[str, str]]:
    mapped = [group for group in groups if comparison.score(case, group.contender, "auprc")]
    found = [group for group in groups if comparison.score(case, group.contender, SENSINGS.key)]
    charts = []
    if found:
        charts.append(
            ("Trials that got to 95 %", "share of trials (up) against sensing actions (across)",
             series_chart([_reached(group, names) for group in found], is_log=True,
                          label="Share of trials that had sensed 95 % after each number of actions"))
        )  # fmt: skip
    if mapped:
        curves = [_banded(group, "auprc", np.arange(1.0, group.n_steps + 1), names) for group in mapped]
        charts.append(("AUPRC of the map", "mean and standard deviation against sensing actions",
                       series_chart(curves, label="AUPRC after each action")))  # fmt: skip
        curves = [_banded(group, "precision", np.asarray(RECALL_LEVELS), names) for group in mapped]
        svg = series_chart(curves, is_unit=True, label="Precision at each recall of the last maps")
        charts.append(("Precision and recall", "of the last maps, mean and standard deviation", svg))
    return [{"title": t, "note": note, "svg": svg} for t, note, svg in charts]


def _reached(group: TrialGroup, names: Sequence[str]) -> Series:
    x, shares = reached_shares(group.sensings_to_95())
    return Series(
        name=group.contender, index=names.index(group.contender), is_step=True,
        x=np.append(x, max(group.n_steps, 2)), middle=np.append(shares, shares[-1]),
    )  # fmt: skip


def _banded(group: TrialGroup, key: str, x: np.ndarray, names: Sequence[str]) -> Series:
    mean, low, high = spread_of(group.curve(key))
    return Series(
        name=group.contender, index=names.index(group.contender), x=x[: len(mean)], middle=mean, low=low, high=high,
    )  # fmt: skip


def _measure(
    measure: Measure, scores: Sequence[Score], pairings: Sequence[Pairing], names: Sequence[str]
) -> dict[str, Any]:
    span = span_of([s.estimate.mean for s in scores], [s.estimate.interval for s in scores], from_zero=True)
    pair_span = span_of(
        [p.estimate.difference.mean for p in pairings] or [0.0],
        [p.estimate.difference.interval for p in pairings], from_zero=True,
    )  # fmt: skip
    return {
        "title": measure.label[0].upper() + measure.label[1:],
        "better": "lower is better" if measure.lower_is_better else "higher is better",
        "note": horizon_note(scores[0].horizon),
        "has_never": measure is SENSINGS,
        "scores": [_score_row(score, span, names) for score in scores],
        "pairs": [_pair_row(pairing, pair_span) for pairing in pairings],
    }  # fmt: skip


def _score_row(score: Score, span: tuple[float, float], names: Sequence[str]) -> dict[str, Any]:
    colour = f"c{names.index(score.contender) % N_COLOURS}"
    line = strip(score.estimate.mean, score.estimate.interval, span, colour=colour)
    return score_cells(score) | {"colour": colour, "strip": line}


def _pair_row(pairing: Pairing, span: tuple[float, float]) -> dict[str, Any]:
    difference = pairing.estimate.difference
    line = strip(difference.mean, difference.interval, span, colour="ink", zero=True)
    return pair_cells(pairing) | {"strip": line}


def _limit(comparison: Comparison, case: str, limits: Limits) -> dict[str, Any] | None:
    rows = beside_limit(comparison, case, limits)
    if not rows:
        return None
    note = " ".join([*restrictions_of(comparison, case, rows), limit_note(limits[case])])
    return {"rows": [row.cells() for row in rows], "note": note}


def _runs(group: TrialGroup, folder: Path, campaigns: Sequence[Path]) -> dict[str, Any] | None:
    """The links to the reports of a contender's trials, by seed; None where no trial has a folder."""
    links = []
    for entry in group.entries:
        run = run_folder(entry, campaigns)
        if run is not None and (run / REPORT).is_file():
            links.append((entry["settings"]["seed"], link(run / REPORT, folder)))
    return {"name": group.contender, "links": links} if links else None


def _views(views: Path | None, folder: Path) -> list[tuple[str, str]]:
    if views is None:
        return []
    return [(report.parent.name, link(report, folder)) for report in sorted(views.glob(f"*/{REPORT}"))]
