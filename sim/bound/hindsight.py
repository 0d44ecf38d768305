"""The hindsight optimum of a seed: how few poses would have been enough for a planner that knows the truth."""

from __future__ import annotations

from dataclasses import dataclass

from sim.episode.measures import SENSED_GOAL
from sim.errors import UsageError

from .cover import CoverBound, cover_bound, points_needed
from .stage import Stage


@dataclass(frozen=True, eq=False, kw_only=True)
class SeedBound:
    """The fewest poses that sense 95 % of a seed's tumours."""

    seed: int
    n_tumours: int
    n_points: int
    """Points by which the share sensed is measured: as many in each tumour, whatever its size."""
    need: int
    """Points that have to be sensed."""
    cover: CoverBound | None
    """The bound, its poses told as indices of the workspace; None where no poses sense enough."""


class SeedWork:
    """Finds the hindsight optimum of one seed after another."""

    def __init__(self, stage: Stage) -> None:
        """Remember what the seeds share."""
        self.stage = stage

    def __call__(self, seed: int) -> SeedBound:
        """The hindsight optimum of a seed.

        Raises:
            UsageError: There is no tumour.
            WorldError: No place for the tumours was found.
        """
        truth, poses = self.stage.truth(seed), self.stage.poses(seed)
        points_m = truth.anatomy.detection_points_m
        if not len(points_m):
            raise UsageError(
                f"seed {seed}: there is no tumour, so nothing has to be sensed. Plant some with `n_tumours`."
            )
        need = points_needed(len(points_m), SENSED_GOAL)
        bound = cover_bound(poses.sees(self.stage.setup(seed).cone, points_m), need)
        if bound is not None:
            bound = bound.with_poses(poses.pose)
        return SeedBound(
            seed=seed,
            n_tumours=len(truth.anatomy.tumours),
            n_points=len(points_m),
            need=need,
            cover=bound,
        )
