"""Lesions that a reader sees where there are none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .reader_errors import BLOB_SPREAD, ReaderErrors


def false_blobs(
    points_m: NDArray[np.float64], errors: ReaderErrors, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which points lie in a false blob, shape (N,): balls about points of the view, a Poisson number of them.

    Args:
        points_m: Points of the view [m], shape (N, 3).
        errors: Mean number and size of the blobs.
        rng: Source of the draws.
    """
    n_blobs = int(rng.poisson(errors.false_blobs))
    is_in = np.zeros(len(points_m), dtype=bool)
    for _ in range(n_blobs):
        share = rng.random()
        radius_m = errors.false_blob_radius_m * np.exp(BLOB_SPREAD * rng.standard_normal())
        if len(points_m):
            centre_m = points_m[int(share * len(points_m))]
            is_in |= np.linalg.norm(points_m - centre_m, axis=1) < radius_m
    return is_in
