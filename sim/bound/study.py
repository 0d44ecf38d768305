"""The program behind `sounding bound`: it finds the limit of a scenario and writes its folder."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from sim.campaign.study import SETUP_OPTIONS, Trial
from sim.episode.measures import SENSED_GOAL
from sim.interrupt import NotedInterrupt
from sim.notices import Notify, print_notice
from sim.reach.pose_pool import shared_map
from sim.record.ownership import check_out_folder
from sim.record.run_folder import describe_machine
from sim.running.config import EpisodeConfig
from sim.running.fields import changed, recorded

from .folder import BOUND, BoundFolder, read_seed, write_arrays
from .hindsight import SeedBound, SeedWork
from .places import Place, PlaceWork
from .policy_files import POLICY, block_file, blocks, read_block, write_block
from .policy_study import FIRST_PLACE, need_of_one, policy_bound, policy_summary, reason_against
from .search import MOST_ACTIONS, Coverage, coverage_weights
from .stage import Stage
from .summary import fewest_of, hindsight_summary

Result = TypeVar("Result")
NOTICE = "stopping: what was found is kept, and the next call goes on from there; Ctrl-C again stops at once."


@dataclass(frozen=True, kw_only=True)
class BoundSettings:
    """What is bounded, and how."""

    seeds: tuple[int, ...]
    """Seeds whose hindsight optimum is found."""
    n_places: int = 1000
    """Places of a tumour from which a bound on every policy is made, drawn anew; 0 for no such bound."""
    n_jobs: int = 2
    """Processes that share the work; the answers do not depend on it."""
    overwrite: bool = False
    """Whether a bound that the folder already holds is replaced."""


def question_of(config: EpisodeConfig, settings: BoundSettings) -> dict[str, Any]:
    """What is asked, as bound.json keeps it."""
    options = recorded(changed(config, seed=0))
    return json.loads(
        json.dumps(
            {
                "sounding": describe_machine()["sounding"],
                "options": {name: value for name, value in options.items() if name != "seed"},
                "case": case_settings(config),
                "goal": SENSED_GOAL,
                "n_places": settings.n_places,
                "first_place": FIRST_PLACE,
                "seeds": seeds_text(settings.seeds),
            },
            default=str,
        )
    )


def case_settings(config: EpisodeConfig) -> dict[str, Any]:
    """The settings that make the case of a bound, as bound.json keeps them."""
    settings = {name: value for name, value in Trial(config).settings.items() if name in SETUP_OPTIONS}
    return json.loads(json.dumps(settings, default=str))


def bound_study(
    config: EpisodeConfig,
    out: Path,
    settings: BoundSettings,
    *,
    show_progress: bool = True,
    notify: Notify = print_notice,
) -> dict[str, Any]:
    """Find the limit of a scenario, write its folder, and return what bound.json holds.

    Args:
        config: Scenario and arm.
        out: The folder; what it holds of the same question is kept.
        settings: What is bounded.
        show_progress: Whether progress bars are drawn on stderr.
        notify: Tells a notice; by default on stderr.

    Raises:
        UsageError, WorldError: Something cannot be done.
        KeyboardInterrupt: Ctrl-C was pressed; what was found is kept.
    """
    question = question_of(config, settings)
    check_out_folder(out, overwrite=settings.overwrite, marker=BOUND)
    stage = Stage(config)
    with threadpool_limits(limits=1):
        # What cannot be built leaves no folder behind.
        stage.setup(settings.seeds[0])
    with (
        threadpool_limits(limits=1),
        BoundFolder(out, overwrite=settings.overwrite) as folder,
        NotedInterrupt(NOTICE) as interrupt,
    ):
        folder.begin(question | {"status": "unfinished"})
        study = _Study(stage, folder, settings, interrupt, show_progress=show_progress)
        answer = study.run(notify)
        content = question | {"status": "finished", "machine": describe_machine()} | answer
        folder.write(content)
        return content | {"folder": str(out)}


class _Study:
    """One call of the program, with what its parts share."""

    def __init__(
        self,
        stage: Stage,
        folder: BoundFolder,
        settings: BoundSettings,
        interrupt: NotedInterrupt,
        *,
        show_progress: bool,
    ) -> None:
        self._stage = stage
        self._folder, self._settings, self._interrupt = folder, settings, interrupt
        self._show_progress = show_progress

    def run(self, notify: Notify) -> dict[str, Any]:
        """Find all that is not there yet, and return what bound.json tells of it."""
        seed = self._settings.seeds[0]
        for notice in self._stage.setup(seed).notices:
            notify(notice)
        if not self._stage.is_new_each_seed:
            self._find_poses(seed)
        bounds = self._hindsight()
        self._folder.write_table(bounds)
        answer: dict[str, Any] = {"hindsight": hindsight_summary(bounds), "policy": None, "no_policy": None}
        if self._settings.n_places:
            answer["no_policy"] = reason_against(self._stage, seed)
            if answer["no_policy"] is None:
                answer["policy"] = self._policy(seed, bounds)
        return answer

    def _find_poses(self, seed: int) -> None:
        n_poses = self._stage.setup(seed).workspace.n_poses
        with self._bar("poses", n_poses, unit="pose") as progress:

            def count(n: int) -> None:
                self._stop_if_asked()
                progress.update(n)

            self._folder.write_poses(self._stage.poses(seed, count))

    def _hindsight(self) -> list[SeedBound]:
        """The hindsight optimum of every seed."""
        held = [seed for seed in self._settings.seeds if self._folder.has_seed(seed)]
        bounds = {seed: read_seed(self._folder.path, seed) for seed in held}
        missing = [seed for seed in self._settings.seeds if seed not in bounds]
        n_jobs = min(self._settings.n_jobs, len(missing))
        with (
            shared_map(SeedWork(self._stage), n_jobs=n_jobs) as share,
            self._bar("seeds", len(self._settings.seeds), unit="seed", done=len(held)) as progress,
        ):
            for bound in self._counted(share(missing), progress):
                self._folder.write_seed(bound)
                bounds[bound.seed] = bound
        return [bounds[seed] for seed in self._settings.seeds]

    def _policy(self, seed: int, bounds: Sequence[SeedBound]) -> dict[str, Any]:
        """The bound on every policy: places are drawn, and weights found for each number of actions."""
        places = self._places()
        coverage = Coverage.of(places, self._stage.poses(seed).n_poses)
        weights: list[NDArray[np.float64]] = []
        with self._bar("actions", MOST_ACTIONS, unit="action") as progress:
            for each in self._counted(coverage_weights(coverage), progress):
                weights.append(each)
        write_arrays(self._folder.path / POLICY, {"weights": np.array(weights, dtype=np.float32)})
        bound = policy_bound(
            places,
            weights,
            lambda index, values: coverage.within[index].T @ values,
            self._stage.scenario(seed),
            fewest_of(bounds),
        )
        return policy_summary(bound)

    def _places(self) -> list[Place]:
        """All places; the blocks that are there are kept."""
        n_places, path = self._settings.n_places, self._folder.path
        every = blocks(FIRST_PLACE, n_places)
        missing = [block for block in every if not block_file(path, block).is_file()]
        n_missing = sum(map(len, missing))
        scenario = self._stage.scenario(0)
        work = PlaceWork(self._stage.planting(1), need_of_one(scenario.n_tumours))
        with (
            shared_map(work, n_jobs=min(self._settings.n_jobs, n_missing)) as share,
            self._bar("places", n_places, unit="place", done=n_places - n_missing) as progress,
        ):
            drawn = iter(self._counted(share([seed for block in missing for seed in block]), progress))
            for block in missing:
                write_block(block_file(path, block), list(itertools.islice(drawn, len(block))))
        return [place for block in every for place in read_block(block_file(path, block))]

    def _counted(self, results: Iterable[Result], progress: tqdm[Any]) -> Iterable[Result]:
        """Results as they come; each has been taken by the time the bar moves on."""
        for result in results:
            yield result
            progress.update()
            self._stop_if_asked()

    def _bar(self, what: str, total: int, *, unit: str, done: int = 0) -> tqdm[Any]:
        return tqdm(total=total, initial=done, desc=what, unit=unit, disable=not self._show_progress)

    def _stop_if_asked(self) -> None:
        if self._interrupt.is_set:
            raise KeyboardInterrupt


def seeds_text(seeds: Sequence[int]) -> str | list[int]:
    """Seeds as `parse_seeds` reads them: first:end where they follow one another, and else the list."""
    first = seeds[0]
    return (
        f"{first}:{first + len(seeds)}"
        if list(seeds) == list(range(first, first + len(seeds)))
        else list(seeds)
    )
