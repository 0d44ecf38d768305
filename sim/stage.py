"""The stage: all of a scenario that is the same for every seed, built once and shared by its episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import Lattice, MapSettings
from planner import Cone, Workspace

from .carrier import ArmCarrier, Carrier, FreeCarrier
from .scenarios import LIVER, PAPER_ORGAN, Scenario
from .world.anatomy import Anatomy
from .world.arm import MODELS_DIR, ArmModel
from .world.distance_grid import DistanceGrid
from .world.meshes import load_mesh
from .world.paper_organ import paper_organ
from .world.placement import lay_on_table, placed_at
from .world.scene import Scene, build_scene
from .world.solid import Solid
from .world.surface import upper_surface_workspace

HINGE_REACH = 4.0
"""Hinges farther than this many spacings from the organ have no weight inside it and are dropped."""
PAPER_HINGES, PAPER_QUERY = (17, 17, 10), (22, 22, 13)
"""The paper's 2,890 hinges and 6,292 query points on the box of its synthetic organ."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stage:
    """An organ in place, its workspace, its lattices, and what carries the probe."""

    scenario: Scenario
    organ: Solid
    """World frame [m]."""
    given_tumours: tuple[Solid, ...]
    """Tumours that the scenario names by file, world frame [m]; empty where they are planted."""
    T_world_organ: NDArray[np.float64]
    """Maps the organ file's coordinates [m] to the world, shape (4, 4)."""
    workspace: Workspace
    cone: Cone
    arm: ArmModel | None
    scene: Scene
    """The scene without tumours."""
    carrier: Carrier
    hinges: Lattice
    hinge_mask: NDArray[np.bool_]
    query: Lattice
    """The lattice on which the map is queried and scored."""
    is_inside: NDArray[np.bool_]
    """Which points of `query` lie inside the organ, shape (query.n_points,)."""
    search_points_m: NDArray[np.float64]
    """Those points, the search space of the planners, shape (M, 3) [m]."""
    notices: tuple[str, ...] = ()
    """What was repaired or is unusual about the files."""


def build_stage(scenario: Scenario, arm: ArmModel | None, map_settings: MapSettings) -> Stage:
    """Load and place the organ and everything that depends on it alone.

    Args:
        scenario: The case.
        arm: What carries the probe; None for a free-flying one.
        map_settings: Gives the spacing of the hinges.

    Raises:
        WorldError: A mesh or an arm that cannot be used.
    """
    organ, tumours, T_world_organ, workspace, notices = _placed(scenario)
    cone = Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m)
    scene = build_scene(Anatomy(organ, (), name=scenario.name), cone, arm=arm)
    organ_distance = DistanceGrid.from_solid(organ, margin_m=HINGE_REACH * map_settings.hinge_spacing_m + 0.004)
    carrier = FreeCarrier(scene, workspace) if arm is None else ArmCarrier(scene, workspace, organ_distance)
    hinges, query = _lattices(scenario, organ, map_settings.hinge_spacing_m)
    is_inside = organ.contains(query.points_m())
    reach_m = HINGE_REACH * map_settings.hinge_spacing_m
    return Stage(
        scenario=scenario,
        organ=organ,
        given_tumours=tumours,
        T_world_organ=T_world_organ,
        workspace=workspace,
        cone=cone,
        arm=arm,
        scene=scene,
        carrier=carrier,
        hinges=hinges,
        hinge_mask=organ_distance.distance_m(hinges.points_m()) <= reach_m,
        query=query,
        is_inside=is_inside,
        search_points_m=query.points_m()[is_inside],
        notices=notices,
    )


def _placed(
    scenario: Scenario,
) -> tuple[Solid, tuple[Solid, ...], NDArray[np.float64], Workspace, tuple[str, ...]]:
    """Organ, given tumours, T_world_organ, workspace and notices, all in the world frame."""
    notices: list[str] = []
    tumours: tuple[Solid, ...] = ()
    if scenario.organ == PAPER_ORGAN:
        paper = paper_organ()
        organ, T_world_organ = paper.solid, np.eye(4)
    else:
        path = MODELS_DIR / "liver.stl" if scenario.organ == LIVER else Path(scenario.organ)
        loaded = load_mesh(path, unit="mm" if scenario.organ == LIVER else scenario.organ_unit)
        notices += loaded.notices
        organ = Solid.from_trimesh(loaded.mesh)
        T_world_organ = _pose(scenario, organ)
        organ = organ.transformed(T_world_organ)
    for file in scenario.tumour_files:
        loaded = load_mesh(Path(file), unit=scenario.organ_unit)
        notices += loaded.notices
        tumours += (Solid.from_trimesh(loaded.mesh).transformed(T_world_organ),)
    if scenario.organ == PAPER_ORGAN:
        workspace = paper_organ().workspace
    else:
        workspace = upper_surface_workspace(organ, n_poses=scenario.n_poses, rng=np.random.default_rng(0))
    return organ, tumours, T_world_organ, workspace, tuple(notices)


def _pose(scenario: Scenario, organ: Solid) -> NDArray[np.float64]:
    if scenario.organ_position_m is not None and scenario.organ_quaternion is not None:
        return placed_at(scenario.organ_position_m, scenario.organ_quaternion)
    return lay_on_table(organ)


def _lattices(scenario: Scenario, organ: Solid, hinge_spacing_m: float) -> tuple[Lattice, Lattice]:
    """Hinges at a fixed spacing beyond the organ on every side, and the query lattice over the organ."""
    low_m, high_m = organ.bounds_m
    if scenario.organ == PAPER_ORGAN:
        low_m, high_m = paper_organ().search_box_m
        return _paper_hinges(low_m, high_m, hinge_spacing_m), Lattice.from_counts(low_m, high_m, counts=PAPER_QUERY)
    around_m = 1.5 * hinge_spacing_m
    hinges = Lattice.from_box(low_m - around_m, high_m + around_m, spacing_m=hinge_spacing_m)
    return hinges, Lattice.from_box(low_m, high_m, spacing_m=scenario.score_spacing_m)


def _paper_hinges(low_m: NDArray[np.float64], high_m: NDArray[np.float64], hinge_spacing_m: float) -> Lattice:
    return Lattice.from_box(low_m, high_m, spacing_m=hinge_spacing_m)
