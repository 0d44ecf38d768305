"""The lesions of a case on the page of a comparison: a table by diameter and two charts."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.report.charts import QUARTERS, Plot, nice, svg_text, x_axis, y_axis

from ..estimates import ShareEstimate
from ..series_charts import N_COLOURS, Series, series_chart
from .scores import DiameterClass, LesionScore, lesion_note
from .tables import LESION_NOTE, classes_in, false_words, scores_of, sensed_missed_words, share_words

if TYPE_CHECKING:
    from ..comparison import Comparison


def lesion_part(comparison: Comparison, case: str, names: Sequence[str]) -> dict[str, Any]:
    """What the template shows of a case's lesions.

    Args:
        comparison: What is compared.
        case: The case.
        names: All contenders, whose order decides about their colours.
    """
    scores = scores_of(comparison, case)
    classes = classes_in(scores)
    return {
        "note": lesion_note(comparison.groups_of(case)),
        "rule": LESION_NOTE,
        "labels": [each.sign for each in classes],
        "rows": [_row(score, classes, names) for score in scores],
        "charts": _charts(scores, names) if scores else [],
    }


def _row(score: LesionScore, classes: Sequence[DiameterClass], names: Sequence[str]) -> dict[str, Any]:
    return {
        "name": score.contender,
        "colour": _colour(score, names),
        "n": score.n_trials,
        "shares": [share_words(score.share_of(of)) for of in classes],
        "sensed_missed": sensed_missed_words(score),
        "false": false_words(score),
    }


def _colour(score: LesionScore, names: Sequence[str]) -> str:
    return f"c{names.index(score.contender) % N_COLOURS}"


def _charts(scores: Sequence[LesionScore], names: Sequence[str]) -> list[dict[str, str]]:
    mapped = series_chart(
        [_mapped(score, names) for score in scores], label="Share of lesions mapped after each action"
    )
    charts = [
        {
            "title": "Lesions mapped",
            "note": "share of which the map had called some tumour, against sensing actions, 95 % interval",
            "svg": mapped,
        }
    ]
    if any(score.response is not None for score in scores):
        charts.append(
            {
                "title": "Free response",
                "note": "share of lesions found (up) against false findings a run, over the map’s threshold; large "
                "dots: its own",
                "svg": _free_response(scores, names),
            }
        )
    return charts


def _mapped(score: LesionScore, names: Sequence[str]) -> Series:
    ends = np.array([_ends(share) for share in score.mapped])
    return Series(
        name=score.contender,
        index=names.index(score.contender),
        is_step=True,
        x=score.actions.astype(np.float64),
        middle=np.array([share.share for share in score.mapped]),
        low=ends[:, 0],
        high=ends[:, 1],
    )


def _ends(share: ShareEstimate) -> tuple[float, float]:
    """The ends of an interval; the share itself where there is none."""
    return share.interval if np.isfinite(share.interval[0]) else (share.share, share.share)


def _free_response(scores: Sequence[LesionScore], names: Sequence[str]) -> str:
    responses = [(score, score.response) for score in scores if score.response is not None]
    last = max(float(response.false_per_run.max()) for _, response in responses)
    end = nice(last) if last > 0 else 1.0
    plot = Plot(x_range=(0.0, end * 1.02), y_range=(0.0, 1.0), width=380.0, height=250.0)
    body = [y_axis(plot, QUARTERS, is_percent=False), x_axis(plot, np.linspace(0.0, end, 5).tolist())]
    for score, response in responses:
        colour, name = _colour(score, names), escape(score.contender)
        places = [
            (plot.x(float(false)), plot.y(share.share))
            for false, share in zip(response.false_per_run, response.found, strict=True)
        ]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        body.append(f'<polyline class="line {colour}" points="{points}"><title>{name}</title></polyline>')
        for k, (x, y) in enumerate(places):
            said = (
                f"{name}, called from {response.probability[k]:.3f}: {response.found[k].share:.0%} found, "
                f"{response.false_per_run[k]:.2f} false findings a run"
            )
            radius = 5.0 if k == response.own else 2.2
            body.append(
                f'<circle class="dot {colour}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"><title>{said}</title></circle>'
            )
    return svg_text(plot, "Share of lesions found against false findings a run", body)
