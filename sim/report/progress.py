"""The curves over the sensing actions that follow a page's slider: of one run, or of several over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.episode.measures import SENSED_GOAL
from sim.record.run_record import RunRecord

from .charts import progress_chart

ONE_OF_THREE, ONE_OF_FOUR = 104.0, 72.0
"""Heights of a chart beside the view, where three or four charts share the height of the view."""


def progress(
    records: Sequence[RunRecord], colours: Sequence[str] = (), height: float = 0.0
) -> list[dict[str, str]]:
    """The name, title, note and SVG text of each curve that some run has.

    Args:
        records: The runs.
        colours: Class of each run's colour; by default one run, each of whose curves has the colour of its measure.
        height: Height of each chart; by default what fits beside the view.
    """
    target = _shared_target(records)
    height = height or (ONE_OF_THREE if target is None else ONE_OF_FOUR)
    charts = [
        _chart(records, "sensed_fraction", colours or ["truth"], "sensed", "Tumour sensed",
               "share of a tumour that lay in some cone, mean over the tumours", height=height,
               label="Share of the tumours sensed over the sensing actions",
               y_top=1.0, is_percent=True, target=SENSED_GOAL),
        _chart(records, "auprc", colours or ["map"], "auprc", "AUPRC of the map",
               "area under the precision-recall curve", height=height,
               label="AUPRC of the map over the sensing actions", y_top=1.0, digits=3),
    ]  # fmt: skip
    if target is not None:
        title = f"AUPRC of the map of {target}"
        targets = [record.target for record in records if record.target is not None]
        charts.append(
            _chart(targets, "auprc", colours or ["second-map"], "target", title,
                   "area under its precision-recall curve", height=height,
                   label=f"{title} over the sensing actions", y_top=1.0, digits=3)
        )  # fmt: skip
    charts.append(_goes_by(records, colours or ["probe"], height))
    return [chart for chart in charts if chart["svg"]]


def _goes_by(records: Sequence[RunRecord], colours: Sequence[str], height: float) -> dict[str, str]:
    """The curve of what the planners go by: a confidence, or the expected improvement where none has one."""
    if any(np.isfinite(record.numbers("confidence")).any() for record in records):
        goals = {record.options.get("until_confident") for record in records}
        goal = goals.pop() if len(goals) == 1 else None
        asked = "" if goal is None else f"; it may stop at {float(goal):.0%}"
        return _chart(
            records, "confidence", colours, "confidence", "Planner’s confidence",
            f"that nothing is left to find or outline{asked}", height=height,
            label="Confidence of the planner after each sensing action",
            y_top=1.0, is_percent=True, target=goal,
        )  # fmt: skip
    return _chart(
        records, "expected_improvement", colours, "improvement", "Expected improvement",
        "the highest that any point still promises (latent’s unit)", height=height,
        label="Highest expected improvement after each sensing action",
    )  # fmt: skip


def _chart(
    records: Sequence[RunRecord], column: str, colours: Sequence[str], name: str, title: str, note: str, **options: Any
) -> dict[str, str]:  # fmt: skip
    svg = progress_chart(name, [record.numbers(column) for record in records], colours=colours, **options)
    return {"name": name, "title": title, "note": note, "svg": svg}


def _shared_target(records: Sequence[RunRecord]) -> str | None:
    """The name of the second class that all runs have; None where there is none."""
    names = {None if record.target is None else record.target.anatomy.name for record in records}
    return names.pop() if len(names) == 1 else None
