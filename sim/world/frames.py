"""Orientations as rotation matrices: that of a quaternion, and those that stand along a direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

NEAR_X = 0.9
"""A direction whose x is larger than this is too near to x for its frame to lean there."""
ALONG = 1.0 - 5e-13
"""Two unit vectors whose cosine is larger are within a millionth of a radian, which is taken for one direction."""


def quaternion_matrix(quaternions: ArrayLike) -> NDArray[np.float64]:
    """The rotation matrices of quaternions.

    They are MuJoCo's own, to the last bit: where the arm is must not depend on who works it out.

    Args:
        quaternions: Unit quaternions, wxyz, shape (..., 4).

    Returns:
        Shape (..., 3, 3).
    """
    # Imported here, so that directions have frames without it.
    import mujoco

    wxyz = np.ascontiguousarray(quaternions, dtype=np.float64)
    flat = wxyz.reshape(-1, 4)
    matrices = np.empty((len(flat), 9))
    for quaternion, matrix in zip(flat, matrices, strict=True):
        mujoco.mju_quat2Mat(matrix, quaternion)
    return matrices.reshape(*wxyz.shape[:-1], 3, 3)


def rigid_inverse(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a rigid move, shape (4, 4).

    Args:
        T: A rotation R and a shift p in the shape (4, 4).
    """
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = T[:3, :3].T, -T[:3, :3].T @ T[:3, 3]
    return inverse


def frames_along(
    normals: NDArray[np.float64], towards: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Orientations whose z is each normal and whose x leans towards a direction d.

        x = (d - (d . n) n) / |d - (d . n) n|,   y = n x x,   z = n

    Args:
        normals: Unit vectors n, shape (N, 3).
        towards: Unit vectors d, shape (N, 3); by default, and where d lies along n, it is the x axis, or the y axis
            where n is near to x.

    Returns:
        Matrices whose columns are x, y and z, shape (N, 3, 3).
    """
    leaning = np.where(np.abs(normals[:, :1]) < NEAR_X, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    if towards is not None:
        is_along = np.abs(np.vecdot(towards, normals)) > ALONG
        leaning = np.where(is_along[:, None], leaning, towards)
    x = leaning - np.vecdot(leaning, normals)[:, None] * normals
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(normals, x), normals], axis=2).astype(np.float64, copy=False)
