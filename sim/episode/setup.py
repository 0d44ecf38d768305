"""The setup: all of a scenario that is the same for every seed, built once and shared by its episodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mapping import MapSettings
from planner import Cone
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.base_room import check_base_room
from sim.world.scene.scene import Scene, build_scene

from .planned.planned_organ import (
    PlannedOrgan,
    load_scenario_anatomy,
    make_workspace,
    placed_organ,
    plan_organ,
)
from .positioner import ArmPositioner, FreePositioner, Positioner
from .scenario import Scenario

__all__ = ["Setup", "build_setup", "load_scenario_anatomy", "make_workspace", "placed_organ"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup(PlannedOrgan):
    """A planned organ, the scene about it, and what brings the probe to its poses."""

    arm: ArmModel | None
    probe: ProbeModel = EMBEDDED
    scene: Scene
    """The scene without tumours."""
    positioner: Positioner


def build_setup(
    scenario: Scenario,
    arm: ArmModel | None = None,
    map_settings: MapSettings | None = None,
    *,
    probe: ProbeModel = EMBEDDED,
) -> Setup:
    """The setup of a scenario: the organ is loaded and placed, and what follows from it is built.

    Args:
        scenario: What the setup is of.
        arm: The arm that carries the probe; None for a free-flying probe.
        map_settings: Gives the spacing of the hinges; None for the defaults.
        probe: The probe; by default the embedded one.

    Raises:
        WorldError: A mesh, the arm or the probe cannot be used.
    """
    planned = plan_organ(scenario, map_settings, arm=arm, probe=probe)
    scene = _empty_scene(planned, planned.cone, arm, probe)
    positioner: Positioner = FreePositioner(scene, planned.workspace)
    if arm is not None:
        check_base_room(scene, planned.organ_distance)
        positioner = ArmPositioner(scene, planned.workspace, planned.organ_distance)
    setup = Setup(**vars(planned), arm=arm, probe=probe, scene=scene, positioner=positioner)
    return replace(setup, notices=(*planned.notices, *scene.notices))


def _empty_scene(planned: PlannedOrgan, cone: Cone, arm: ArmModel | None, probe: ProbeModel) -> Scene:
    """The scene of a planned organ without tumours."""
    rng = np.random.default_rng(0)
    empty = build_anatomy(planned.organ, name=planned.scenario.name, rng=rng, structures=planned.structures)
    return build_scene(empty, cone, arm=arm, probe=probe)
