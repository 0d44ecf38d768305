"""The workcell: an organ in place before an arm, for studies of the arm without a probe's sensing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner import Cone, Workspace
from sim.episode.scenario import Scenario
from sim.episode.setup import make_workspace, placed_organ
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.placement import PlacedOrgan
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.base_room import check_base_room
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import Scene, build_scene
from sim.world.solids.distance_grid import DistanceGrid

ORGAN_MARGIN_M = 0.04
"""The distance grid reaches this far beyond the organ; a clearance farther out is a lower bound."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Workcell:
    """An organ in place, its workspace, and the arm that is to reach it."""

    scenario: Scenario
    placed: PlacedOrgan
    """The organ in the world."""
    probe: ProbeModel
    scene: Scene
    organ_distance: DistanceGrid
    clearance: Clearance
    notices: tuple[str, ...]
    """What was repaired or is unusual about the files; what there is about arm and probe comes last."""

    @cached_property
    def workspace(self) -> Workspace:
        """The scenario's sensing poses, made on first use."""
        return make_workspace(self.scenario, self.placed)

    def with_arm(self, arm: ArmModel) -> Workcell:
        """The same organ before another arm with the same probe.

        Raises:
            WorldError: The arm cannot be used.
        """
        scene = _scene(self.scenario, self.placed, arm, self.probe)
        check_base_room(scene, self.organ_distance)
        of_organ = self.notices[: len(self.notices) - len(self.scene.notices)]
        return replace(
            self,
            scene=scene,
            clearance=Clearance(scene, self.organ_distance),
            notices=(*of_organ, *scene.notices),
        )

    def make_search(self, settings: IkSettings | None = None) -> IkSearch:
        """The inverse kinematics of this workcell's arm."""
        return IkSearch(self.scene, self.clearance, settings)


def build_workcell(scenario: Scenario, arm: ArmModel, probe: ProbeModel = EMBEDDED) -> Workcell:
    """The workcell of a scenario, whose organ is loaded and placed before an arm.

    Raises:
        WorldError: A mesh, the arm or the probe cannot be used.
    """
    placed, notices = placed_organ(scenario, arm, probe)
    scene = _scene(scenario, placed, arm, probe)
    organ_distance = DistanceGrid.from_solid(placed.organ, margin_m=ORGAN_MARGIN_M)
    check_base_room(scene, organ_distance)
    return Workcell(
        scenario=scenario,
        placed=placed,
        probe=probe,
        scene=scene,
        organ_distance=organ_distance,
        clearance=Clearance(scene, organ_distance),
        notices=(*notices, *scene.notices),
    )


def _scene(scenario: Scenario, placed: PlacedOrgan, arm: ArmModel, probe: ProbeModel) -> Scene:
    anatomy = build_anatomy(placed.organ, name=scenario.name, rng=np.random.default_rng(0))
    cone = Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m)
    return build_scene(anatomy, cone, arm=arm, probe=probe)
