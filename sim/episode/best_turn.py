"""Which way up an organ lies best: with the largest part of its surface facing up and within the arm's reach.

Every candidate is a turn of the organ on the table. All are ranked by the area of their upper surface; the arm tries
only the best of them.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.placement import lay_on_table, turned
from sim.world.anatomy.surface import upper_surface_area_m2, upper_surface_workspace
from sim.world.errors import MeshError
from sim.world.ik.search import IkSearch
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid

TILT_STEPS_DEG = (-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0, 180.0)
"""Turns about the world's x and y that are tried; with the arm also half a turn about z."""
N_TRIED = 4
"""Candidates of the largest upper surface that the arm tries, each in two yaws."""
N_POSES = 80
"""Poses by which the reached share is judged: to 5 % of it."""
RESTARTS = 4
"""Starts of the arm's search after the first: a pose that takes more is not a comfortable one."""
GRID_MARGIN_M = 0.02
"""How far beyond the organ its distances are known."""
Turn = tuple[float, float, float]


def best_turn_rad(organ: Solid, arm: ArmModel | None) -> Turn:
    """The turn from anterior up that brings the largest surface within reach; no turn where none is better.

    Args:
        organ: The organ in patient axes [m].
        arm: The arm that is to reach it; None for a free-flying probe, which reaches all that faces up.

    Returns:
        Angles about the world's x, y and z [rad].
    """
    steps_rad = np.deg2rad(TILT_STEPS_DEG)
    turns = [(float(x), float(y), 0.0) for x, y in itertools.product(steps_rad, steps_rad)]
    areas_m2 = np.array([_upper_area_m2(organ, turn) for turn in turns])
    # Among equals, anterior up comes first.
    areas_m2[turns.index((0.0, 0.0, 0.0))] *= 1.0 + 1e-9
    ranked = [turns[index] for index in np.argsort(-areas_m2, kind="stable")]
    if arm is None:
        return ranked[0]
    tried = _distinct(ranked)[:N_TRIED]
    candidates = [(x, y, yaw) for x, y, _ in tried for yaw in (0.0, np.pi)]
    reached_m2 = [_reached_area_m2(organ, turn, arm) for turn in candidates]
    return candidates[int(np.argmax(reached_m2))]


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


def _upper_area_m2(organ: Solid, turn: Turn) -> float:
    placed = lay_on_table(organ, R_world_organ=turned(turn)).organ
    return upper_surface_area_m2(placed, np.random.default_rng(0))


def _reached_area_m2(organ: Solid, turn: Turn, arm: ArmModel) -> float:
    """The area of the upper surface [m^2] times the share of its poses that the arm reaches."""
    placed = lay_on_table(organ, R_world_organ=turned(turn)).organ
    try:
        surface = upper_surface_workspace(placed, N_POSES, rng=np.random.default_rng(0))
    except MeshError:
        return 0.0
    anatomy = build_anatomy(placed, name="candidate", rng=np.random.default_rng(0))
    scene = build_scene(anatomy, Cone(0.2, 0.1), arm=arm)
    search = IkSearch(scene, Clearance(scene, DistanceGrid.from_solid(placed, margin_m=GRID_MARGIN_M)))
    answers = search.with_effort(max_restarts=RESTARTS).search(surface.positions_m, surface.normals)
    return float(answers.is_reached.mean()) * upper_surface_area_m2(placed, np.random.default_rng(0))
