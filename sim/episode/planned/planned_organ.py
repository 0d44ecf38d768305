"""The planned organ: all of a scenario that planner and map need, which is made without MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapping import DetailSettings, Lattice, MapSettings, MapSpace, read_only
from planner import Cone, Workspace, visible_points
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.liver_generator import make_liver
from sim.world.anatomy.loading import LoadedAnatomy, load_anatomy
from sim.world.anatomy.paper_organ import paper_organ
from sim.world.anatomy.placement import PlacedOrgan, lay_on_table, pose_matrix, put_at_pose, turned
from sim.world.anatomy.structures import Structure, is_pressable
from sim.world.anatomy.surface import SensingSurface, upper_surface_workspace
from sim.world.errors import AnatomyError, MeshError
from sim.world.models import MODELS_DIR
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import surface_distance_of

from ..scenario import GENERATED_LIVER, PAPER_ORGAN, Scenario

if TYPE_CHECKING:
    from sim.world.probes.probe import ProbeModel
    from sim.world.scene.arm import ArmModel

GRID_MARGIN_M = 0.002
"""The distance grid reaches this much beyond the last hinge that is kept; farther out it gives a lower bound."""
GENERATOR_STREAM = 1
"""Number that keeps the draws of a generated liver apart from those of the seed's tumours."""
HINGE_REACH = 2.0
"""Hinges farther than this many spacings from the organ are dropped: they add under 0.1 % to a variance inside."""
LEAST_SCORED_POINTS = 50
"""With fewer points of the query lattice in the organ no share or curve of the map means anything."""
PAPER_QUERY = (22, 22, 13)
"""The paper's 6,292 query points on the box of its synthetic organ; the hinges there are 17 x 17 x 10."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannedOrgan:
    """An organ in place, its workspace, and its lattices."""

    scenario: Scenario
    organ: Solid
    """The organ's surface, world frame [m]."""
    given_tumours: tuple[Solid, ...]
    """Tumours that the scenario's files hold, world frame [m]; empty where they are planted."""
    tumour_names: tuple[str, ...]
    """What to call each of these in messages."""
    given_targets: tuple[Solid, ...]
    """The bodies of a second class to be mapped, world frame [m]; empty where there is no such class."""
    target_names: tuple[str, ...]
    """What to call each of these in messages."""
    structures: tuple[Structure, ...]
    """Vessels and the like, world frame [m]."""
    T_world_organ: NDArray[np.float64]
    """Maps the organ file's coordinates [m] to the world, shape (4, 4)."""
    workspace: Workspace
    cone: Cone
    hinges: Lattice
    hinge_mask: NDArray[np.bool_]
    query: Lattice
    """The lattice on which the map is queried and scored."""
    is_inside: NDArray[np.bool_]
    """Which points of `query` lie inside the organ, shape (query.n_points,)."""
    search_points_m: NDArray[np.float64]
    """Those points, the search space of the planners, shape (M, 3) [m]."""
    is_visible: NDArray[np.bool_]
    """Which of the search points some pose of the workspace sees, shape (M,)."""
    surface_distance_m: NDArray[np.float64]
    """Their distance to the organ's surface, shape (M,) [m]."""
    hinge_reach_m: float
    """How far from the organ hinges may lie [m]."""
    notices: tuple[str, ...] = ()
    """What was repaired or is unusual about the files."""

    def __post_init__(self) -> None:
        """Locks the arrays, which planners are shown and later episodes use again."""
        for name in ("hinge_mask", "is_inside", "search_points_m", "is_visible", "surface_distance_m"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def organ_distance(self) -> DistanceGrid:
        """The signed distance to the organ's surface on a grid, which is built when it is first asked for."""
        return _grid_about(self.organ, self.hinge_reach_m)

    def on_lattice(self, values: NDArray[Any], *, outside: float | bool) -> NDArray[Any]:
        """Values of the search points on the whole query lattice, shape (X, Y, Z).

        Args:
            values: One value per search point, shape (M,).
            outside: The value of the points outside the organ.
        """
        filled = np.full(self.query.n_points, outside, dtype=values.dtype)
        filled[self.is_inside] = values
        return filled.reshape(self.query.shape)

    def map_space(self, settings: MapSettings, detail: DetailSettings | None) -> MapSpace:
        """What a map of this setup is made for.

        Args:
            settings: What the map assumes.
            detail: How the map answers in detail near sensed tumour; None for a plain Hilbert map.
        """
        return MapSpace(
            hinges=self.hinges,
            hinge_mask=self.hinge_mask,
            query=self.query,
            is_inside=self.is_inside,
            settings=settings,
            detail=detail,
        )


def plan_organ(
    scenario: Scenario,
    map_settings: MapSettings | None = None,
    *,
    arm: ArmModel | None = None,
    probe: ProbeModel | None = None,
) -> PlannedOrgan:
    """The organ of a scenario, loaded and placed, with what follows from it.

    Args:
        scenario: What is planned on.
        map_settings: Gives the spacing of the hinges; None for the defaults.
        arm: The arm within whose reach the organ is laid, where the scenario's placing is `best`.
        probe: The probe that it carries; None for the embedded one.

    Raises:
        WorldError: A mesh cannot be used.
    """
    hinge_spacing_m = (map_settings or MapSettings()).hinge_spacing_m
    placed, notices = placed_organ(scenario, arm, probe)
    organ, workspace = placed.organ, make_workspace(scenario, placed)
    cone = Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m)
    reach_m = HINGE_REACH * hinge_spacing_m
    hinges, query = _lattices(scenario, placed, hinge_spacing_m)
    is_inside = organ.contains(query.points_m())
    search_points_m = query.points_m()[is_inside]
    _check_scored(query, len(search_points_m), scenario)
    return PlannedOrgan(
        scenario=scenario,
        organ=organ,
        given_tumours=placed.tumours,
        tumour_names=placed.tumour_names,
        given_targets=placed.targets,
        target_names=placed.target_names,
        structures=placed.structures,
        T_world_organ=placed.T_world_organ,
        workspace=workspace,
        cone=cone,
        hinges=hinges,
        hinge_mask=_hinge_mask(scenario, organ, hinges, reach_m),
        query=query,
        is_inside=is_inside,
        search_points_m=search_points_m,
        is_visible=visible_points(workspace, cone, search_points_m),
        surface_distance_m=surface_distance_of(organ).distance_m(search_points_m),
        hinge_reach_m=reach_m,
        notices=notices,
    )


def _check_scored(query: Lattice, n_points: int, scenario: Scenario) -> None:
    """Nothing, if a map of the organ has enough points to be one.

    Raises:
        AnatomyError: It has not.
    """
    if n_points >= LEAST_SCORED_POINTS and min(query.shape) > 1:
        return
    spacing_mm = scenario.score_spacing_m * 1e3
    reason = (
        f"only {n_points} points of the lattice of {spacing_mm:g} mm on which the map is scored lie in the organ, at "
        f"least {LEAST_SCORED_POINTS} must"
        if n_points < LEAST_SCORED_POINTS
        else f"the organ is thinner than the lattice of {spacing_mm:g} mm on which the map is scored"
    )
    raise AnatomyError(
        f"{reason}; check the unit and the spacing of its file, or lower `score_spacing_m` in a scenario file"
    )


@lru_cache(maxsize=2)
def _grid_about(organ: Solid, reach_m: float) -> DistanceGrid:
    return DistanceGrid.from_solid(organ, margin_m=reach_m + GRID_MARGIN_M)


def _hinge_mask(scenario: Scenario, organ: Solid, hinges: Lattice, reach_m: float) -> NDArray[np.bool_]:
    """Which hinges to keep: all of the paper's 2,890, and those within reach of any other organ."""
    if scenario.has_organ(PAPER_ORGAN):
        return np.ones(hinges.n_points, dtype=bool)
    return _grid_about(organ, reach_m).distance_m(hinges.points_m()) <= reach_m


def placed_organ(
    scenario: Scenario, arm: ArmModel | None = None, probe: ProbeModel | None = None
) -> tuple[PlacedOrgan, tuple[str, ...]]:
    """The organ in the world, with given tumours and structures, and the notices of their files.

    Args:
        scenario: What organ, and how it lies.
        arm: The arm within whose reach the organ is laid, where the scenario's placing is `best`.
        probe: The probe that it carries; None for the embedded one.

    Raises:
        WorldError: A file cannot be used.
    """
    loaded = load_scenario_anatomy(scenario)
    placed = _put_in_world(scenario, loaded, arm, probe)
    placed = placed.with_structures(loaded.structures).with_tumour_names(loaded.tumour_names)
    return placed.with_targets(loaded.targets, loaded.target_names), loaded.notices


def load_scenario_anatomy(scenario: Scenario) -> LoadedAnatomy:
    """The anatomy of a scenario in its own coordinates.

    Raises:
        WorldError: A file cannot be used.
    """
    if scenario.has_organ(PAPER_ORGAN):
        return LoadedAnatomy(organ=paper_organ().solid)
    if scenario.has_organ(GENERATED_LIVER):
        seed = scenario.organ_seed or 0
        return LoadedAnatomy(organ=make_liver(np.random.default_rng((seed, GENERATOR_STREAM))))
    return load_anatomy(scenario.case_files or CaseFiles(organ=str(MODELS_DIR / "liver.stl")))


def _put_in_world(
    scenario: Scenario, loaded: LoadedAnatomy, arm: ArmModel | None, probe: ProbeModel | None
) -> PlacedOrgan:
    organ, tumours = loaded.organ, loaded.tumours
    if scenario.organ_position_m is not None and scenario.organ_quaternion is not None:
        T_world_organ = pose_matrix(scenario.organ_position_m, scenario.organ_quaternion)
        return put_at_pose(organ, tumours, T_world_organ=T_world_organ)
    if scenario.has_organ(PAPER_ORGAN):
        # Its axes are those of the world already: z is up.
        return lay_on_table(organ, tumours, R_world_organ=np.eye(3))
    turn_rad = scenario.organ_turn_rad
    if scenario.organ_placing == "best":
        # Imported here, since it tries arms in MuJoCo, which nothing else of a plan needs.
        from ..best_turn import best_turn_rad

        cone = Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m)
        keepout_m = scenario.keepout_distance_m
        turn_rad = best_turn_rad(organ, arm, cone, probe, structures=loaded.structures, keepout_m=keepout_m)
    return lay_on_table(organ, tumours, R_world_organ=turned(turn_rad))


def make_workspace(scenario: Scenario, placed: PlacedOrgan) -> Workspace:
    """The sensing poses of a scenario: the paper's own, or positions spread evenly on the organ's upper surface."""
    if scenario.has_organ(PAPER_ORGAN):
        surface: SensingSurface = paper_organ().surface.transformed(placed.T_world_organ)
    else:
        surface = upper_surface_workspace(placed.organ, scenario.n_poses, rng=np.random.default_rng(0))
    is_clear = is_pressable(surface.positions_m, placed.structures, scenario.keepout_distance_m)
    if is_clear.all():
        return Workspace(surface.positions_m, surface.normals, surface.grid_shape)
    if not is_clear.any():
        raise MeshError(
            f"no pose is left: all lie within {scenario.keepout_distance_m * 1e3:g} mm of what must not be "
            "pressed; lower `keepout_mm`, or name fewer structures"
        )
    return Workspace(surface.positions_m[is_clear], surface.normals[is_clear])


def _lattices(scenario: Scenario, placed: PlacedOrgan, hinge_spacing_m: float) -> tuple[Lattice, Lattice]:
    """The hinges, which have a fixed spacing and reach beyond the organ, and the query lattice over the organ."""
    low_m, high_m = placed.organ.bounds_m
    if scenario.has_organ(PAPER_ORGAN) and np.allclose(placed.T_world_organ[:3, :3], np.eye(3)):
        paper, shift_m = paper_organ(), placed.T_world_organ[:3, 3]
        low_m, high_m = paper.box_low_m + shift_m, paper.box_high_m + shift_m
        query = Lattice.from_counts(low_m, high_m, counts=PAPER_QUERY)
        return Lattice.from_box(low_m, high_m, spacing_m=hinge_spacing_m), query
    around_m = HINGE_REACH * hinge_spacing_m
    hinges = Lattice.from_box(low_m - around_m, high_m + around_m, spacing_m=hinge_spacing_m)
    return hinges, Lattice.from_box(low_m, high_m, spacing_m=scenario.score_spacing_m)
