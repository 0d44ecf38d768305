"""Several arms on one workspace, in one table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from sim.episode.scenario import Scenario
from sim.notices import Notify, print_notice
from sim.record.ownership import check_out_folder
from sim.record.run_folder import RunFolder
from sim.tables import markdown_table, write_csv
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.named_arms import NAMED_ARMS

from .base_grid import Stand
from .figures import draw_arms
from .study import ArmStudy, StudySettings, study_arm
from .tables import check_parquet
from .workcell import build_workcell

COLUMNS = {
    "arm": "arm",
    "n_joints": "joints",
    "reached_fraction": "reached",
    "best_reached_fraction": "reached from its best base",
    "largest_region_fraction": "largest region",
    "score_median": "score, median",
    "clearance_m_p10": "clearance, 10th percentile [mm]",
    "joint_limit_distance_rad_p10": "room to limits, 10th percentile [deg]",
    "manipulability_median": "manipulability, median [m³]",
    "main_reason": "why not, mostly",
    "poses_per_s": "poses a second",
}
"""Columns of the table of arms: their names in arms.csv, and in arms.md and the terminal."""


def compare_arms(
    scenario: Scenario,
    arms: Mapping[str, ArmModel],
    out: Path | str,
    settings: StudySettings | None = None,
    *,
    probe: ProbeModel = EMBEDDED,
    notify: Notify = print_notice,
) -> dict[str, Any]:
    """Study several arms on one workspace, each into a folder of its own, and return the summary with their table.

    Args:
        scenario: Gives the organ and its workspace.
        arms: The arms where they stand, by the names of their folders.
        out: The folder that holds these folders.
        settings: How each arm is studied.
        probe: The probe that each of them carries.
        notify: Tells a notice; by default on stderr.

    Raises:
        UsageError, WorldError: Something cannot be done, and nothing was written.
    """
    start_s, out = perf_counter(), Path(out)
    settings = settings or StudySettings()
    for folder in (out, *(out / name for name in arms)):
        check_out_folder(folder, overwrite=settings.overwrite)
    if settings.writes_parquet:
        check_parquet()
    with threadpool_limits(limits=1):
        first, *others = arms.values()
        workcell = build_workcell(scenario, first, probe)
        workcells = [workcell, *(workcell.with_arm(arm) for arm in others)]
        with RunFolder(out, overwrite=settings.overwrite) as folder:
            folder.begin({"options": dict(settings.options)}, {"seed": settings.seed})
            studies = [
                study_arm(workcell, settings, name, out / name, notify)
                for workcell, name in zip(workcells, arms, strict=True)
            ]
            rows = [comparison_row(study) for study in studies]
            write_csv(folder.path / "arms.csv", rows)
            folder.write_text("arms.md", arms_table(rows))
            draw_arms(out / "arms.png", [(s.name, s.workcell, s.study) for s in studies])
            summary = {
                "scenario": scenario.name,
                "arms": [study.summary for study in studies],
                "folder": str(out),
                "status": "finished",
                "wall_s": perf_counter() - start_s,
            }
            folder.write_json("summary.json", summary)
            folder.finish("finished")
    return summary | {"table": arms_table(rows)}


def folder_names(arms: Sequence[str]) -> list[str]:
    """A name for each arm, none twice: its own, or that of its file, with its folder's where two have one name."""
    names: list[str] = []
    stems = [arm if arm in NAMED_ARMS else Path(arm).stem for arm in arms]
    for arm, stem in zip(arms, stems, strict=True):
        if stems.count(stem) > 1 and arm not in NAMED_ARMS:
            stem = f"{Path(arm).absolute().parent.name}-{stem}".lstrip("-")
        taken = sum(name == stem or name.startswith(f"{stem}-") for name in names)
        names.append(f"{stem}-{taken + 1}" if taken else stem)
    return names


def comparison_row(study: ArmStudy) -> dict[str, Any]:
    """The row of an arm: the values of `COLUMNS`, and its best base where one was searched."""
    summary = study.summary
    found: Mapping[str, Any] = summary.get("base_search", {})
    row = {name: summary.get(name, found.get(name)) for name in COLUMNS}
    missed = [name for name in summary["reasons"] if name != "reached"]
    row["main_reason"] = missed[0].replace("_", " ") if missed else ""
    best = found.get("best_base")
    return row | {"best_base": "" if best is None else Stand.from_millimetres(best).label}


def arms_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows as a Markdown table; columns that no arm has a value in are left out."""
    names = [name for name in COLUMNS if any(row[name] not in (None, "") for row in rows)]
    cells = [[_cell(name, row[name]) for name in names] for row in rows]
    table = markdown_table([COLUMNS[name] for name in names], cells)
    bases = [f"{row['arm']}: {row['best_base']}" for row in rows if row["best_base"]]
    tail = "\n\nBest bases:\n\n" + "\n".join(f"- {base}" for base in bases) if bases else ""
    return table + tail + "\n"


def _cell(name: str, value: Any) -> str:
    if value is None or value == "":
        return "–"
    if isinstance(value, str):
        return value
    if name.endswith("_fraction"):
        return f"{value:.1%}"
    if name.startswith("clearance_m"):
        return f"{value * 1e3:.0f}"
    if name.startswith("joint_limit"):
        return f"{math.degrees(value):.0f}"
    return f"{value:.0f}" if name in ("poses_per_s", "n_joints") else f"{value:.3g}"
