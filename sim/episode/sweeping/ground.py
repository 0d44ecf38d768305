"""The ground of a sweep: where on the organ the probe glides from pose to pose, and in which configurations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner import visible_points
from planner.paths.roadmap import Roadmap
from sim.world.anatomy.structures import is_pressable
from sim.world.ik.damped_least_squares import descend
from sim.world.ik.result import IkResult, IkStatus
from sim.world.ik.slide_field import MAX_MOVE_RAD, SlideField, slide_field, smoothed
from sim.world.scene.clearance import PROBE_MARGIN_M
from sim.world.solids.surface_distance import SurfaceDistance, surface_distance_of

from ..positioner import ArmPositioner
from ..setup import Setup

MOST_OFF_M = 0.002
"""The middle of the chord between two poses is no farther than this from the surface, or they lie on two sides of a
fold [m]."""
MOST_SLIP_M = 0.002
"""Half-way between the configurations of two poses the tip is no farther than this from the middle between them [m]."""
N_ROOTS = 200
"""Poses, spread over the workspace, whose inverse kinematics is solved; to the others the arm slides from these."""
LEAST_ISLAND = 0.01
"""Islands that hold a smaller share of the poses are not told of."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ground:
    """Where the probe glides."""

    roadmap: Roadmap
    setup: Setup
    """The setup, whose positioner answers with the configurations between which the arm slides."""
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
        roadmap, answers = _of_arm(setup, setup.positioner, roadmap)
        setup = replace(setup, positioner=setup.positioner.with_answers(answers))
    return Ground(roadmap=roadmap, setup=setup, surface=surface, notices=_notices(setup, roadmap))


def _of_arm(setup: Setup, positioner: ArmPositioner, roadmap: Roadmap) -> tuple[Roadmap, dict[int, IkResult]]:
    """The edges along which the arm slides, and its configurations at the poses that have some."""
    search, workspace = positioner.search, setup.workspace
    chain = search.chain
    roots = np.arange(0, workspace.n_poses, max(1, workspace.n_poses // N_ROOTS))
    found = search.search(workspace.positions_m[roots], workspace.normals[roots])
    q, score = np.tile(chain.home, (workspace.n_poses, 1)), np.full(workspace.n_poses, -np.inf)
    q[roots], score[roots] = found.q[:, chain.columns], np.nan_to_num(found.clearance_m, nan=-np.inf)
    # The arm slides from the roots to all others that it reaches at all.
    field = slide_field(search, workspace, q, np.ones(workspace.n_poses, dtype=bool), score)
    field = smoothed(search, workspace, field, roadmap.pairs)
    answers = _answers(positioner, setup, field)
    a, b = roadmap.pairs.T
    is_kept = np.isin(a, list(answers)) & np.isin(b, list(answers)) & (field.region[a] == field.region[b])
    is_kept &= np.abs(field.q[a] - field.q[b]).max(axis=1) <= MAX_MOVE_RAD
    tips_m = chain.forward((field.q[a] + field.q[b]) / 2.0).tips_m
    middles_m = workspace.positions_m[roadmap.pairs].mean(axis=1)
    is_kept &= np.linalg.norm(tips_m - middles_m, axis=1) <= MOST_SLIP_M
    return roadmap.part(is_kept), answers


def _answers(positioner: ArmPositioner, setup: Setup, field: SlideField) -> dict[int, IkResult]:
    """The answers of a field: at the poses above which the probe can be lifted to the stand-off."""
    search, workspace = positioner.search, setup.workspace
    chain, settings, inside = search.chain, search.settings, np.flatnonzero(field.region >= 0)
    lifted_m = workspace.positions_m[inside] - settings.standoff_m * workspace.normals[inside]
    above, here = (
        descend(
            chain, field.q[inside], places_m, workspace.normals[inside], centring_gain=0.0, max_steps=n_steps,
            position_tolerance_m=settings.position_tolerance_m, angle_tolerance_rad=settings.angle_tolerance_rad,
        )
        for places_m, n_steps in ((lifted_m, 40), (workspace.positions_m[inside], 0))
    )  # fmt: skip
    is_there = np.ones(len(inside), dtype=bool)
    for end in (above, here):
        is_there &= (end.distance_m <= settings.position_tolerance_m) & (
            end.angle_rad <= settings.angle_tolerance_rad
        )
        state = chain.forward(end.q)
        probe_m, _ = search.clearance.probe_distances(state.tips_m, state.R_world_tip)
        is_there &= probe_m >= PROBE_MARGIN_M
    # That nothing else touches at the poses themselves is what the field was made by.
    is_there &= search.meter.measure(chain.full(above.q)).is_free
    q, q_above = chain.full(field.q[inside]), chain.full(above.q)
    return {
        int(pose): IkResult(
            IkStatus.REACHED,
            q[row],
            q_above[row],
            float(here.distance_m[row]),
            float(here.angle_rad[row]),
            0,
            0,
        )
        for row, pose in enumerate(inside)
        if is_there[row]
    }


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
