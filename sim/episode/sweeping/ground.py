"""The ground of a sweep: where on the organ the probe glides from pose to pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner import visible_points
from planner.paths.roadmap import Roadmap
from sim.world.anatomy.structures import is_pressable
from sim.world.frames import frames_along
from sim.world.ik.slide_field import slide_field
from sim.world.scene.clearance import PROBE_MARGIN_M
from sim.world.solids.surface_distance import SurfaceDistance, surface_distance_of

from ..positioner import ArmPositioner
from ..setup import Setup

MOST_OFF_M = 0.002
"""The middle of the chord between two poses is no farther than this from the surface, or they lie on two sides of a
fold [m]."""
N_ROOTS = 200
"""Poses, spread over the workspace, whose inverse kinematics is solved; to the others the arm slides from these."""
LEAST_ISLAND = 0.01
"""Islands that hold a smaller share of the poses are not told of."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ground:
    """Where the probe glides."""

    roadmap: Roadmap
    setup: Setup
    """Organ, poses, structures and what carries the probe."""
    surface: SurfaceDistance
    notices: tuple[str, ...]
    """What is to be known about the roadmap: islands between which the probe has to be lifted."""

    def is_allowed(self, places_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the probe may press at places [m, world] on the surface, shape (K,)."""
        return is_pressable(places_m, self.setup.structures, self.setup.scenario.keepout_distance_m)


@lru_cache(maxsize=1)
def ground_of(setup: Setup) -> Ground:
    """The ground of a setup, which is kept: that of an arm takes the inverse kinematics of all poses.

    Args:
        setup: Organ, poses, structures and arm.
    """
    workspace, surface = setup.workspace, surface_distance_of(setup.organ)
    roadmap = Roadmap.of_surface(workspace)
    middles_m = workspace.positions_m[roadmap.pairs].mean(axis=1)
    distance_m, outward = surface.signed_distance_and_outward(middles_m)
    is_open = np.abs(distance_m) <= MOST_OFF_M
    keepout_m = setup.scenario.keepout_distance_m
    is_open &= is_pressable(middles_m - distance_m[:, None] * outward, setup.structures, keepout_m)
    roadmap = roadmap.part(is_open)
    if isinstance(setup.positioner, ArmPositioner):
        roadmap = _of_arm(setup.positioner, roadmap)
    return Ground(roadmap=roadmap, setup=setup, surface=surface, notices=_notices(setup, roadmap))


def _of_arm(positioner: ArmPositioner, roadmap: Roadmap) -> Roadmap:
    """The edges within the regions over which the arm slides."""
    search, workspace = positioner.search, roadmap.workspace
    chain = search.chain
    roots = np.arange(0, workspace.n_poses, max(1, workspace.n_poses // N_ROOTS))
    found = search.search(workspace.positions_m[roots], workspace.normals[roots])
    q, score = np.tile(chain.home, (workspace.n_poses, 1)), np.full(workspace.n_poses, -np.inf)
    q[roots], score[roots] = found.q[:, chain.columns], np.nan_to_num(found.clearance_m, nan=-np.inf)
    # The arm slides from the roots to all others that it reaches at all.
    region = slide_field(search, workspace, q, np.ones(workspace.n_poses, dtype=bool), score).region
    frames = frames_along(workspace.normals)
    probe_m, _ = search.clearance.best_turn_distances(workspace.positions_m, frames)
    region[probe_m < PROBE_MARGIN_M] = -1
    a, b = roadmap.pairs.T
    return roadmap.part((region[a] >= 0) & (region[a] == region[b]))


def _notices(setup: Setup, roadmap: Roadmap) -> tuple[str, ...]:
    """What is to be known of a surface that falls into islands, with what the poses of each see."""
    islands = roadmap.islands
    sizes = np.bincount(islands)
    large = np.flatnonzero(sizes >= LEAST_ISLAND * len(islands))
    if len(large) < 2:
        return ()
    shares = [
        float(visible_points(setup.workspace.part(islands == i), setup.cone, setup.search_points_m).mean())
        for i in large
    ]
    told = ", ".join(f"{sizes[i]} poses that see {share:.0%}" for i, share in zip(large, shares, strict=True))
    return (
        f"The surface falls into {len(large)} islands between which the probe cannot slide and is lifted: "
        f"{told} of the organ.",
    )
