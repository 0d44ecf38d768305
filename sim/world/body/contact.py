"""Contact: where a probe that comes down along its beam meets an organ that is not quite where it was expected.

Its face is a disc across the beam, of which some points stand for all: where it stands aslant, or over a ridge, another
than the middle one touches first.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.sensing.rays import SurfaceRays

RINGS = ((0.5, 8), (1.0, 16))
"""Share of the face's radius and number of points of each ring about the middle. On a plane that is 10 degrees aslant
the outer ring misses the rim's nearest point by at most 0.03 mm under a face of 8 mm radius."""


@lru_cache(maxsize=8)
def face_in_tip_m(face_radius_m: float) -> NDArray[np.float64]:
    """Points of a face, the middle one first, in the frame of the tip [m], shape (25, 3).

    Args:
        face_radius_m: Its radius [m]; for 0 it is the middle alone, shape (1, 3).
    """
    points = [np.zeros((1, 3))]
    for share, n in RINGS if face_radius_m > 0.0 else ():
        angles = 2.0 * np.pi * np.arange(n) / n
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(n)], axis=1)
        points.append(share * face_radius_m * ring)
    found = np.concatenate(points)
    found.setflags(write=False)
    return found


def face_at_m(T_world_tip: NDArray[np.float64], face_radius_m: float) -> NDArray[np.float64]:
    """Points of a face whose tip is at a frame, shape (4, 4), in the same frame as that [m], shape (K, 3)."""
    return face_in_tip_m(face_radius_m) @ T_world_tip[:3, :3].T + T_world_tip[:3, 3]


def way_to_contact_m(
    rays: SurfaceRays,
    data: mujoco.MjData,
    T_rest_tip: NDArray[np.float64],
    *,
    above_m: float,
    search_m: float,
    face_radius_m: float = 0.0,
) -> float | None:
    """How far the tip goes on along its beam until its face meets the organ [m]; below 0 where that is before it.

    Args:
        rays: Rays at the surfaces of the scene.
        data: A forwarded state of the scene.
        T_rest_tip: Where the tip was to meet the organ, rest frame, shape (4, 4).
        above_m: From how far above that place the probe comes [m].
        search_m: How far below it it goes at most [m].
        face_radius_m: Radius of its face [m]; 0 for its middle alone.

    Returns:
        The way; None where it meets no surface, or where it would have to begin inside the organ.
    """
    beam, ways_m = T_rest_tip[:3, 2].copy(), []
    for point_m in face_at_m(T_rest_tip, face_radius_m):
        _, along_m, sign = rays.crossings(data, point_m - above_m * beam, beam[None], of="organ")
        if not len(along_m):
            continue
        if sign[first := int(np.argmin(along_m))] > 0:
            return None
        ways_m.append(float(along_m[first]) - above_m)
    way_m = min(ways_m, default=np.inf)
    return way_m if way_m <= search_m else None
