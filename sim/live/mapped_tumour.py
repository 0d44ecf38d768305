"""The surface of what the map takes for tumour, cut fast enough to be shown after each action."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping import Lattice

LEVEL = 0.5
"""The surface lies where tumour is as likely as not."""


def tumour_surface(
    probability: NDArray[np.float64], lattice: Lattice
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Vertices, world frame [m], shape (V, 3), and triangles, shape (F, 3); both empty where nothing is likely tumour.

    Args:
        probability: Probability of tumour on the lattice, 0 outside the organ, shape (X, Y, Z).
        lattice: The lattice.
    """
    if not (probability > LEVEL).any():
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.intp)
    # Imported here, since it takes a third of a second.
    from skimage.measure import marching_cubes

    # A rim of zeros closes surfaces that end at the lattice.
    places, faces, *_ = marching_cubes(np.pad(probability, 1), LEVEL)
    low_m = np.array([axis[0] for axis in lattice.axes_m])
    step_m = np.array([axis[1] - axis[0] for axis in lattice.axes_m])
    return low_m + (places.astype(np.float64) - 1.0) * step_m, faces.astype(np.intp)
