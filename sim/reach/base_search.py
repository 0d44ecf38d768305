"""Base placement: where an arm should stand to reach as much of a workspace as it can.

The base stands upright; its place (x, y), height and yaw are searched. A coarse grid comes first: places around the
organ, a few heights, the yaw that turns the arm at home towards the organ. Then rounds of refinement draw bases around
the best few, ever closer. Every candidate is tried on the same poses, which are drawn by seed, with less effort than a
study makes; the study of the best few bases then tries the whole workspace.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from planner import Cone, Workspace, visibility
from sim.world.ik.search import IkSearch
from sim.world.scene.base_room import BaseRoom

from .base_grid import BaseGrid, Stand, base_grid
from .pose_pool import shared_map
from .score import PoseScore
from .workcell import Workcell

QUICK_COMPARED, QUICK_RESTARTS = 2, 13
"""Effort of a candidate: starts that are compared, and starts after these before a pose is given up."""
COARSE_SHARE = 0.6
"""Share of the candidates that the coarse grid gets."""
N_ROUNDS, N_PARENTS = 4, 5
"""Rounds of refinement, and the best bases that each draws around."""
YAW_SPREAD_RAD = np.deg2rad(60.0)
"""Half of it is the standard deviation of the yaw in the first round, and each round halves it again. For place and
height the grid's steps take its place."""
MAX_SEEN_POINTS = 4000
"""Most points that stand for the organ's inside, where what the cones see is counted."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A base that was tried, or for which there was no room."""

    stand: Stand
    stage: str
    """`present`, `grid`, or `refined`."""
    obstacle: str = ""
    """What the base would stand in, so that it was not tried; empty where there was room."""
    reached_fraction: float = np.nan
    """Share of the poses that are reached."""
    seen_fraction: float = np.nan
    """Share of the organ's inside that the cone sees from the reached poses."""
    mean_score: float = np.nan
    """Mean of the score over all poses, with 0 for those that are not reached."""


@dataclass(frozen=True, eq=False)
class BaseSearch:
    """What a search for a base found."""

    candidates: list[Candidate]
    """All candidates in the order in which they were tried, the present base first."""
    best: Candidate
    """The candidate of the largest objective; among equals that of the highest mean score."""
    spacing_m: float
    """Distance between neighbours of the coarse grid."""
    n_poses: int
    """Number of poses that each candidate was tried on."""
    search_s: float
    """Time that the search took."""

    @property
    def asked(self) -> list[Candidate]:
        """The candidates for which there was room, which were tried."""
        return [candidate for candidate in self.candidates if not candidate.obstacle]


@dataclass(frozen=True, kw_only=True)
class BaseQuestion:
    """How bases are searched."""

    n_bases: int = 200
    """Number of candidates, the present base included."""
    n_poses: int = 500
    """Number of poses that each candidate is tried on."""
    height_m: tuple[float, float] = (0.0, 0.3)
    """Lowest and highest base [m, world]."""
    objective: str = "poses"
    """`poses` for the share of poses reached, `seen` for the share of the organ's inside seen from them."""
    seed: int = 0
    """Seed of the poses and of the refinement."""
    n_jobs: int = 1
    """Processes that share the work; the answers do not depend on it."""

    def merit(self, candidate: Candidate) -> tuple[float, float]:
        """What makes a base better than another."""
        share = candidate.seen_fraction if self.objective == "seen" else candidate.reached_fraction
        return share, candidate.mean_score


def search_base(
    workcell: Workcell,
    search: IkSearch,
    question: BaseQuestion,
    *,
    on_progress: Callable[[int], object] = lambda n: None,
) -> BaseSearch:
    """The search for the best of many bases of an arm, each of which is tried on poses of a workspace.

    Args:
        workcell: Organ, workspace and arm; the place of its base is the first candidate.
        search: Solves for that arm where it stands.
        question: How to search.
        on_progress: Called with the number of bases that were tried since the last call.
    """
    start_s = perf_counter()
    draw_rng, refine_rng = np.random.default_rng(question.seed).spawn(2)
    poses = _drawn_poses(workcell.workspace, question.n_poses, draw_rng)
    judge = _Judge(workcell, search, poses, draw_rng)
    base_room = BaseRoom(workcell.scene, workcell.organ_distance)
    n_coarse = max(round(COARSE_SHARE * question.n_bases), 1)
    grid = base_grid(judge.search, poses, base_room, question.height_m, n_wanted=n_coarse)
    present = Candidate(stand=Stand.of_frame(workcell.scene.T_world_base), stage="present")
    candidates = [present, *(Candidate(stand=stand, stage="grid") for stand in grid.stands)]
    with shared_map(judge, n_jobs=question.n_jobs) as share:

        def tried(bases: Sequence[Candidate]) -> Iterator[Candidate]:
            for candidate in share(bases):
                on_progress(1)
                yield candidate

        found = list(tried(candidates))
        for bases in _refinements(found, grid, base_room, question, refine_rng):
            found += tried(bases)
    blocked = [Candidate(stand=stand, stage="grid", obstacle=text) for stand, text in grid.blocked]
    best = max(found, key=question.merit)
    return BaseSearch([*found, *blocked], best, grid.spacing_m, poses.n_poses, perf_counter() - start_s)


def _refinements(
    found: list[Candidate],
    grid: BaseGrid,
    base_room: BaseRoom,
    question: BaseQuestion,
    rng: np.random.Generator,
) -> Iterator[list[Candidate]]:
    """Rounds of candidates around the best of `found`, which the caller extends after each round."""
    n_left = max(question.n_bases - len(found), 0)
    for number, count in enumerate(np.diff(np.linspace(0, n_left, N_ROUNDS + 1).astype(int)).tolist()):
        parents = sorted(found, key=question.merit, reverse=True)[:N_PARENTS]
        spread = np.array([grid.spacing_m, grid.spacing_m, grid.height_step_m, YAW_SPREAD_RAD])
        spread /= 2.0 ** (number + 1)
        children: list[Candidate] = []
        # Some are drawn where there is no room.
        for _ in range(20 * count):
            if len(children) == count:
                break
            parent = parents[len(children) % len(parents)].stand
            x_m, y_m, z_m, yaw_rad = np.array(parent) + spread * rng.normal(size=4)
            stand = Stand(x_m, y_m, float(np.clip(z_m, *question.height_m)), yaw_rad).rounded()
            if base_room.obstacle(stand.T_world_base) is None:
                children.append(Candidate(stand=stand, stage="refined"))
        yield children


def _drawn_poses(workspace: Workspace, count: int, rng: np.random.Generator) -> Workspace:
    """Poses that are drawn from a workspace without repetition, in the workspace's order."""
    chosen = np.sort(rng.permutation(workspace.n_poses)[:count])
    return workspace.part(chosen)


class _Judge:
    """What tries a base on the poses."""

    def __init__(
        self, workcell: Workcell, search: IkSearch, poses: Workspace, rng: np.random.Generator
    ) -> None:
        quick = replace(
            search.settings,
            n_compared=min(QUICK_COMPARED, search.settings.n_compared),
            max_restarts=min(QUICK_RESTARTS, search.settings.max_restarts),
        )
        # High above table and organ, the starts that remain are those that are free of the arm itself.
        aloft = workcell.scene.T_world_base.copy()
        aloft[2, 3] += 20.0
        self.search = search.with_settings(quick).at_base(aloft).with_new_starts()
        # It does not depend on where the base stands.
        self._score = PoseScore(self.search.chain)
        self._poses = poses
        self._sees = _seen_points(workcell, poses, rng)

    def __call__(self, candidate: Candidate) -> Candidate:
        """The candidate with what it reaches."""
        search = self.search.at_base(candidate.stand.T_world_base)
        answers = search.search(self._poses.positions_m, self._poses.normals)
        is_reached = answers.is_reached
        score = self._score(answers.q[:, search.chain.columns], answers.clearance_m)
        score = np.where(is_reached, score, 0.0)
        return replace(
            candidate,
            reached_fraction=float(is_reached.mean()),
            seen_fraction=float(self._sees[:, is_reached].any(axis=1).mean()),
            mean_score=float(score.mean()),
        )


def _seen_points(workcell: Workcell, poses: Workspace, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which poses' cones hold which points of the organ's inside, shape (M, N)."""
    scenario, organ = workcell.scenario, workcell.placed.organ
    low_m, high_m = organ.bounds_m
    points_m = rng.uniform(low_m, high_m, (4 * MAX_SEEN_POINTS, 3))
    inside_m = points_m[workcell.organ_distance.distance_m(points_m) < 0.0][:MAX_SEEN_POINTS]
    return visibility(poses, Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m), inside_m)
