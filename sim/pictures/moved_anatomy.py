"""A state with organ, tumours and structures drawn where they are, and not where they were planned."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

_ANATOMY = ("organ", "tumour", "structure", "target")
"""What the names of the geoms of an anatomy begin with."""


@contextmanager
def moved_anatomy(data: mujoco.MjData, T_world_rest: NDArray[np.float64]) -> Iterator[None]:
    """Move what lies in a body, for as long as it is drawn; kinematics are as they were afterwards.

    Args:
        data: A state of a scene whose kinematics are up to date.
        T_world_rest: Where the body is, as the map of its planned place to the world, shape (4, 4).
    """
    model = data.model
    geoms = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith(_ANATOMY)]
    before_m, turns = data.geom_xpos[geoms].copy(), data.geom_xmat[geoms].copy()
    R = T_world_rest[:3, :3]
    data.geom_xpos[geoms] = before_m @ R.T + T_world_rest[:3, 3]
    data.geom_xmat[geoms] = (R @ turns.reshape(-1, 3, 3)).reshape(-1, 9)
    try:
        yield
    finally:
        data.geom_xpos[geoms], data.geom_xmat[geoms] = before_m, turns
