"""The program behind the check of a bound: it proves a certificate anew and trusts nothing that was found before.

The scenario, the poses that are reached and the truths of the seeds are made again from the options. Which cone holds
which point is found by code of its own. Then every number is held against what follows from that: chosen poses have to
be enough, and prices have to be allowed and to prove what is claimed. No solver runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from sim.campaign.study import parse_seeds
from sim.errors import UsageError
from sim.interrupt import NotedInterrupt
from sim.reach.pose_pool import shared_map
from sim.running.fields import config_of
from sim.tables import read_rows, table_cell

from ..folder import POSES, SEEDS, read_arrays, read_bound, read_seed, seed_row
from ..hindsight import SeedBound
from ..policy_files import block_file, blocks, read_block
from ..policy_study import need_of_one, reason_against
from ..poses import StandingPoses
from ..stage import Stage
from ..study import case_settings
from ..summary import fewest_of, hindsight_summary
from .plain_cones import held_points
from .policy_checking import BlockCheck, check_policy
from .proof import SLACK, DoesNotHoldError, proven_value, require

SAME_M = 1e-9
"""Poses that differ by less are the same [m, or parts of a unit vector]."""


def check_bound(path: Path, *, n_jobs: int = 2, show_progress: bool = True) -> list[str]:
    """What was verified of a bound's certificate, a sentence each.

    Args:
        path: The folder that `sounding bound` wrote.
        n_jobs: Processes that share the work.
        show_progress: Whether progress bars are drawn on stderr.

    Raises:
        DoesNotHoldError: A line does not hold.
        UsageError: The folder holds no bound that is finished.
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    content = read_bound(path)
    if content.get("status") != "finished":
        raise UsageError(f"{path}: is not finished. Run `sounding bound` with the same options to its end.")
    with threadpool_limits(limits=1), NotedInterrupt("stopping the check.") as interrupt:
        config = config_of(content["options"])
        require(
            content["case"] == (case := case_settings(config)),
            f"bound.json: case is {content['case']}, and not {case}",
        )
        stage = Stage(config)
        told = list(_check_poses(path, stage, content))
        told += _check_seeds(path, stage, content, interrupt, n_jobs, show_progress=show_progress)
        told += _check_places(path, stage, content, interrupt, n_jobs, show_progress=show_progress)
    return told


def _check_poses(path: Path, stage: Stage, content: Mapping[str, Any]) -> Iterator[str]:
    """Check that the poses on file are those that are reached."""
    if stage.is_new_each_seed:
        return
    arrays, poses = read_arrays(path / POSES), stage.poses(parse_seeds(content["seeds"])[0])
    for name in ("pose", "apex_m", "axis"):
        held, found = arrays.get(name), getattr(poses, name)
        is_same = held is not None and held.shape == found.shape and bool((abs(held - found) <= SAME_M).all())
        require(is_same, f"{POSES}: its {name} is not that of the {poses.n_poses} poses that are reached")
    yield f"the {poses.n_poses} poses are those that the probe reaches"


def _check_seeds(
    path: Path,
    stage: Stage,
    content: Mapping[str, Any],
    interrupt: NotedInterrupt,
    n_jobs: int,
    *,
    show_progress: bool,
) -> Iterator[str]:
    """Check the hindsight optimum of each seed, the table of all and the summary."""
    seeds = parse_seeds(content["seeds"])
    with (
        shared_map(SeedCheck(path, stage, content["goal"]), n_jobs=min(n_jobs, len(seeds))) as share,
        tqdm(total=len(seeds), desc="seeds checked", unit="seed", disable=not show_progress) as progress,
    ):
        for failure in share(seeds):
            require(failure is None, str(failure))
            progress.update()
            if interrupt.is_set:
                raise KeyboardInterrupt
    bounds = [read_seed(path, seed) for seed in seeds]
    rows = read_rows(path / SEEDS)
    require(len(rows) == len(bounds), f"{SEEDS}: has {len(rows)} rows for {len(bounds)} seeds")
    for row, bound in zip(rows, bounds, strict=True):
        wanted = {name: str(table_cell(value)) for name, value in seed_row(bound).items()}
        different = next((name for name, value in row.items() if value != wanted.get(name, "")), None)
        require(
            different is None,
            f"{SEEDS}: seed {bound.seed} has {different} {row.get(different or '')!r}, and its proof has "
            f"{wanted.get(different or '', '')!r}",
        )
    summary = hindsight_summary(bounds)
    require(content["hindsight"] == summary, f"bound.json: hindsight is not the seeds' own, {summary}")
    yield (
        f"{summary['n_seeds']} seeds: the chosen poses are enough, and the prices prove the fewest of "
        f"{summary['n_proven']}; all cones together are too few for {summary['n_impossible']}"
    )


def _check_places(
    path: Path,
    stage: Stage,
    content: Mapping[str, Any],
    interrupt: NotedInterrupt,
    n_jobs: int,
    *,
    show_progress: bool,
) -> Iterator[str]:
    """Check the bound on every policy: the places, block by block, and what their weights prove."""
    if not content["n_places"]:
        return
    seeds = parse_seeds(content["seeds"])
    reason = reason_against(stage, seeds[0])
    require(
        content["no_policy"] == reason,
        f"bound.json: no_policy is {content['no_policy']!r}, and not {reason!r}",
    )
    if reason is not None:
        return
    every = blocks(content["first_place"], content["n_places"])
    work = BlockCheck(path, stage.planting(1), need_of_one(stage.scenario(seeds[0]).n_tumours))
    with (
        shared_map(work, n_jobs=min(n_jobs, len(every))) as share,
        tqdm(
            total=content["n_places"], desc="places checked", unit="place", disable=not show_progress
        ) as progress,
    ):
        for block, failure in zip(every, share(every), strict=True):
            require(failure is None, str(failure))
            progress.update(len(block))
            if interrupt.is_set:
                raise KeyboardInterrupt
    places = [place for block in every for place in read_block(block_file(path, block))]
    fewest = fewest_of([read_seed(path, seed) for seed in seeds])
    yield check_policy(path, content, stage, seeds[0], places, fewest)


class SeedCheck:
    """Checks the hindsight optimum of one seed after another."""

    def __init__(self, path: Path, stage: Stage, goal: float) -> None:
        """Remember the folder and what the seeds share."""
        self._path, self._stage, self._goal = path, stage, goal

    def __call__(self, seed: int) -> str | None:
        """What does not hold of a seed; None where all does."""
        try:
            bound = read_seed(self._path, seed)
            points_m = self._stage.truth(seed).anatomy.detection_points_m
            poses, cone = self._stage.poses(seed), self._stage.setup(seed).cone
            held = held_points(poses.apex_m, poses.axis, cone.half_angle_rad, cone.depth_m, points_m)
            check_seed(bound, seed, held, poses, self._goal)
        except DoesNotHoldError as error:
            return f"seed {seed}: {error}"
        return None


def check_seed(
    bound: SeedBound, seed: int, held: NDArray[np.bool_], poses: StandingPoses, goal: float
) -> None:
    """Nothing, if the bound of a seed holds.

    Args:
        bound: What is claimed.
        seed: The seed.
        held: Which cone holds which of the truth's points, shape (N, M).
        poses: The poses of these cones.
        goal: Share of the points that has to be sensed.

    Raises:
        DoesNotHoldError: A line does not hold.
    """
    n_points = held.shape[1]
    require(bound.seed == seed, f"its file is that of seed {bound.seed}")
    require(bound.n_points == n_points, f"{bound.n_points} points are claimed, and there are {n_points}")
    need = next(n for n in range(n_points + 1) if n / n_points >= goal)
    require(bound.need == need, f"{bound.need} points are said to be needed, and {need} are")
    n_within = int(held.any(axis=0).sum())
    if bound.cover is None:
        require(n_within < need, f"no poses are said to be enough, and all cones together hold {n_within}")
        return
    cover, place = bound.cover, {int(pose): index for index, pose in enumerate(poses.pose)}
    strangers = [pose for pose in cover.chosen if pose not in place]
    require(not strangers, f"pose {(*strangers, 0)[0]} was chosen, and it is not reached")
    n_held = int(held[[place[pose] for pose in cover.chosen]].any(axis=0).sum())
    require(n_held >= need, f"the chosen poses {cover.chosen} hold {n_held} points, and {need} are needed")
    value = proven_value(held, need, cover.prices, cover.worth)
    require(
        abs(value - cover.value) <= SLACK, f"its prices prove {value:.9g}, and {cover.value:.9g} is claimed"
    )
    proven = math.ceil(value - SLACK)
    require(cover.least <= proven, f"at least {cover.least} poses are claimed, and the prices prove {proven}")
    require(
        cover.least <= cover.solver_least <= cover.most,
        f"{cover.least}, {cover.solver_least} and {cover.most} poses are not in order",
    )
