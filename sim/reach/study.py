"""The program behind `sounding reach`: a reachability study with its folder, tables and figures."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from sim.cli.arm_options import ReachOptions
from sim.record.locked_folder import check_out_folder
from sim.record.run_folder import RunFolder
from sim.world.ik.result import IkStatus
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.scene.arm import ArmModel
from sim.world.scene.named_arms import named_arm

from .base_figures import draw_bases
from .base_search import BaseQuestion, BaseSearch, search_base
from .figures import draw_reach, draw_reasons
from .reachability import ReachStudy, reached_fraction, study_reach
from .tables import base_rows, base_summary, check_parquet, study_rows, study_summary, write_parquet
from .workcell import Workcell, build_workcell

N_FINALISTS = 3
"""The best bases of a search that are asked for the whole workspace."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmStudy:
    """What was found of one arm, for those who compare."""

    name: str
    workcell: Workcell
    study: ReachStudy
    summary: dict[str, Any]


def run_reach(options: ReachOptions) -> dict[str, Any]:
    """Run a study of an arm and write its folder; returns the summary.

    Raises:
        UsageError, WorldError: Something asked for cannot be done; nothing was written then.
    """
    scenario = options.make_scenario()
    out = options.out_folder(scenario)
    check_out_folder(out, overwrite=options.overwrite)
    if options.parquet:
        check_parquet()
    arm = arm_of(options, 0)
    with threadpool_limits(limits=1):  # two BLAS pools on two threads fight
        return study_arm(build_workcell(scenario, arm), options, options.arm[0], out).summary


def arm_of(options: ReachOptions, index: int) -> ArmModel:
    """One of the arms that the options name."""
    x_mm, y_mm, z_mm = options.base_mm
    base_m, yaw_rad = (x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3), math.radians(options.base_yaw_deg)
    return named_arm(options.arm[index], options.flange_of(index), base_m=base_m, base_yaw_rad=yaw_rad)


def study_arm(workcell: Workcell, options: ReachOptions, name: str, out: Path) -> ArmStudy:
    """Study the arm of a workcell and write the folder of it."""
    start_s = perf_counter()
    search = workcell.make_search(IkSettings(max_restarts=options.restarts, start_seed=options.seed))
    with RunFolder(out, overwrite=options.overwrite) as folder:
        folder.begin(_config(options, workcell), {"seed": options.seed})
        for notice in workcell.notices:
            print(f"note: {notice}", file=sys.stderr)
        study = study_reach(
            search,
            workcell.workspace,
            max_tilt_rad=np.deg2rad(options.tilt_deg),
            n_jobs=options.jobs,
            show_progress=True,
        )
        if not study.is_reached.any():
            print(f"note: no pose is reached. {_why_nothing(workcell, study)}", file=sys.stderr)
        _write_study(study, workcell, search, options, folder)
        summary = _summary(study, workcell, search, options, name)
        if options.base_search:
            summary["base_search"] = _search_base(
                workcell, search, options, folder, float(study.is_reached.mean())
            )
        summary |= {"folder": str(out), "status": "finished", "wall_s": perf_counter() - start_s}
        folder.write_json("summary.json", summary)
        folder.finish("finished")
    return ArmStudy(name, workcell, study, summary)


def _write_study(
    study: ReachStudy, workcell: Workcell, search: IkSearch, options: ReachOptions, folder: RunFolder
) -> None:
    """Write the study's tables and figures."""
    rows = study_rows(study, workcell, search.chain)
    for row in rows:
        folder.append_row("reach.csv", row)
    if options.parquet:
        write_parquet(folder.path / "reach.parquet", rows)
    draw_reach(folder.path / "reach.png", workcell.placed.organ, workcell.workspace, study)
    draw_reasons(folder.path / "reasons.png", study)


def _summary(
    study: ReachStudy, workcell: Workcell, search: IkSearch, options: ReachOptions, name: str
) -> dict[str, Any]:
    return {
        "scenario": workcell.scenario.name,
        "arm": name,
        "seed": options.seed,
        "jobs": options.jobs,
        "n_joints": search.chain.n_joints,
        "base_mm": list(options.base_mm),
        "base_yaw_deg": options.base_yaw_deg,
        **study_summary(study),
    }


def _search_base(
    workcell: Workcell, search: IkSearch, options: ReachOptions, folder: RunFolder, present_fraction: float
) -> dict[str, Any]:
    """Search the best place of the base, write its table and map, and ask that place for the whole workspace."""
    low_mm, high_mm = options.base_height_mm
    question = BaseQuestion(
        n_bases=options.base_search,
        n_poses=options.base_poses,
        height_m=(low_mm * 1e-3, high_mm * 1e-3),
        objective=options.base_objective,
        seed=options.seed,
        n_jobs=options.jobs,
    )
    with tqdm(total=options.base_search, desc="bases", unit="base") as progress:
        found: BaseSearch = search_base(workcell, search, question, on_progress=progress.update)
    found, best_reached_fraction = _decided(found, question, workcell, search, present_fraction)
    for row in base_rows(found):
        folder.append_row("bases.csv", row)
    draw_bases(folder.path / "bases.png", workcell, found, question)
    return {"objective": options.base_objective} | base_summary(
        found, best_reached_fraction=best_reached_fraction
    )


def _decided(
    found: BaseSearch, question: BaseQuestion, workcell: Workcell, search: IkSearch, present_fraction: float
) -> tuple[BaseSearch, float]:
    """The search with its best base decided by the whole workspace, and the share that is reached from there.

    What a sample of the poses cannot tell apart is asked again with a study's effort: the best few. The present base
    counts as the study found it. Where the objective is what is seen, the sample's best stands.
    """
    present = found.candidates[0]
    n_asked = N_FINALISTS if question.objective == "poses" else 1
    finalists = sorted(found.asked, key=question.merit, reverse=True)[:n_asked]
    shares = {present: present_fraction} if question.objective == "poses" or present in finalists else {}
    for candidate in finalists:
        if candidate is not present:
            at_base = search.at_base(candidate.stand.T_world_base).with_new_starts()
            shares[candidate] = reached_fraction(at_base, workcell.workspace, n_jobs=question.n_jobs)
    best = max(shares, key=lambda candidate: shares[candidate])
    return dataclasses.replace(found, best=best), shares[best]


def _why_nothing(workcell: Workcell, study: ReachStudy) -> str:
    """Of a study that reaches nothing: where the organ lies and how large it is, or what stands in the way."""
    if next(iter(study.reasons())) != IkStatus.TOO_FAR.name.lower():
        details = [result.detail for result in study.results]
        return f"For example: {max(details, key=details.count)}"
    low_m, high_m = workcell.placed.organ.bounds_m
    away_m = float(np.linalg.norm((low_m + high_m) / 2.0 - workcell.scene.T_world_base[:3, 3]))
    size_m = float((high_m - low_m).max())
    return (
        f"The organ's middle is {away_m:.2f} m from the arm's base, and the organ is {size_m * 1e3:.0f} mm long; "
        "is its place in metres and its --unit right?"
    )


def _config(options: ReachOptions, workcell: Workcell) -> dict[str, Any]:
    return {
        "options": dataclasses.asdict(options),
        "scenario": dataclasses.asdict(workcell.scenario),
        "T_world_organ": workcell.placed.T_world_organ,
        "T_world_base": workcell.scene.T_world_base,
        "n_poses": workcell.workspace.n_poses,
    }
