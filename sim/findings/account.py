"""The account of a run in plain sentences: which tumours were found, why it ended, and what its numbers mean.

It is made of what summary.json, config.json and findings.json hold, so that the terminal and the page say the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .tables import FINDINGS

MEANING = (
    "Found is a tumour of which the map calls at least two lattice points tumour, sensed is how much of a tumour lay "
    "in some cone, in the mean over the tumours, large or small, and AUPRC how well the map tells tumour from healthy "
    "tissue in the whole organ (1 is perfect): the map fills in what lies between and beside the cones, so it can be "
    "nearly right while much of a tumour was never sensed, and it can miss a small one that was."
)
PAPER_PLANNER, OUTLINING_PLANNER = "expected-improvement", "find-and-outline"
PAPER = (
    f"{PAPER_PLANNER} is the paper's planner, which `make episode` runs so that its results can be held against the "
    "paper's: it goes where tumour is likely and does not outline what it found, as find-and-outline does."
)


@dataclass(frozen=True)
class Lesion:
    """One true tumour, or body of a second class, as a person is told of it."""

    name: str
    size: str
    """Its diameter and depth."""
    found: str
    """`found`, `missed`, or empty without a map."""
    sensed: str
    """The share that was sensed."""


@dataclass(frozen=True)
class Account:
    """What a person wants to know first."""

    found: tuple[str, ...]
    """How many were found of how many, and how many false findings there are; a text for each class."""
    lesions: tuple[Lesion, ...]
    ended: str
    """Why the run ended; empty where it did not by itself."""
    limit: str
    """How the actions compare with the least possible; empty where no limit is at hand."""
    meaning: str
    """What the numbers mean, and where the paper's planner ran, why it did; empty without tumours."""


def read_account(folder: Path, summary: Mapping[str, Any]) -> Account:
    """The account of a run that has just ended.

    Args:
        folder: The run's folder.
        summary: What its summary.json holds.
    """
    config, findings = (
        json.loads((folder / name).read_text(encoding="utf-8")) for name in ("config.json", FINDINGS)
    )
    return account(summary, config["options"], findings)


def account(summary: Mapping[str, Any], options: Mapping[str, Any], findings: Mapping[str, Any]) -> Account:
    """The account of a run.

    Args:
        summary: What summary.json holds; empty for a run that was killed.
        options: The options in config.json.
        findings: What findings.json holds.
    """
    planner = str(summary.get("planner", options["planner"]))
    found, lesions = [_found(findings, "tumour")], _lesions(findings, "tumour", "tumour")
    if (target := findings.get("target")) is not None:
        name = str(summary.get("target_name", "target"))
        found.append(_found(target, "target", name))
        lesions += _lesions(target, "target", name)
    meaning = f"{MEANING} {PAPER}" if planner == PAPER_PLANNER else MEANING
    has_map = any(lesion.found for lesion in lesions)
    ended = " ".join(filter(None, (_ended(summary, options), _left(summary), _place(summary))))
    return Account(
        found=tuple(found),
        lesions=tuple(lesions),
        ended=ended,
        limit=_limit(summary),
        meaning=meaning if has_map else "",
    )


def _found(findings: Mapping[str, Any], key: str, name: str | None = None) -> str:
    """How many bodies of a class were found."""
    n, rows = findings[f"n_{key}s"], findings[f"{key}s"]
    what = f"{name or key}{'' if n == 1 or name else 's'}"
    n_false = findings["n_false_findings"]
    false = "no false finding" if not n_false else f"{n_false} false finding{'' if n_false == 1 else 's'}"
    if n == 0:
        return f"no {what} in this organ, {false}"
    if rows[0]["is_found"] is None:
        return f"{n} {what}; no map was kept that could find {'it' if n == 1 else 'them'}"
    return f"{findings[f'n_{key}s_found']} of {n} {what} found, {false}"


def _lesions(findings: Mapping[str, Any], key: str, name: str) -> list[Lesion]:
    return [
        Lesion(
            name=f"{name} {row[key]}",
            size=f"{row['true_diameter_m'] * 1e3:.0f} mm across, centre {row['true_depth_m'] * 1e3:.0f} mm deep",
            found={True: "found", False: "missed", None: ""}[row["is_found"]],
            sensed="" if row["sensed_fraction"] is None else f"{row['sensed_fraction']:.0%} sensed",
        )
        for row in findings[f"{key}s"]
    ]


def _ended(summary: Mapping[str, Any], options: Mapping[str, Any]) -> str:
    """Why a run ended, with the planner's confidence where it has one."""
    confidence, n = summary.get("confidence"), summary.get("n_sensings")
    actions = "" if n is None else _actions(n)
    sure = "" if confidence is None else f"the planner was {confidence:.1%} sure that {_claim(options)}"
    also = f"; {sure}" if sure else ""
    if confidence == 0.0 and options["planner"] == OUTLINING_PLANNER:
        also = "; the planner had something left to outline, so that its confidence was still 0"
    match summary.get("ended_by"):
        case "steps":
            return f"It ended after {actions}, as many as were asked for{also}."
        case "sensed":
            goal = float(options["until_sensed"])
            return f"It ended after {actions}, with the {goal:.0%} sensed at which it was to stop{also}."
        case "confident":
            goal = float(options["until_confident"])
            return f"It ended after {actions}, because {sure}; it was to stop at {goal:.0%}."
        case "not_worth":
            return (
                f"It ended after {actions}, because nothing was left to outline and the search's next actions were not "
                f"worth what they would find, with a missed lesion worth {float(options['miss_cost']):g} actions{also}."
            )
        case "no_pose_left":
            return f"It ended after {actions}, because no pose was left that could be taken{also}."
    return ""


def times_the_least(summary: Mapping[str, Any]) -> float | None:
    """How many times the fewest actions in hindsight a run took until 95 % was sensed; None where that is not known.

    Args:
        summary: What summary.json holds; its `limit` is what `sim.bound.limit` kept.
    """
    least, needed = summary.get("limit", {}).get("in_hindsight"), summary.get("sensings_to_95")
    return needed / least if least and needed else None


def _limit(summary: Mapping[str, Any]) -> str:
    """The actions until 95 % was sensed beside the limit that summary.json keeps; empty where it keeps none."""
    if (limit := summary.get("limit")) is None:
        return ""
    needed, least, mean = summary.get("sensings_to_95"), limit["in_hindsight"], limit["least_mean"]
    text = f"95 % of the tumours was {'not sensed' if needed is None else f'sensed after {_actions(needed)}'}"
    if least is not None:
        times = (
            "" if (ratio := times_the_least(summary)) is None else f", {ratio:.1f} times the least possible"
        )
        text += f"{times}: with the truth known, {_actions(least)} would have been enough."
    elif limit["is_possible"] is False:
        text += ": no poses are enough for that, however many."
    else:
        text += "; the least possible for this seed is not known."
    if mean is not None:
        text += f" Not knowing the truth, no planner needs fewer than {mean:.2f} in the mean over seeds."
    return text


def _actions(n: int) -> str:
    return f"{n} action{'' if n == 1 else 's'}"


def _left(summary: Mapping[str, Any]) -> str:
    """How many lesions the planner expects to be left, within reach and beyond; empty where it was not asked."""
    if "unseeable_share" not in summary:
        return ""
    n_counted = summary["n_lesions_counted"]
    return (
        f"It counts {n_counted} lesion{'' if n_counted == 1 else 's'} that a reading met, and expects "
        f"{summary['lesions_left_expected']:.2f} more that some pose could find and "
        f"{summary['lesions_unseeable_expected']:.2f} that no pose could: of the places and sizes that a lesion may "
        f"have, {summary['unseeable_share']:.1%} are out of every pose's sight."
    )


def _place(summary: Mapping[str, Any]) -> str:
    """How well it is known where the organ lies; empty where it lies as planned."""
    if (error_m := summary.get("registration_error_m")) is None:
        return ""
    off = f"{error_m * 1e3:.1f} mm from where they lie"
    if summary["registration_within_share"] is None:
        text = f"The plan was believed, by which the tumours are {off}"
    else:
        expected_mm = 1e3 * summary["registration_deviation_m"]
        text = f"By the contacts the tumours are believed {off}, and the belief expects {expected_mm:.1f} mm"
    own = summary.get("auprc_own_frame")
    frames = (
        ""
        if own is None
        else f" In the frame of the probe alone, without the plan, the map's AUPRC is {own:.3f}."
    )
    return f"{text}.{frames}"


def _claim(options: Mapping[str, Any]) -> str:
    """What a planner's confidence is about."""
    radius_mm = options.get("sure_radius_mm")
    if options["planner"] != OUTLINING_PLANNER or radius_mm is None:
        return "nothing is left to find or outline"
    return f"no tumour of {float(radius_mm):g} mm radius or more is left to find where a cone can look, or to outline"
