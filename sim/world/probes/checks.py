"""What a probe's file must not be: an arm, a shape of the wrong size, or one whose tip does not look out of it."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import mujoco
import numpy as np

from sim.world.frames import quaternion_matrix

from .errors import ProbeError
from .rigid_probe import KINDS, Shape

MAX_NAMED = 4
"""Most joints that a message names."""
LEAST_EXTENT_M, MOST_EXTENT_M = 0.01, 1.0
"""Shortest and longest box from the mount to the farthest point of a probe, by its longest side [m]."""
BEHIND_M = 0.05
"""A clamp may hold the arm's end from this far behind the mount [m]."""
SKIN_M = 1e-3
"""A tip may lie this deep in the probe [m]: a face that is modelled soft, or drawn roughly."""
BESIDE_M = 1e-4 * np.array([[1.0, 0.3, 0.0], [-0.7, 0.8, 0.0], [-0.4, -0.9, 0.0]])
"""Where rays from the tip start, in its own frame [m], shape (3, 3)."""
GAP_M = 5e-3
"""A tip that is farther in front of the probe than this touches an organ that the probe does not [m]."""


def check_rigid(model: mujoco.MjModel, path: Path) -> None:
    """Nothing, if a file holds geoms that a probe may have, and no joints.

    Raises:
        ProbeError: It does not.
    """
    if model.njnt:
        names = [model.joint(joint).name or f"joint {joint + 1}" for joint in range(model.njnt)]
        told = ", ".join(names[:MAX_NAMED]) + (" and more" if len(names) > MAX_NAMED else "")
        raise ProbeError(
            f"{path}: has {model.njnt} {'joint' if model.njnt == 1 else 'joints'} ({told}), but a probe is rigid. "
            "Remove the joints; if this is an arm, give it as `arm`."
        )
    for geom in range(model.ngeom):
        if int(model.geom_type[geom]) not in KINDS:
            raise ProbeError(
                f"{path}: the geom {model.geom(geom).name or geom} is a plane, a height field or another shape "
                f"without an end. Remove it; a probe is made of {', '.join(KINDS.values())}."
            )
    if not colliding(model):
        what = "no geoms" if not model.ngeom else "no geom that collides (all have contype and conaffinity 0)"
        raise ProbeError(f"{path}: has {what}, so nothing of it could touch. Add the probe's shape as geoms.")


def check_extent(model: mujoco.MjModel, data: mujoco.MjData, tip: Shape, path: Path) -> list[str]:
    """What is unusual about the place of a probe, a sentence each; it has the size of a thing that an arm can carry.

    Raises:
        ProbeError: It is as large as if it were in millimetres, or as small as if it had been scaled twice.
    """
    points_m = [np.zeros(3), tip.at_m]
    for geom in range(model.ngeom):
        middle_m, half_m = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        R = data.geom_xmat[geom].reshape(3, 3)
        at_m, reach_m = data.geom_xpos[geom] + R @ middle_m, np.abs(R) @ half_m
        points_m += [at_m - reach_m, at_m + reach_m]
    if not np.isfinite(points_m).all():
        raise ProbeError(f"{path}: a position or a size in it is no number (NaN or infinite). Mend it.")
    low_m = float(np.min(points_m, axis=0)[2])
    extent_m = float(np.ptp(points_m, axis=0).max())
    if extent_m > MOST_EXTENT_M:
        raise ProbeError(
            f"{path}: the probe reaches over {extent_m:.3g} m from its mount, at most {MOST_EXTENT_M:g} m are allowed. "
            'MJCF is in metres: scale a mesh in millimetres with scale="0.001 0.001 0.001" in its <mesh>, divide sizes '
            "and positions by 1000, and put the mount at the file's origin."
        )
    if extent_m < LEAST_EXTENT_M:
        raise ProbeError(
            f"{path}: the probe is {extent_m * 1e3:.2g} mm long, at least {LEAST_EXTENT_M * 1e3:g} mm are needed. MJCF "
            "is in metres; was it scaled twice?"
        )
    if low_m >= -BEHIND_M:
        return []
    return [
        f"the probe reaches {-low_m * 1e3:.0f} mm behind its mount, where the arm is. The file's origin lies on the "
        "flange, and its +z points away from the arm; turn or move the probe in the file if that is not meant."
    ]


def check_tip(model: mujoco.MjModel, data: mujoco.MjData, tip: Shape, path: Path) -> list[str]:
    """What is unusual about the tip of a probe, a sentence each.

    Raises:
        ProbeError: The tip lies in the probe, or its beam runs into it.
    """
    R = quaternion_matrix(tip.quaternion)
    beam = R[:, 2].copy()
    # A single ray may run along an edge of a mesh and meet neither of its triangles.
    starts_m = tip.at_m + SKIN_M * beam + BESIDE_M @ R.T
    way_m, name = _first_hit(model, data, starts_m, beam)
    if name is not None:
        x_mm, y_mm, z_mm = tip.at_m * 1e3
        raise ProbeError(
            f"{path}: from the tip at ({x_mm:.1f}, {y_mm:.1f}, {z_mm:.1f}) mm the beam, its +z, runs into the probe's "
            f"own geom {name} within {(way_m + SKIN_M) * 1e3:.1f} mm: the tip lies inside the probe, or looks back "
            "into it. Put the site tip on the face, its +z out of the probe."
        )
    way_m, name = _first_hit(model, data, starts_m, -beam)
    if name is None:
        return ["nothing of the probe lies behind its tip, so it touches the organ where the probe does not."]
    if way_m - SKIN_M > GAP_M:
        return [
            f"the tip is {(way_m - SKIN_M) * 1e3:.0f} mm in front of the probe's geom {name}, which therefore does "
            "not touch the organ."
        ]
    return []


def colliding(model: mujoco.MjModel) -> list[int]:
    """The geoms that take part in contacts."""
    return np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()


def _first_hit(
    model: mujoco.MjModel, data: mujoco.MjData, starts_m: np.ndarray, direction: np.ndarray
) -> tuple[float, str | None]:
    """How far the shortest of some rays goes to a geom that collides [m], and its name; None where none meets any."""
    least_m, name = np.inf, None
    for geom, start_m in product(colliding(model), starts_m):
        if model.geom_dataid[geom] >= 0:
            way_m = mujoco.mj_rayMesh(model, data, geom, start_m, direction)
        else:
            at_m, R, size = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
            way_m = mujoco.mju_rayGeom(at_m, R, size, start_m, direction, int(model.geom_type[geom]))
        if 0.0 <= way_m < least_m:
            least_m, name = float(way_m), model.geom(geom).name or f"geom{geom}"
    return least_m, name
