"""The shapes of planted tumours: balls, and lobulated blobs."""

from functools import lru_cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.solids.solid import Solid

SPHERE_SUBDIVISIONS = 3
"""Subdivisions of the icosahedron: 1,280 triangles, whose edges on a 40 mm tumour are 3 mm long."""


@lru_cache(maxsize=1)
def ball_shape() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """An icosphere about the origin with the volume of the unit ball: vertices, shape (V, 3), and faces.

    It is made once, and cannot be written to.
    """
    sphere = trimesh.creation.icosphere(subdivisions=SPHERE_SUBDIVISIONS)
    vertices = np.asarray(sphere.vertices) * np.cbrt(4.0 / 3.0 * np.pi / sphere.volume)
    faces = np.array(sphere.faces, dtype=np.int64)
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def lobulated_shape(
    diameter_m: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices [m] about the origin, and faces, of a random lobulated blob.

    A sphere, stretched a little along random axes, with lobes: smooth bumps of random direction, width and
    height that are added to its radius. Being star-shaped about the origin, it never crosses itself.

    Args:
        diameter_m: Diameter of the sphere of equal volume [m].
        rng: Source of the draws.

    Returns:
        Vertices, shape (V, 3), and faces, shape (F, 3).
    """
    directions, faces = ball_shape()
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    n_lobes = int(rng.integers(4, 10))
    lobes = _unit_vectors(n_lobes, rng)
    # A lobe is about 1 / sqrt(sharpness) rad wide.
    sharpness = rng.uniform(5.0, 14.0, n_lobes)
    height = rng.uniform(0.15, 0.40, n_lobes)
    radius = 0.7 + (height * np.exp(sharpness * (directions @ lobes.T - 1.0))).sum(axis=1)
    # Waves make the surface finely uneven.
    for _ in range(6):
        wave = directions @ (_unit_vectors(1, rng)[0] * rng.uniform(5.0, 9.0)) + rng.uniform(0.0, 2.0 * np.pi)
        radius += 0.015 * np.cos(wave)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    stretch = axes @ np.diag(np.exp(rng.normal(0.0, 0.12, 3))) @ axes.T
    vertices = (directions * radius[:, None]) @ stretch
    volume = Solid(vertices, faces).volume_m3
    return vertices * np.cbrt(np.pi / 6.0 * diameter_m**3 / volume), faces


def _unit_vectors(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
