"""The truth of one seed: where the tumours are, and the points by which their detection is measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from sim.world.anatomy.anatomy import Anatomy, build_anatomy
from sim.world.anatomy.tumour_load import draw_lits_diameters
from sim.world.anatomy.tumours import plant_load, plant_lobulated, plant_spheres
from sim.world.scene.scene import Scene, build_scene
from sim.world.solids.solid import Solid

from .attainment import attainable
from .setup import Setup


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetTruth:
    """The bodies of a second class that is mapped beside the tumours."""

    anatomy: Anatomy
    """The organ, with the class's bodies in the place of tumours and under the class's name."""
    is_target: NDArray[np.bool_]
    """Truth at the setup's search points, shape (M,)."""
    is_attainable: NDArray[np.bool_]
    """Which of the class's detection points reachable poses can sense, shape (D,)."""

    @property
    def attainable_fraction(self) -> float:
        """Share of the class's detection points that reachable poses can sense."""
        return float(self.is_attainable.mean())


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What an episode is to find out. Only the sensor and the scores look at it."""

    anatomy: Anatomy
    setup: Setup
    """The setup that the tumours are planted in."""
    is_tumour: NDArray[np.bool_]
    """Truth at the setup's search points, shape (M,)."""
    is_attainable: NDArray[np.bool_]
    """Which of the detection points reachable poses can sense, shape (D,)."""
    target: TargetTruth | None = None
    """The truth of a second class, where one is mapped."""

    @property
    def attainable_fraction(self) -> float | None:
        """Share of the detection points that reachable poses can sense; None without tumours."""
        return float(self.is_attainable.mean()) if self.is_attainable.size else None

    @cached_property
    def scene(self) -> Scene:
        """The scene with the tumours in it, built on first use."""
        return build_scene(self.anatomy, self.setup.cone, arm=self.setup.arm, probe=self.setup.probe)


def make_truth(setup: Setup, rng: np.random.Generator) -> Truth:
    """The truth of a seed: its tumours, planted unless they are given, and their detection points.

    Every part has a stream of its own, so that the truth of a seed is the same for every planner, and for every arm
    that reaches the poses above the tumours.

    Raises:
        WorldError: No place for the tumours was found.
    """
    plant_rng, points_rng = rng.spawn(2)
    tumours = setup.given_tumours or _planted(setup, plant_rng)
    target = _target(setup, rng) if setup.given_targets else None
    anatomy = build_anatomy(
        setup.organ,
        tumours,
        name=setup.scenario.name,
        rng=points_rng,
        tumour_names=setup.tumour_names or None,
        structures=setup.structures,
        target=target.anatomy if target is not None else None,
    )
    return Truth(
        anatomy=anatomy,
        setup=setup,
        is_tumour=anatomy.is_tumour(setup.search_points_m),
        is_attainable=_attainable(setup, anatomy.detection_points_m),
        target=target,
    )


def _target(setup: Setup, rng: np.random.Generator) -> TargetTruth:
    """The truth of the second class, whose stream of random numbers comes after those of the tumours."""
    (points_rng,) = rng.spawn(1)
    anatomy = build_anatomy(
        setup.organ,
        setup.given_targets,
        name=setup.scenario.target_name,
        rng=points_rng,
        tumour_names=setup.target_names,
    )
    return TargetTruth(
        anatomy=anatomy,
        is_target=anatomy.is_tumour(setup.search_points_m),
        is_attainable=_attainable(setup, anatomy.detection_points_m),
    )


def _planted(setup: Setup, rng: np.random.Generator) -> tuple[Solid, ...]:
    scenario = setup.scenario
    diameters_m: list[float] | None = None
    if scenario.tumour_load == "lits":
        diameters_m = draw_lits_diameters(rng)
    elif scenario.n_tumours == 0:
        return ()

    attainable_fraction = partial(_attainable_fraction, setup)
    if scenario.tumour_shape == "sphere":
        return plant_spheres(
            setup.organ,
            scenario.n_tumours,
            radius_m=scenario.tumour_radius_m,
            rng=rng,
            is_attainable=attainable_fraction,
        )
    if diameters_m is not None:
        return plant_load(setup.organ, diameters_m, rng=rng, is_attainable=attainable_fraction)
    return plant_lobulated(
        setup.organ,
        scenario.n_tumours,
        diameter_range_m=scenario.tumour_diameter_range_m,
        rng=rng,
        is_attainable=attainable_fraction,
    )


def _attainable_fraction(setup: Setup, points_m: NDArray[np.float64]) -> float:
    return float(_attainable(setup, points_m).mean())


def _attainable(setup: Setup, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    return attainable(setup.workspace, setup.cone, points_m, setup.positioner)
