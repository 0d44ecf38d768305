"""Results as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    ("modelled time of the procedure [s]", "procedure_s", "{:.1f}"),
    ("way of the tip [m]", "tip_path_m", "{:.2f}"),
    ("time in all [s]", "wall_s", "{:.1f}"),
)

TARGET_ROWS = (
    ("{}: actions until 95 % was sensed", "target_sensings_to_95", "{}"),
    ("{}: sensed", "target_sensed_fraction", "{:.1%}"),
    ("{}: AUPRC of their map", "target_auprc", "{:.3f}"),
    ("{}: Dice at probability 0.5", "target_dice", "{:.3f}"),
)
"""Of a second class, whose name the labels begin with."""

REACH_ROWS = (
    ("poses", "n_poses", "{}"),
    ("reached", "reached_fraction", "{:.2%}"),
    ("share in the largest connected region", "largest_region_fraction", "{:.2%}"),
    ("connected regions", "n_regions", "{}"),
    ("score, median", "score_median", "{:.2f}"),
    ("clearance, tenth percentile [m]", "clearance_m_p10", "{:.3f}"),
    ("distance to joint limits, tenth percentile [rad]", "joint_limit_distance_rad_p10", "{:.2f}"),
    ("poses a second", "poses_per_s", "{:.0f}"),
    ("time in all [s]", "wall_s", "{:.1f}"),
)


def episode_table(summary: Mapping[str, Any]) -> str:
    """The results of an episode as an aligned table, ending with the folder that holds them."""
    head = (
        f"{summary['scenario']}, planner {summary['planner']}, arm {summary['arm']}, seed {summary['seed']}"
    )
    name, rows = summary.get("target_name"), list(ROWS)
    if name is not None:
        rows[-1:-1] = [(label.format(name), key, form) for label, key, form in TARGET_ROWS]
    return "\n".join([head, "-" * len(head), *_lines(rows, summary), f"written to {summary['folder']}"])


def reach_table(summary: Mapping[str, Any]) -> str:
    """The results of a reachability study as an aligned table, ending with the folder that holds them."""
    head = f"{summary['scenario']}, arm {summary['arm']}"
    reasons = [
        f"not reached, {name.replace('_', ' ')}: {count}"
        for name, count in summary["reasons"].items()
        if name != "reached"
    ]
    tilts = [
        f"reached with a tilt of up to {tilt} degrees: {share:.2%}"
        for tilt, share in summary["reached_fraction_by_tilt_deg"].items()
    ]
    lines = [*_lines(REACH_ROWS, summary), *reasons, *tilts, *_base_lines(summary)]
    return "\n".join([head, "-" * len(head), *lines, f"written to {summary['folder']}"])


def arms_summary(summary: Mapping[str, Any]) -> str:
    """The arms of a comparison as a table, ending with the folder that holds their studies."""
    return f"{summary['scenario']}\n\n{summary['table']}\nwritten to {summary['folder']}"


def _base_lines(summary: Mapping[str, Any]) -> list[str]:
    """What a search for a base found."""
    found = summary.get("base_search")
    if found is None:
        return []
    head = f"best of {found['n_bases']} bases, asked for {found['n_poses']} poses each"
    head += f" ({found['n_blocked']} more had no room)" if found["n_blocked"] else ""
    best, present = found["best_reached_fraction"], summary["reached_fraction"]
    lines = [
        "",
        f"{head}:",
        f"  reached from there  {best:.2%} of all poses, from the present base {present:.2%}",
    ]
    if found["objective"] == "seen":
        shares = (found[f"{name}_seen_fraction_by_sample"] for name in ("best", "present"))
        lines.append("  organ's inside seen {:.1%}, from the present base {:.1%}".format(*shares))
    if found["best_stage"] == "present":
        return [*lines, "  no candidate is better than the present base"]
    return [*lines, f"  to put the base there: {_base_flags(found['best_base'])}"]


def _lines(rows: Sequence[tuple[str, str, str]], summary: Mapping[str, Any]) -> list[str]:
    width = max(len(label) for label, *_ in rows)
    lines = []
    for label, key, form in rows:
        value = summary.get(key)
        lines.append(f"{label:<{width}}  {'–' if value is None else form.format(value)}")
    return lines


def _base_flags(place: Mapping[str, Any]) -> str:
    """What to type to put an arm's base somewhere."""
    base_mm = " ".join(f"{value:g}" for value in place["base_mm"])
    return f"--base-mm {base_mm} --base-yaw-deg {place['base_yaw_deg']:g}"
