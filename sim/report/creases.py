"""Normals to light a surface by: smooth where it bends gently, and sharp at its edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAST_COSINE = 0.87
"""A corner takes its triangle's normal where the smooth one is farther from it than this."""


def creased(
    vertices_m: NDArray[np.float64], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """The same surface with a normal for each vertex; corners at an edge become vertices of their own.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Triangles, shape (F, 3).

    Returns:
        Vertices, shape (W, 3) with W >= V, their unit normals, shape (W, 3), and triangles, shape (F, 3).
    """
    a, b, c = (vertices_m[faces[:, i]] for i in range(3))
    areas = np.cross(b - a, c - a)
    smooth = np.stack([_sum_at(faces, areas[:, i], len(vertices_m)) for i in range(3)], axis=1)
    flat, smooth = _unit(areas), _unit(smooth)
    is_sharp = np.einsum("fkj,fj->fk", smooth[faces], flat) < LEAST_COSINE
    is_sharp &= (areas != 0).any(axis=1)[:, None]
    face, corner = np.nonzero(is_sharp)
    shown = faces.astype(np.int64)
    split = shown[face, corner]
    shown[face, corner] = len(vertices_m) + np.arange(len(face))
    return np.concatenate([vertices_m, vertices_m[split]]), np.concatenate([smooth, flat[face]]), shown


def _sum_at(faces: NDArray[np.integer], values: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """The sum over the triangles about each vertex of a value of the triangle, shape (n,)."""
    return np.bincount(faces.ravel(), np.repeat(values, 3), minlength=n).astype(np.float64)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
