"""A reachability study of an arm, with its folder, tables and figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from sim.episode.scenario import Scenario
from sim.episode.scenario_file import load_scenario, scenario_record
from sim.notices import Notify, print_notice
from sim.record.ownership import check_out_folder
from sim.record.run_folder import RunFolder
from sim.world.ik.result import IkStatus
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.probes.probe import EMBEDDED, ProbeModel, named_probe
from sim.world.scene.arm import ArmModel
from sim.world.scene.base_room import BaseRoom
from sim.world.scene.named_arms import named_arm

from .base_figures import draw_bases
from .base_grid import Stand
from .base_search import BaseQuestion, BaseSearch, search_base
from .figures import draw_reach, draw_reasons
from .reachability import ReachStudy, reached_fraction, study_reach
from .tables import base_rows, base_summary, check_parquet, study_rows, study_summary, write_parquet
from .workcell import Workcell, build_workcell

N_FINALISTS = 3
"""Number of the best bases of a search that are tried on the whole workspace."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmStudy:
    """What a study found about one arm, for a comparison of arms."""

    name: str
    workcell: Workcell
    study: ReachStudy
    summary: dict[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudySettings:
    """How an arm is studied."""

    max_tilt_rad: float = 0.0
    """Poses that are not reached are tried again with the beam tilted off the normal by up to this [rad]."""
    max_restarts: int = 40
    """Starts after the first before a pose is called unreachable."""
    standoff_m: float = IkSettings.standoff_m
    """Each pose has to be reached from this far above it too [m]; 0 leaves that out."""
    padding_m: float = 0.0
    """Room that arm and probe keep from the table, and the arm from itself and beyond its 3 mm from the organ [m]."""
    seed: int = 0
    """Seed of the set of starts, and of the search for a base."""
    n_jobs: int = 2
    """Processes that share the poses; the answers do not depend on it."""
    base: BaseQuestion | None = None
    """How to search the best place of the base; None for no search."""
    writes_parquet: bool = False
    """Whether reach.parquet is written beside reach.csv."""
    overwrite: bool = False
    """Whether a study that the folder already holds is replaced."""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """The options that config.json keeps, as plain data."""


def reach_study(
    scenario: Scenario | str,
    arm: ArmModel | str,
    out: Path | str,
    settings: StudySettings | None = None,
    *,
    probe: ProbeModel | str = EMBEDDED,
    name: str | None = None,
    notify: Notify = print_notice,
    **changes: Any,
) -> dict[str, Any]:
    """Study which sensing poses of a scenario an arm reaches, write the study's folder, and return its summary.

    Args:
        scenario: The scenario, its name, or the path of its file.
        arm: The arm where it stands, its name, or the path of its file.
        out: The folder.
        settings: How the arm is studied.
        probe: The probe that it carries, or the path of its file; by default the embedded one.
        name: What to call the arm; by default its own name, or that of its file.
        notify: Tells a notice; by default on stderr.
        changes: Fields of `StudySettings` by name, in place of those of `settings`.

    Raises:
        UsageError, WorldError: Something cannot be done, and nothing was written.
    """
    settings = dataclasses.replace(settings or StudySettings(), **changes)
    check_out_folder(Path(out), overwrite=settings.overwrite)
    if settings.writes_parquet:
        check_parquet()
    scenario = load_scenario(scenario) if isinstance(scenario, str) else scenario
    model = named_arm(arm) if isinstance(arm, str) else arm
    carried = named_probe(probe) if isinstance(probe, str) else probe
    called = name or (arm if isinstance(arm, str) else model.path.stem)
    # BLAS pools of several processes would slow each other down.
    with threadpool_limits(limits=1):
        return study_arm(
            build_workcell(scenario, model, carried), settings, called, Path(out), notify
        ).summary


def study_arm(
    workcell: Workcell, settings: StudySettings, name: str, out: Path, notify: Notify = print_notice
) -> ArmStudy:
    """Study the arm of a workcell, write the study's folder, and return the study."""
    start_s = perf_counter()
    search = workcell.make_search(
        IkSettings(
            max_restarts=settings.max_restarts,
            start_seed=settings.seed,
            standoff_m=settings.standoff_m,
            padding_m=settings.padding_m,
        )
    )
    with RunFolder(out, overwrite=settings.overwrite) as folder:
        folder.begin(
            _config(settings, workcell) | {"notices": list(workcell.notices)}, {"seed": settings.seed}
        )
        for notice in workcell.notices:
            notify(notice)
        study = study_reach(
            search,
            workcell.workspace,
            max_tilt_rad=settings.max_tilt_rad,
            n_jobs=settings.n_jobs,
            show_progress=True,
        )
        if not study.is_reached.any():
            notify(f"no pose is reached. {_why_nothing(workcell, study)}")
        _write_study(study, workcell, search, folder, writes_parquet=settings.writes_parquet)
        summary = _summary(study, workcell, search, settings, name)
        if settings.base is not None:
            present_fraction = float(study.is_reached.mean())
            summary["base_search"] = _search_base(workcell, search, settings.base, folder, present_fraction)
        summary |= {"folder": str(out), "status": "finished", "wall_s": perf_counter() - start_s}
        folder.write_json("summary.json", summary)
        folder.finish("finished")
    return ArmStudy(name, workcell, study, summary)


def _write_study(
    study: ReachStudy, workcell: Workcell, search: IkSearch, folder: RunFolder, *, writes_parquet: bool
) -> None:
    """Write the study's tables and figures."""
    rows = study_rows(study, workcell, search.chain)
    for row in rows:
        folder.append_row("reach.csv", row)
    if writes_parquet:
        write_parquet(folder.path / "reach.parquet", rows)
    draw_reach(folder.path / "reach.png", workcell.placed.organ, workcell.workspace, study)
    draw_reasons(folder.path / "reasons.png", study)


def _summary(
    study: ReachStudy, workcell: Workcell, search: IkSearch, settings: StudySettings, name: str
) -> dict[str, Any]:
    return {
        "scenario": workcell.scenario.name,
        "arm": name,
        **({} if workcell.probe.path is None else {"probe": str(workcell.probe.path)}),
        "seed": settings.seed,
        "jobs": settings.n_jobs,
        "standoff_m": settings.standoff_m,
        "padding_m": settings.padding_m,
        "n_joints": search.chain.n_joints,
        **Stand.of_frame(workcell.scene.T_world_base).rounded().in_millimetres(),
        **study_summary(study),
    }


def _search_base(
    workcell: Workcell, search: IkSearch, question: BaseQuestion, folder: RunFolder, present_fraction: float
) -> dict[str, Any]:
    """Search the best place of the base, write the table and the map of the search, and return its summary."""
    with tqdm(total=question.n_bases, desc="bases", unit="base") as progress:
        found: BaseSearch = search_base(workcell, search, question, on_progress=progress.update)
    found, best_reached_fraction = _decided(found, question, workcell, search, present_fraction)
    for row in base_rows(found):
        folder.append_row("bases.csv", row)
    reached = (best_reached_fraction, present_fraction)
    draw_bases(folder.path / "bases.png", workcell, found, question, reached=reached)
    room = BaseRoom(workcell.scene, workcell.organ_distance)
    return {
        "objective": question.objective,
        "best_overhang_m": room.overhang_m(found.best.stand.T_world_base),
        **base_summary(found, best_reached_fraction=best_reached_fraction),
    }


def _decided(
    found: BaseSearch, question: BaseQuestion, workcell: Workcell, search: IkSearch, present_fraction: float
) -> tuple[BaseSearch, float]:
    """The search with its best base decided by the whole workspace, and the share that is reached from there.

    The best few, which a sample of the poses cannot tell apart, are tried again with a study's effort. The present base
    counts as the study found it. Where the objective is what is seen, the best by the sample stands.
    """
    present = found.candidates[0]
    n_tried = N_FINALISTS if question.objective == "poses" else 1
    finalists = sorted(found.asked, key=question.merit, reverse=True)[:n_tried]
    shares = {present: present_fraction} if question.objective == "poses" or present in finalists else {}
    for candidate in finalists:
        if candidate is not present:
            at_base = search.at_base(candidate.stand.T_world_base).with_new_starts()
            shares[candidate] = reached_fraction(at_base, workcell.workspace, n_jobs=question.n_jobs)
    best = max(shares, key=lambda candidate: shares[candidate])
    return dataclasses.replace(found, best=best), shares[best]


def _why_nothing(workcell: Workcell, study: ReachStudy) -> str:
    """Why a study reaches nothing: where the organ lies and how large it is, or what stands in the way."""
    if next(iter(study.reasons())) != IkStatus.TOO_FAR.name.lower():
        details = [result.detail for result in study.results]
        return f"For example: {max(details, key=details.count)}"
    low_m, high_m = workcell.placed.organ.bounds_m
    away_m = float(np.linalg.norm((low_m + high_m) / 2.0 - workcell.scene.T_world_base[:3, 3]))
    size_m = float((high_m - low_m).max())
    return (
        f"The organ's middle is {away_m:.2f} m from the arm's base, and the organ is {size_m * 1e3:.0f} mm long; "
        "is its place in metres and its `unit` right?"
    )


def _config(settings: StudySettings, workcell: Workcell) -> dict[str, Any]:
    return {
        "options": dict(settings.options),
        "scenario": scenario_record(workcell.scenario),
        "T_world_organ": workcell.placed.T_world_organ,
        "T_world_base": workcell.scene.T_world_base,
        "n_poses": workcell.workspace.n_poses,
    }
