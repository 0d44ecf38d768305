"""Which way up an organ lies best: with the largest part of its inside in the cones of poses within the arm's reach.

Every candidate is a turn of the organ on the table. All are ranked by what the cones of all poses on their upper
surface see; the arm tries only the best of them, and anterior up, which is left only for what is clearly better. Poses
in a no-press zone count as little as those out of reach.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from planner import Cone, Workspace, visible_points
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.placement import PlacedOrgan, lay_on_table, turned
from sim.world.anatomy.structures import Structure, is_pressable
from sim.world.anatomy.surface import SensingSurface, upper_surface_workspace
from sim.world.errors import MeshError
from sim.world.ik.search import IkSearch
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid

TILT_STEPS_DEG = (-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0, 180.0)
"""Turns about the world's x and y that are tried; with the arm also half a turn about z."""
N_TRIED = 4
"""Candidates that the arm tries, those whose poses see most, each in two yaws; anterior up comes on top."""
N_POSES = 600
"""Poses on a candidate: so dense that cones overlap, some 7 mm apart on a liver."""
N_REACHED = 80
"""Poses that the arm tries; every other counts as the nearest of them does."""
N_POINTS = 2000
"""Points in the organ by which the seen share is judged: to 1 % of it."""
CLEARLY = 0.02
"""A turn is better if its poses see this much more of the organ: with poses drawn anew the share varies."""
RESTARTS = 4
"""Starts of the arm's search after the first: a pose that takes more is not a comfortable one."""
GRID_MARGIN_M = 0.02
"""How far beyond the organ its distances are known."""
Turn = tuple[float, float, float]
ANTERIOR_UP: Turn = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Case:
    """What all turns are tried on."""

    organ: Solid
    """In patient axes [m]."""
    cone: Cone
    probe: ProbeModel
    points_m: NDArray[np.float64]
    """Points in the organ by which the seen share is judged, patient axes [m], shape (M, 3)."""
    structures: tuple[Structure, ...]
    """Beside it, patient axes."""
    keepout_m: float
    """Positions closer than this to a structure to keep away from are not pressed [m]."""


def best_turn_rad(
    organ: Solid,
    arm: ArmModel | None,
    cone: Cone,
    probe: ProbeModel | None = None,
    *,
    structures: tuple[Structure, ...] = (),
    keepout_m: float = 0.0,
) -> Turn:
    """The turn from anterior up with which the cones of poses within reach see most; no turn where none is better.

    Args:
        organ: The organ in patient axes [m].
        arm: The arm that is to reach it; None for a free-flying probe, which reaches all that faces up.
        cone: What the probe sees.
        probe: The probe that the arm carries; None for the embedded one.
        structures: What lies beside the organ, patient axes; those to keep away from are not pressed near.
        keepout_m: How near a pose may come to those [m].

    Returns:
        Angles about the world's x, y and z [rad].
    """
    steps_rad = np.deg2rad(TILT_STEPS_DEG)
    others = [(float(x), float(y), 0.0) for x, y in itertools.product(steps_rad, steps_rad)]
    turns = _distinct([ANTERIOR_UP, *others])
    points_m = organ.sample_inside(N_POINTS, np.random.default_rng(0))
    case = _Case(
        organ=organ,
        cone=cone,
        points_m=points_m,
        probe=probe or EMBEDDED,
        structures=structures,
        keepout_m=keepout_m,
    )
    shares = np.array([_seen_share(case, turn, None) for turn in turns])
    if arm is None:
        return _clearly_best(turns, shares)
    ranked = [turns[index] for index in np.argsort(-shares, kind="stable")[:N_TRIED]]
    tried = [ANTERIOR_UP, *(turn for turn in ranked if turn != ANTERIOR_UP)]
    candidates = [(x, y, yaw) for x, y, _ in tried for yaw in (0.0, np.pi)]
    return _clearly_best(candidates, np.array([_seen_share(case, turn, arm) for turn in candidates]))


def _clearly_best(turns: list[Turn], shares: NDArray[np.float64]) -> Turn:
    """The turn of the largest share, or the first of all where that is no better within the accuracy."""
    best = int(np.argmax(shares))
    return turns[best] if shares[best] > shares[0] + CLEARLY else turns[0]


def _distinct(turns: list[Turn]) -> list[Turn]:
    """The turns without those that bring up the same side as an earlier one: half a turn about x and y is one of z."""
    kept: list[Turn] = []
    ups: list[NDArray[np.float64]] = []
    for turn in turns:
        up = turned(turn)[2]
        if all(float(up @ other) < 0.999 for other in ups):
            kept.append(turn)
            ups.append(up)
    return kept


def _seen_share(case: _Case, turn: Turn, arm: ArmModel | None) -> float:
    """The share of a case's points that the cones of poses within reach see where its organ lies so.

    Args:
        case: The organ and what is beside it.
        turn: How it is turned.
        arm: The arm; None where all poses are reached.
    """
    placed = lay_on_table(case.organ, R_world_organ=turned(turn))
    try:
        surface = upper_surface_workspace(placed.organ, N_POSES, rng=np.random.default_rng(0))
    except MeshError:
        return 0.0
    T = placed.T_world_organ
    positions_organ_m = (surface.positions_m - T[:3, 3]) @ T[:3, :3]
    counts = is_pressable(positions_organ_m, case.structures, case.keepout_m)
    if arm is not None and counts.any():
        counts &= _reached(placed, surface, arm, case.cone, case.probe)
    if not counts.any():
        return 0.0
    workspace = Workspace(surface.positions_m[counts], surface.normals[counts])
    return float(visible_points(workspace, case.cone, case.points_m @ T[:3, :3].T + T[:3, 3]).mean())


def _reached(
    placed: PlacedOrgan, surface: SensingSurface, arm: ArmModel, cone: Cone, probe: ProbeModel
) -> NDArray[np.bool_]:
    """Whether the arm reaches each pose, shape (N,), told by the nearest of those that it tries."""
    # Poses come in random order, so that the first ones lie all over the surface.
    positions_m, normals = surface.positions_m[:N_REACHED], surface.normals[:N_REACHED]
    anatomy = build_anatomy(placed.organ, name="candidate", rng=np.random.default_rng(0))
    scene = build_scene(anatomy, cone, arm=arm, probe=probe)
    search = IkSearch(scene, Clearance(scene, DistanceGrid.from_solid(placed.organ, margin_m=GRID_MARGIN_M)))
    answers = search.with_effort(max_restarts=RESTARTS).search(positions_m, normals)
    return np.asarray(answers.is_reached)[KDTree(positions_m).query(surface.positions_m)[1]]
