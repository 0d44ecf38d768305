"""Results as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ROWS = (
    ("sensing actions", "n_sensings", "{}"),
    ("actions until 95 % of the tumour was sensed", "sensings_to_95", "{}"),
    ("tumour sensed", "sensed_fraction", "{:.1%}"),
    ("tumour that could be sensed at all", "attainable_fraction", "{:.1%}"),
    ("AUPRC of the map", "auprc", "{:.3f}"),
    ("Dice at probability 0.5", "dice", "{:.3f}"),
    ("log loss", "log_loss", "{:.4f}"),
    ("calibration error", "expected_calibration_error", "{:.4f}"),
    ("poses skipped, out of the arm's reach", "n_skipped_poses", "{}"),
    ("time in all [s]", "wall_s", "{:.1f}"),
)


def episode_table(summary: Mapping[str, Any]) -> str:
    """The results of an episode as an aligned table, ending with the folder that holds them."""
    head = (
        f"{summary['scenario']}, planner {summary['planner']}, arm {summary['arm']}, seed {summary['seed']}"
    )
    lines = [head, "-" * len(head)]
    width = max(len(label) for label, *_ in ROWS)
    for label, key, form in ROWS:
        value = summary.get(key)
        lines.append(f"{label:<{width}}  {'–' if value is None else form.format(value)}")
    return "\n".join([*lines, f"written to {summary['folder']}"])
