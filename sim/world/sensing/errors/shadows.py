"""Shadows of structures that let no sound through: behind bone and gas nothing is seen."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.errors import FieldError
from sim.suggestions import did_you_mean
from sim.world.scene.scene import Scene

from ..sensor import SceneState


def is_shadowed(
    state: SceneState, points_m: NDArray[np.float64], names: tuple[str, ...]
) -> NDArray[np.bool_]:
    """Which points lie behind, or in, one of some structures as seen from the tip, shape (N,).

    Args:
        state: The scene now.
        points_m: Points, world frame [m], shape (N, 3).
        names: Names of the structures that cast shadows.

    Raises:
        FieldError: The anatomy has no structure of a name.
    """
    is_hidden = np.zeros(len(points_m), dtype=bool)
    if not names or not len(points_m):
        return is_hidden
    tip_m = state.T_world_probe[:3, 3].copy()
    # A ray of the length of its way has hit where the answer is at most 1.
    ways_m, normal = points_m - tip_m, np.empty(3)
    for geom in _geoms(state.scene, names):
        hits = [mujoco.mj_rayMesh(state.scene.model, state.data, geom, tip_m, way, normal) for way in ways_m]
        is_hidden |= (np.array(hits) >= 0.0) & (np.array(hits) <= 1.0)
    return is_hidden


def _geoms(scene: Scene, names: tuple[str, ...]) -> list[int]:
    """The geoms of structures."""
    known = [structure.name for structure in scene.anatomy.structures]
    for name in names:
        if name not in known:
            there = f"it has {', '.join(known)}" if known else "it has no structures"
            raise FieldError(
                "shadowing",
                name,
                f"the anatomy has no structure of that name; {there}.{did_you_mean(name, known)}",
            )
    return [scene.model.geom(f"structure{index}").id for index, name in enumerate(known) if name in names]
