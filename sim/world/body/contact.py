"""Contact: where a probe that comes down along its beam meets an organ that is not quite where it was expected."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.sensing.rays import SurfaceRays


def way_to_contact_m(
    rays: SurfaceRays,
    data: mujoco.MjData,
    T_rest_tip: NDArray[np.float64],
    *,
    above_m: float,
    search_m: float,
) -> float | None:
    """How far the tip goes on along its beam until it meets the organ [m]; below 0 where the surface lies before it.

    Args:
        rays: Rays at the surfaces of the scene.
        data: A forwarded state of the scene.
        T_rest_tip: Where the tip was to meet the organ, rest frame, shape (4, 4).
        above_m: From how far above that place the probe comes [m].
        search_m: How far below it it goes at most [m].

    Returns:
        The way; None where it meets no surface, or where it would have to begin inside the organ.
    """
    beam = T_rest_tip[:3, 2].copy()
    start_m = T_rest_tip[:3, 3] - above_m * beam
    _, along_m, sign = rays.crossings(data, start_m, beam[None], of="organ")
    if not len(along_m) or sign[first := int(np.argmin(along_m))] > 0:
        return None
    way_m = float(along_m[first]) - above_m
    return way_m if way_m <= search_m else None
