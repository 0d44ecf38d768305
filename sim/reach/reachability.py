"""Reachability: how well an arm reaches each pose of a workspace, or why it does not."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from planner import Workspace
from sim.world.frames import frames_along
from sim.world.ik.result import IkResult, IkStatus
from sim.world.ik.search import CHUNK, Answers, IkSearch

from .pose_pool import chunk_answers
from .regions import contact_regions
from .score import PoseScore

TILT_STEPS = 2
"""Tilts that are tried of a pose that is not reached: half of the largest, and the largest."""
TILT_AZIMUTHS = 6
"""Directions around the normal in which each tilt is tried."""
TILT_RESTARTS = 12
"""Starts of a tilted pose after the first: with a dozen directions for each pose, fewer than for an upright one."""


@dataclass(frozen=True, eq=False)
class ReachStudy:
    """What an arm can do on a workspace of N poses."""

    results: list[IkResult]
    is_reached: NDArray[np.bool_]
    manipulability: NDArray[np.float64]
    """Yoshikawa's measure for position and beam [m^3], NaN where not reached, shape (N,)."""
    limit_room: NDArray[np.float64]
    """Distance of the joint nearest to a limit [rad or m], NaN where not reached, shape (N,)."""
    clearance_m: NDArray[np.float64]
    """Least distance of the arm to table, organ and itself [m], at most 0.1, NaN where not reached, shape (N,)."""
    score: NDArray[np.float64]
    """From 0 to 1, see `PoseScore`; NaN where not reached, shape (N,)."""
    n_solutions: NDArray[np.int64]
    """Distinct answers among the first starts, shape (N,)."""
    region: NDArray[np.int64]
    """Connected region, 0 the largest, -1 where not reached, shape (N,)."""
    tilt_rad: NDArray[np.float64]
    """The least tilt tried at which the pose is reached [rad], 0 without a tilt, NaN where it is not, shape (N,)."""
    search_s: float
    """Time that the search took for all poses, regions and tilts not counted."""

    def reasons(self) -> dict[str, int]:
        """The number of poses that ended in each way, the most frequent first."""
        names = [result.status.name.lower() for result in self.results]
        counts = {status.name.lower(): names.count(status.name.lower()) for status in IkStatus}
        return dict(sorted(((k, v) for k, v in counts.items() if v), key=lambda item: -item[1]))


def study_reach(
    search: IkSearch,
    workspace: Workspace,
    *,
    max_tilt_rad: float = 0.0,
    n_jobs: int = 1,
    show_progress: bool = False,
) -> ReachStudy:
    """The study of an arm on every pose of a workspace.

    Args:
        search: Solves for the arm.
        workspace: The poses.
        max_tilt_rad: Poses that are not reached are tried again with the beam tilted off the normal by up to this
            [rad], in [0, pi/2).
        n_jobs: Processes that share the poses; the answers do not depend on it.
        show_progress: Whether a progress bar is drawn on stderr.

    Raises:
        ValueError: The tilt is out of range.
    """
    if not 0.0 <= max_tilt_rad < np.pi / 2:
        raise ValueError(f"max_tilt_rad={max_tilt_rad}: must be from 0 to below pi/2.")
    start_s = perf_counter()
    answers = _search_all(search, workspace, n_jobs, show_progress)
    search_s = perf_counter() - start_s
    is_reached, q = answers.is_reached, answers.q[:, search.chain.columns]
    limit_room = np.where(is_reached, search.chain.limit_room(q).min(axis=1), np.nan)
    score = np.where(is_reached, PoseScore(search.chain)(q, answers.clearance_m), np.nan)
    return ReachStudy(
        results=answers.results,
        is_reached=is_reached,
        manipulability=np.where(is_reached, search.chain.manipulability(q), np.nan),
        limit_room=limit_room,
        clearance_m=answers.clearance_m,
        score=score,
        n_solutions=answers.n_solutions,
        region=contact_regions(search, workspace, q, is_reached, score),
        tilt_rad=_least_tilts(search, workspace, is_reached, max_tilt_rad),
        search_s=search_s,
    )


def reached_fraction(search: IkSearch, workspace: Workspace, *, n_jobs: int = 1) -> float:
    """The share of a workspace's poses that an arm reaches."""
    return float(_search_all(search, workspace, n_jobs, show_progress=False).is_reached.mean())


def _search_all(search: IkSearch, workspace: Workspace, n_jobs: int, show_progress: bool) -> Answers:
    """The answers to every pose. Chunks are the same for any number of processes, and so are the answers."""
    chunks = [slice(first, first + CHUNK) for first in range(0, workspace.n_poses, CHUNK)]
    parts: list[Answers] = []
    with (
        chunk_answers(search, workspace, chunks, n_jobs=n_jobs) as answers,
        tqdm(total=workspace.n_poses, desc="reach", unit="pose", disable=not show_progress) as progress,
    ):
        for part in answers:
            parts.append(part)
            progress.update(len(part.results))
    return Answers.joined(parts)


def _least_tilts(
    search: IkSearch, workspace: Workspace, is_reached: NDArray[np.bool_], max_tilt_rad: float
) -> NDArray[np.float64]:
    """The least tilt tried at which each pose is reached, shape (N,)."""
    tilt_rad = np.where(is_reached, 0.0, np.nan)
    if max_tilt_rad == 0.0:
        return tilt_rad
    quick = search.with_effort(max_restarts=min(TILT_RESTARTS, search.settings.max_restarts))
    for step in range(1, TILT_STEPS + 1):
        angle_rad = max_tilt_rad * step / TILT_STEPS
        poses = np.flatnonzero(np.isnan(tilt_rad))
        if not len(poses):
            break
        directions = tilted(workspace.normals[poses], angle_rad, TILT_AZIMUTHS)
        positions_m = np.repeat(workspace.positions_m[poses], TILT_AZIMUTHS, axis=0)
        answers = quick.search(positions_m, directions.reshape(-1, 3))
        tilt_rad[poses[answers.is_reached.reshape(len(poses), -1).any(axis=1)]] = angle_rad
    return tilt_rad


def tilted(normals: NDArray[np.float64], angle_rad: float, n_azimuths: int) -> NDArray[np.float64]:
    """Directions at an angle to unit normals, evenly around each, shape (N, n_azimuths, 3)."""
    frames = frames_along(normals)[:, None]
    azimuth = np.arange(n_azimuths)[:, None] * 2.0 * np.pi / n_azimuths
    around = np.sin(azimuth) * frames[..., 0] - np.cos(azimuth) * frames[..., 1]
    return np.cos(angle_rad) * normals[:, None] + np.sin(angle_rad) * around
