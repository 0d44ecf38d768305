"""The picture of a sweep that a dataset keeps: where it lies, and which of its pixels are tumour in truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.anatomy.anatomy import Anatomy
from sim.world.sensing.sweep import Sweep

TUMOUR = 255
"""The value of a mask's pixel whose middle lies in a tumour; 0 is everywhere else."""


def place_of_picture(sweep: Sweep) -> NDArray[np.float64]:
    """The map from the middle picture's (column, row, 0) [pixels] to the world [m], shape (4, 4).

    The middle of the first pixel is at (0, 0, 0); the third axis is the plane's own y, in pixels too.
    """
    T_plane_pixel = np.zeros((4, 4))
    T_plane_pixel[0, 0] = T_plane_pixel[2, 1] = T_plane_pixel[1, 2] = sweep.pixel_m
    T_plane_pixel[:, 3] = [sweep.left_m + sweep.pixel_m / 2, 0.0, sweep.top_m + sweep.pixel_m / 2, 1.0]
    return sweep.T_world_planes[sweep.middle] @ T_plane_pixel


def mask_of_picture(sweep: Sweep, anatomy: Anatomy) -> NDArray[np.uint8]:
    """Which pixels of the middle picture lie in a tumour, shape (rows, columns).

    Args:
        sweep: The pictures, in the world in which the anatomy lies.
        anatomy: The truth.
    """
    shape = sweep.images.shape[1:]
    rows, columns = (each.ravel() for each in np.indices(shape))
    T = place_of_picture(sweep)
    points_m = np.column_stack([columns, rows]) @ T[:3, :2].T + T[:3, 3]
    # Most pixels lie in no tumour's box; those that do are asked one by one.
    is_near = np.zeros(len(points_m), dtype=bool)
    for tumour in anatomy.tumours:
        low_m, high_m = tumour.bounds_m
        is_near |= ((points_m >= low_m) & (points_m <= high_m)).all(axis=1)
    mask = np.zeros(len(points_m), dtype=np.uint8)
    if is_near.any():
        mask[is_near] = np.where(anatomy.is_tumour(points_m[is_near]), TUMOUR, 0)
    return mask.reshape(shape)
