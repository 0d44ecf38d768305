"""The truth of one seed: where the tumours are, and the points by which their detection is measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from .attainment import attainable
from .stage import Stage
from .world.anatomy import Anatomy, build_anatomy
from .world.scene import Scene, build_scene
from .world.solid import Solid
from .world.tumour_load import draw_lits_diameters
from .world.tumours import plant_load, plant_lobulated, plant_spheres


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What an episode is to find out. Only the sensor and the scores look at it."""

    anatomy: Anatomy
    stage: Stage
    """Where they are planted."""
    is_tumour: NDArray[np.bool_]
    """Truth at the stage's search points, shape (M,)."""
    attainable_fraction: float | None
    """Share of the detection points that reachable poses can sense; None without tumours."""

    @cached_property
    def scene(self) -> Scene:
        """The scene with the tumours in it, built when it is first asked for."""
        return build_scene(self.anatomy, self.stage.cone, arm=self.stage.arm)


def make_truth(stage: Stage, rng: np.random.Generator) -> Truth:
    """Plant the tumours (or take the given ones) and draw their detection points.

    Every part has a stream of its own, so that the truth of a seed is the same for every planner, and for every arm
    that reaches the poses above the tumours.

    Raises:
        WorldError: No place for the tumours was found.
    """
    plant_rng, points_rng = rng.spawn(2)
    tumours = stage.given_tumours or _planted(stage, plant_rng)
    anatomy = build_anatomy(
        stage.organ,
        tumours,
        name=stage.scenario.name,
        rng=points_rng,
        tumour_names=stage.tumour_names or None,
        structures=stage.structures,
    )
    points_m = anatomy.detection_points_m
    fraction = _attainable_fraction(stage, points_m) if len(points_m) else None
    return Truth(
        anatomy=anatomy,
        stage=stage,
        is_tumour=anatomy.is_tumour(stage.search_points_m),
        attainable_fraction=fraction,
    )


def _planted(stage: Stage, rng: np.random.Generator) -> tuple[Solid, ...]:
    scenario = stage.scenario
    diameters_m: list[float] | None = None
    if scenario.tumour_load == "lits":
        diameters_m = draw_lits_diameters(rng)
    elif scenario.n_tumours == 0:
        return ()

    attainable_fraction = partial(_attainable_fraction, stage)
    if scenario.tumour_shape == "sphere":
        return plant_spheres(
            stage.organ,
            scenario.n_tumours,
            radius_m=scenario.tumour_radius_m,
            rng=rng,
            is_attainable=attainable_fraction,
        )
    if diameters_m is not None:
        return plant_load(stage.organ, diameters_m, rng=rng, is_attainable=attainable_fraction)
    return plant_lobulated(
        stage.organ,
        scenario.n_tumours,
        diameter_range_m=scenario.tumour_diameter_range_m,
        rng=rng,
        is_attainable=attainable_fraction,
    )


def _attainable_fraction(stage: Stage, points_m: NDArray[np.float64]) -> float:
    return float(attainable(stage.workspace, stage.cone, points_m, stage.carrier).mean())
