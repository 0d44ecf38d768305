"""The paper's sensor: it labels points of the cone without error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cone_pattern import cone_pattern
from .reading import Reading
from .sensor import SceneState, Sensor


@dataclass(frozen=True, kw_only=True)
class ConeSensor(Sensor):
    """Sees the whole cone, through whatever lies in it, and labels every point as the surfaces say."""

    n_rays: int = 100
    """Rays in the cone, at least 1; they pierce its base in a sunflower pattern."""
    n_points_per_ray: int = 10
    """Points on each ray, at least 1, even in volume along its depth."""

    def __post_init__(self) -> None:
        """Validates the counts."""
        if self.n_rays < 1 or self.n_points_per_ray < 1:
            raise ValueError(
                f"n_rays={self.n_rays}, n_points_per_ray={self.n_points_per_ray}: at least 1 of each."
            )

    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        """The points of the cone's pattern that lie in the organ, labelled by the crossings of their rays.

        Args:
            state: The scene now.
            rng: Turns the pattern about the beam and shifts its points along the rays; see `cone_pattern`.
        """
        directions_probe, ranges_m = cone_pattern(
            state.cone, n_rays=self.n_rays, n_points_per_ray=self.n_points_per_ray, rng=rng
        )
        T_world_probe = state.T_world_probe
        directions, origin_m = directions_probe @ T_world_probe[:3, :3].T, T_world_probe[:3, 3].copy()
        points_m = origin_m + ranges_m[..., None] * directions[:, None, :]
        rays, seen = state.rays, (state.data, origin_m, directions, ranges_m)
        is_in_organ = rays.winding(*seen, of="organ") > 0
        is_tumour = rays.winding(*seen, of="tumour") > 0
        is_target = None
        if state.scene.anatomy.target is not None:
            is_target = rays.winding(*seen, of="target")[is_in_organ] > 0
        return Reading(points_m[is_in_organ], is_tumour[is_in_organ], T_world_probe, is_target)
