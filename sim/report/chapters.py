"""The chapters of a run's page: its figures, charts and tables, from the record."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit

from mapping import average_precision, precision_recall_curve
from sim.episode.measures import SENSED_GOAL
from sim.findings.account import account, times_the_least
from sim.findings.findings import Findings
from sim.findings.tables import finding_summary
from sim.record.run_record import RunRecord

from .charts import curve_chart, progress_chart, reliability, reliability_chart
from .finding_rows import finding_rows
from .progress import progress

STATUS = {
    "finished": "",
    "interrupted": "This run was interrupted: the report shows what was done until then.",
    "stopped": "The arm stopped for safety: the report shows what was done until then.",
    "unfinished": "This run is unfinished, or its process was killed: the report shows what was done until then.",
}


def chapters(record: RunRecord, findings: Findings) -> dict[str, Any]:
    """What the template of a run's page shows, as plain values and SVG text."""
    told = account(record.summary, record.options, finding_summary(findings))
    return {
        "title": title(record),
        "lede": lede(record),
        "status": STATUS.get(str(record.manifest.get("status")), ""),
        "account": told,
        "notices": list(record.config.get("notices", ())),
        "figures": key_figures(record),
        "progress": progress([record]),
        "readings": readings(record),
        "quality": _quality(record),
        "classes": classes(record, findings),
        "arm": _arm(record),
        "skipped": _skipped(record),
        "space": _space(record),
        "settings": _settings(record),
        "command": command(record),
    }


def title(record: RunRecord) -> str:
    """The page's title: scenario and planner."""
    return f"{record.scenario['name']}, {record.options['planner']}"


def lede(record: RunRecord) -> str:
    """How much was done with what, by which version and when."""
    n, arm = record.n_steps, record.options["arm"]
    positioner = "a free-flying probe" if arm == "none" else f"the {arm} arm"
    probe = str(record.options.get("probe", "default"))
    if probe != "default":
        positioner += (
            f" and the probe of {Path(probe).name}" if arm != "none" else f", that of {Path(probe).name}"
        )
    day = str(record.manifest.get("started", ""))[:10]
    actions = "sensing action" if n == 1 else "sensing actions"
    commit = str(record.manifest.get("commit") or "")[:8]
    version = f"Sounding {record.manifest.get('sounding', '')}{f' ({commit})' if commit else ''}"
    return f"{n} {actions} with {positioner}, seed {record.options['seed']}. {version}, {day}."


def command(record: RunRecord) -> str:
    """The command that made the run."""
    return shlex.join(["sounding", *map(str, record.manifest.get("command", []))])


def key_figures(record: RunRecord) -> list[tuple[str, str]]:
    """The names and values of what a reader wants to know first."""
    sensed, auprc = record.numbers("sensed_fraction"), record.numbers("auprc")
    reached = np.flatnonzero(sensed >= SENSED_GOAL)
    figures = []
    confidence = record.summary.get("confidence")
    if confidence is not None:
        figures.append(("planner’s confidence", _share(float(confidence))))
    figures.append(("of the tumours sensed", _share(sensed[-1] if len(sensed) else math.nan)))
    if record.summary.get("visible_fraction") is not None:
        figures.append(("of the organ in some cone", _share(float(record.summary["visible_fraction"]))))
    figures.append(("actions to sense 95 %", str(reached[0] + 1) if len(reached) else "–"))
    figures += _limit_figures(record)
    if record.field is not None:
        figures.append(("AUPRC of the map", _number(auprc[-1] if len(auprc) else math.nan, 3)))
    duration_s = float(np.nansum(record.numbers("procedure_s")))
    figures.append(("modelled procedure", f"{int(duration_s // 60)} min {duration_s % 60:.0f} s"))
    if record.options["arm"] != "none":
        figures.append(("poses not reachable", str(len(record.skipped))))
    return figures


def _limit_figures(record: RunRecord) -> list[tuple[str, str]]:
    """The least possible actions and how many times that the run took, where summary.json keeps a limit."""
    limit = record.summary.get("limit", {})
    if limit.get("in_hindsight") is not None:
        ratio = times_the_least(record.summary)
        times = "–" if ratio is None else f"{ratio:.1f} ×"
        return [
            ("times the least possible", times),
            ("least possible, in hindsight", str(limit["in_hindsight"])),
        ]
    mean = limit.get("least_mean")
    return [] if mean is None else [("least mean of any planner", f"{mean:.2f}")]


def classes(record: RunRecord, findings: Findings) -> list[dict[str, Any]]:
    """The findings of the tumours, and of a second class where one was mapped."""
    classes = [finding_rows(findings)]
    if findings.target is not None and record.target is not None:
        classes.append(finding_rows(findings.target, name=record.target.anatomy.name))
    return classes


def readings(record: RunRecord) -> list[dict[str, str]]:
    """What stands beside the slider at each action; the first item is for the time before any action."""
    told: list[dict[str, str]] = [{}]
    name = "" if record.target is None else record.target.anatomy.name
    for row in record.steps:
        read = f"{row['n_points']}, {row['n_occupied']} of them tumour"
        if name:
            read += f", {row.get('n_target') or '–'} {name}"
        told.append({"Pose": row["pose_index"], "Points read": read})
    return told


def _quality(record: RunRecord) -> dict[str, Any] | None:
    """The precision-recall curve and the reliability of the last map; None without a map or without tumours."""
    field = record.field
    if field is None or not field.is_tumour[field.is_inside].any():
        return None
    score, truth = field.log_odds[field.is_inside], field.is_tumour[field.is_inside]
    curve = precision_recall_curve(score, truth)
    prevalence = float(truth.mean())
    predicted, observed, counts = reliability(expit(score), truth)
    return {
        "auprc": f"{average_precision(score, truth):.3f}",
        "precision_recall": curve_chart(
            curve.recall,
            curve.precision,
            colour="map",
            label="Precision against recall of the last map",
            level=prevalence,
            level_text=f"uninformed map: {prevalence:.2g}",
        ),
        "reliability": reliability_chart(
            predicted, observed, counts, label="Observed share of tumour against predicted probability"
        ),
        "rows": _quality_rows(record),
    }


def _quality_rows(record: RunRecord) -> list[tuple[str, str]]:
    names = (
        ("Points scored, inside the organ", "n_points", "{:,}"),
        ("of them tumour", "n_occupied", "{:,}"),
        ("Dice at probability 0.5", "dice", "{:.3f}"),
        ("Brier score", "brier_score", "{:.4f}"),
        ("Log loss", "log_loss", "{:.4f}"),
        ("Calibration error", "expected_calibration_error", "{:.4f}"),
    )
    return [(label, form.format(record.summary[key])) for label, key, form in names
            if record.summary.get(key) is not None]  # fmt: skip


def _arm(record: RunRecord) -> dict[str, Any] | None:
    """The errors of the arm at the sensing poses; None for a free-flying probe."""
    if record.options["arm"] == "none" or not record.steps:
        return None
    series = [
        ("Position error [mm]", record.numbers("position_error_m") * 1e3, "position"),
        ("Angle error [°]", np.rad2deg(record.numbers("angle_error_rad")), "angle"),
        ("Tracking error [mm]", record.numbers("tracking_error_m") * 1e3, "tracking"),
        ("Contact force [N]", record.numbers("contact_force_n"), "force"),
        ("Force beside the one wanted [N]", np.abs(record.numbers("force_error_n")), "force-error"),
        ("Motion to the pose [s]", record.numbers("motion_s"), "motion"),
        ("Force error while sliding [N]", record.numbers("slide_force_error_n"), "slide-force"),
        ("Time farther than 20 % from the force [%]", 1e2 * (1.0 - record.numbers("force_in_band")), "band"),
        ("Slip beside the way [mm]", record.numbers("slide_slip_m") * 1e3, "slip"),
        ("Lag along the way [mm]", record.numbers("slide_lag_m") * 1e3, "lag"),
    ]
    kept = [each for each in series if np.isfinite(each[1]).any()]
    return {
        "rows": [(t, _brief(np.nanmedian(v)), _brief(np.nanmax(v))) for t, v, _ in kept],
        "charts": [
            {"name": name, "title": t,
             "svg": progress_chart(name, [values], colours=["ink"], label=t, digits=4, has_dots=True)}
            for t, values, name in kept
        ],
    }  # fmt: skip


def _skipped(record: RunRecord) -> dict[str, Any]:
    """The poses that could not be taken: how many for each reason, and all of them."""
    reasons = Counter(_kind_of(row["reason"]) for row in record.skipped)
    return {
        "reasons": reasons.most_common(),
        "rows": [(row["step"], row["pose_index"], row["reason"]) for row in record.skipped],
    }


def _kind_of(reason: str) -> str:
    """The first sentence of a reason."""
    return reason.split(". ")[0].split("; ")[0].strip().rstrip(".")


def _space(record: RunRecord) -> dict[str, Any]:
    """Where things are relative to each other, in millimetres."""
    low_m, high_m = record.anatomy.organ.bounds_m
    T = record.T_world_organ
    axes = {0: "x", 1: "y", 2: "z"}
    is_turned = not np.allclose(T[:3, :3], np.eye(3))
    base_mm = record.options.get("base_mm", [0, 0, 0])
    return {
        "extent": " × ".join(f"{v:.0f}" for v in (high_m - low_m) * 1e3),
        "centre": ", ".join(f"{v:.0f}" for v in (low_m + high_m) / 2 * 1e3),
        "base": None if record.options["arm"] == "none" else ", ".join(f"{v:.0f}" for v in base_mm),
        "origin": ", ".join(f"{v:.1f}" for v in T[:3, 3] * 1e3),
        "matrix": [[f"{value:.4f}" for value in row] for row in T],
        "axes": [
            (f"+{axes[i]}", ", ".join(f"{v:+.2f}" for v in T[:3, i])) for i in range(3)
        ],
        "is_turned": is_turned,
        "cone": f"{np.rad2deg(record.cone.half_angle_rad):.1f}° × {record.cone.depth_m * 1e3:.0f} mm",
    }  # fmt: skip


def _settings(record: RunRecord) -> list[dict[str, Any]]:
    """Everything that is needed to repeat the run, in groups."""
    machine = {k: v for k, v in record.manifest.items() if k not in ("packages", "command", "files")}
    packages = record.manifest.get("packages", {})
    groups = [("Options", record.options), ("Scenario", record.scenario), ("Map", record.config.get("map", {})),
              ("Machine", machine), ("Packages", packages)]  # fmt: skip
    return [{"title": t, "rows": [(k, _plain(v)) for k, v in values.items()]} for t, values in groups]


def _plain(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_plain, value)) or "–"
    return str(value)


def _share(value: float) -> str:
    return f"{value:.1%}" if math.isfinite(value) else "–"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _brief(value: float) -> str:
    return f"{value:.3g}"
