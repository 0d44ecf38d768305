"""The tables of a reachability study: its rows, its bases, its summary, and Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mapping.storage import replacing
from sim.record.step_files import place_of
from sim.world.ik.chain import Chain
from sim.world.optional import optional_module

from .base_search import BaseSearch
from .reachability import ReachStudy
from .workcell import Workcell

Row = dict[str, Any]


def study_rows(study: ReachStudy, workcell: Workcell, chain: Chain) -> list[Row]:
    """The table of a study: one row per pose, with None where there is no value."""
    workspace, rows = workcell.workspace, []
    joints = [
        f"{name}_{'m' if is_slide else 'rad'}"
        for name, is_slide in zip(chain.names, chain.is_slide, strict=True)
    ]
    for pose, result in enumerate(study.results):
        q = result.q[chain.columns] if result.is_reached else np.full(chain.n_joints, np.nan)
        row = {
            "pose_index": pose,
            **place_of(workspace, pose),
            "is_reached": result.is_reached,
            "reason": result.status.name.lower(),
            "detail": result.detail,
            "position_error_m": result.position_error_m,
            "angle_error_rad": result.angle_error_rad,
            "manipulability": study.manipulability[pose],
            "joint_limit_distance_rad": study.limit_room[pose],
            "clearance_m": study.clearance_m[pose],
            "score": study.score[pose],
            "n_solutions": int(study.n_solutions[pose]),
            "region": int(study.region[pose]) if result.is_reached else None,
            "tilt_rad": study.tilt_rad[pose],
            "n_restarts": result.n_restarts,
            **dict(zip(joints, q, strict=True)),
        }
        rows.append(_without_nan(row))
    return rows


def base_rows(found: BaseSearch) -> list[Row]:
    """The table of a search for a base: one row per candidate, also for those without room, which were not tried."""
    rows = []
    for index, candidate in enumerate(found.candidates):
        row = {
            "base_index": index,
            **candidate.stand._asdict(),
            "stage": candidate.stage,
            "reached_fraction": candidate.reached_fraction,
            "seen_fraction": candidate.seen_fraction,
            "mean_score": candidate.mean_score,
            "obstacle": candidate.obstacle,
        }
        rows.append(_without_nan(row))
    return rows


def study_summary(study: ReachStudy) -> Row:
    """A study in numbers."""
    n_poses, reached = len(study.results), study.is_reached
    sizes = np.bincount(study.region[reached]) if reached.any() else np.zeros(0, dtype=np.int64)
    with_tilt = {}
    for tilt_rad in sorted({float(tilt) for tilt in study.tilt_rad if not np.isnan(tilt)} - {0.0}):
        with_tilt[f"{np.rad2deg(tilt_rad):g}"] = float(np.mean(study.tilt_rad <= tilt_rad))
    return {
        "n_poses": n_poses,
        "n_reached": int(reached.sum()),
        "reached_fraction": float(reached.mean()),
        "reached_fraction_by_tilt_deg": with_tilt,
        "reasons": study.reasons(),
        "n_regions": len(sizes),
        "largest_region_fraction": float(sizes.max(initial=0) / n_poses),
        **{
            f"{name}_{label}": float(np.percentile(values[reached], share)) if reached.any() else None
            for name, values in (
                ("score", study.score),
                ("clearance_m", study.clearance_m),
                ("joint_limit_distance_rad", study.limit_room),
                ("manipulability", study.manipulability),
            )
            for label, share in (("p10", 10), ("median", 50))
        },
        "poses_per_s": n_poses / study.search_s,
        "search_s": study.search_s,
    }


def base_summary(found: BaseSearch, *, best_reached_fraction: float) -> Row:
    """A search for a base in numbers.

    Args:
        found: The search.
        best_reached_fraction: Share of the whole workspace that the best base reaches, with a study's effort.
    """
    present, best = found.candidates[0], found.best
    return {
        "n_bases": len(found.asked),
        "n_blocked": len(found.candidates) - len(found.asked),
        "n_poses": found.n_poses,
        "best_base": best.stand.in_millimetres(),
        "best_stage": best.stage,
        **{f"best_{name}": value for name, value in best.stand._asdict().items()},
        "best_reached_fraction": best_reached_fraction,
        **{
            f"{name}_{measure}_by_sample": getattr(candidate, measure)
            for name, candidate in (("best", best), ("present", present))
            for measure in ("reached_fraction", "seen_fraction", "mean_score")
        },
        "search_s": found.search_s,
    }


def check_parquet() -> None:
    """Check that Parquet can be written.

    Raises:
        MissingPackageError: The package for it is not installed.
    """
    _parquet_modules()


def write_parquet(path: Path, rows: list[Row]) -> None:
    """Write rows as Parquet at once: a reader sees the whole file or none."""
    pyarrow, parquet = _parquet_modules()
    table = pyarrow.Table.from_pylist([_with_python_values(row) for row in rows])
    kinds = [
        field.with_type(pyarrow.float64()) if field.type == pyarrow.null() else field
        for field in table.schema
    ]
    with replacing(path) as file:
        parquet.write_table(table.cast(pyarrow.schema(kinds)), file)


def _parquet_modules() -> tuple[Any, Any]:
    names = ("pyarrow", "pyarrow.parquet")
    pyarrow, parquet = (optional_module(name, "parquet", "`parquet`") for name in names)
    return pyarrow, parquet


def _with_python_values(row: Row) -> Row:
    """A row whose numbers and booleans are Python's own, from which pyarrow can infer the columns' types."""
    return {key: value.item() if isinstance(value, np.generic) else value for key, value in row.items()}


def _without_nan(row: Row) -> Row:
    return {
        key: None if isinstance(value, float | np.floating) and np.isnan(value) else value
        for key, value in row.items()
    }
