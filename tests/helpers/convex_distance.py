"""The distance of two convex geoms by alternating projections, independent of any collision engine."""

from __future__ import annotations

import mujoco
import numpy as np

N_ROUNDS = 120


def convex_distance_m(model: mujoco.MjModel, data: mujoco.MjData, first: int, second: int) -> float:
    """The distance of two geoms that do not touch [m]; boxes, spheres, capsules and cylinders.

    A point is projected on the one and on the other in turn, which converges to the nearest two points of two convex
    bodies (Cheney and Goldstein, 1959), from above.
    """
    at_m = data.geom_xpos[second]
    other_m = at_m
    for _ in range(N_ROUNDS):
        other_m = projected(model, data, first, at_m)
        at_m = projected(model, data, second, other_m)
    return float(np.linalg.norm(at_m - other_m))


def projected(model: mujoco.MjModel, data: mujoco.MjData, geom: int, point_m: np.ndarray) -> np.ndarray:
    """The point of a geom that is nearest to a point, world frame."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    R, centre_m = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    p = R.T @ (point_m - centre_m)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        p = np.clip(p, -size, size)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        across = p[:2] * min(1.0, size[0] / max(float(np.linalg.norm(p[:2])), 1e-12))
        p = np.array([*across, np.clip(p[2], -size[1], size[1])])
    else:
        half_m = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        axis = np.array([0.0, 0.0, np.clip(p[2], -half_m, half_m)])
        off = p - axis
        p = axis + off * min(1.0, size[0] / max(float(np.linalg.norm(off)), 1e-12))
    return R @ p + centre_m
