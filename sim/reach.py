"""The program behind `sounding reach`: a reachability study with its folder, tables and figures."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .arms import arm_named
from .arm_options import ReachOptions
from .errors import UsageError
from .reach_figures import draw_reach, draw_reasons
from .reachability import ReachStudy, study_reach
from .recording import RunFolder, check_out_folder
from .theatre import Theatre, build_theatre
from .world.chain import Chain
from .world.ik_settings import IkSettings


def run_reach(options: ReachOptions) -> dict[str, Any]:
    """Run a study and write its folder; returns the summary.

    Raises:
        UsageError, WorldError: Something asked for cannot be done; nothing was written then.
    """
    start_s = perf_counter()
    scenario, arm = options.make_scenario(), arm_named(options.arm, options.flange)
    out = options.out_folder(scenario)
    check_out_folder(out, overwrite=options.overwrite)
    if options.parquet:
        _parquet_writer()
    with threadpool_limits(limits=1):  # two BLAS pools on two threads fight
        theatre = build_theatre(scenario, arm)
        search = theatre.make_search(IkSettings(max_restarts=options.restarts, start_seed=options.seed))
        with RunFolder(out, overwrite=options.overwrite) as folder:
            folder.begin(_config(options, theatre), {"seed": options.seed})
            for notice in theatre.notices:
                print(f"note: {notice}", file=sys.stderr)
            study = study_reach(
                search,
                theatre.workspace,
                max_tilt_rad=np.deg2rad(options.tilt_deg),
                n_jobs=options.jobs,
                show_progress=True,
            )
            if not study.is_reached.any():
                print(f"note: {_far_organ(theatre)}", file=sys.stderr)
            rows = study_rows(study, theatre, search.chain)
            for row in rows:
                folder.append_row("reach.csv", row)
            if options.parquet:
                _write_parquet(out / "reach.parquet", rows)
            draw_reach(out / "reach.png", theatre.placed.organ, theatre.workspace, study)
            draw_reasons(out / "reasons.png", study)
            summary = _summary(options, scenario.name, study)
            summary |= {"folder": str(out), "status": "finished", "wall_s": perf_counter() - start_s}
            folder.write_json("summary.json", summary)
            folder.finish("finished")
    return summary


def study_rows(study: ReachStudy, theatre: Theatre, chain: Chain) -> list[dict[str, Any]]:
    """The table of a study: one row per pose, empty cells where there is no value."""
    workspace, rows = theatre.workspace, []
    joints = [
        f"{name}_{'m' if is_slide else 'rad'}"
        for name, is_slide in zip(chain.names, chain.is_slide, strict=True)
    ]
    for pose, result in enumerate(study.results):
        q = result.q[chain.columns] if result.is_reached else np.full(chain.n_joints, np.nan)
        row = {
            "pose_index": pose,
            **{f"position_{axis}_m": workspace.positions_m[pose, i] for i, axis in enumerate("xyz")},
            **{f"normal_{axis}": workspace.normals[pose, i] for i, axis in enumerate("xyz")},
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
        rows.append({key: None if _is_nan(value) else value for key, value in row.items()})
    return rows


def _far_organ(theatre: Theatre) -> str:
    """Where the organ lies and how large it is, for a study that reaches nothing."""
    low_m, high_m = theatre.placed.organ.bounds_m
    away_m, size_m = float(np.linalg.norm((low_m + high_m) / 2.0)), float((high_m - low_m).max())
    return (
        f"no pose is reached. The organ's middle is {away_m:.2f} m from the world's origin, where the arm's base is, "
        f"and the organ is {size_m * 1e3:.0f} mm long; is its place in metres and its --unit right?"
    )


def _is_nan(value: Any) -> bool:
    return isinstance(value, float | np.floating) and bool(np.isnan(value))


def _config(options: ReachOptions, theatre: Theatre) -> dict[str, Any]:
    return {
        "options": dataclasses.asdict(options),
        "scenario": dataclasses.asdict(theatre.scenario),
        "T_world_organ": theatre.placed.T_world_organ,
        "n_poses": theatre.workspace.n_poses,
    }


def _summary(options: ReachOptions, scenario: str, study: ReachStudy) -> dict[str, Any]:
    n_poses, reached = len(study.results), study.is_reached
    sizes = np.bincount(study.region[reached]) if reached.any() else np.zeros(0, dtype=np.int64)
    with_tilt = {}
    for tilt_rad in sorted({float(tilt) for tilt in study.tilt_rad if not np.isnan(tilt)} - {0.0}):
        with_tilt[f"{np.rad2deg(tilt_rad):g}"] = float(np.mean(study.tilt_rad <= tilt_rad))
    return {
        "scenario": scenario,
        "arm": options.arm,
        "seed": options.seed,
        "jobs": options.jobs,
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


def _parquet_writer() -> Any:
    """The module that writes Parquet.

    Raises:
        UsageError: It is not installed.
    """
    try:
        import pyarrow.parquet as parquet  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise UsageError("--parquet needs pyarrow: pip install pyarrow.") from error
    return parquet


def _write_parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    parquet = _parquet_writer()
    import pyarrow  # pyright: ignore[reportMissingImports]  # an extra

    parquet.write_table(pyarrow.Table.from_pylist(rows), path)
