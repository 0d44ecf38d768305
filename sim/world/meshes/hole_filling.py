"""Filling small holes of a triangle surface."""

import numpy as np
from numpy.typing import NDArray

LARGEST_HOLE_SHARE = 0.35
"""Longest rim that is filled, as a share of the bounding box's diagonal: a longer fan invents anatomy."""


def fill_holes(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], border: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], int]:
    """The surface with each small hole closed by a fan about its rim's centre.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        border: Edges along holes, as the triangle beside the hole passes them, shape (E, 2).

    Returns:
        Vertices, faces, and the number of holes filled. Holes that are too long or tangled stay.
    """
    longest_m = LARGEST_HOLE_SHARE * float(np.linalg.norm(np.ptp(vertices_m, axis=0)))
    new_vertices, new_faces, n_filled = [vertices_m], [faces], 0
    n_vertices = len(vertices_m)
    for rim in _rims(border):
        ring_m = vertices_m[rim]
        if np.linalg.norm(ring_m - np.roll(ring_m, -1, axis=0), axis=1).sum() > longest_m:
            continue
        n_filled += 1
        ahead = np.roll(rim, -1)
        if len(rim) == 3:
            new_faces.append(rim[None, ::-1])
            continue
        new_vertices.append(ring_m.mean(axis=0, keepdims=True))
        new_faces.append(np.stack([ahead, rim, np.full(len(rim), n_vertices)], axis=1))
        n_vertices += 1
    return np.concatenate(new_vertices), np.concatenate(new_faces), n_filled


def _rims(border: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Closed walks along the border edges; those that pass a vertex more than once are left out.

    Each walk starts the way its first triangle passes the edge, but follows edges either way, since triangles
    around a hole need not agree yet.
    """
    neighbours: dict[int, list[int]] = {}
    for tail, head in border.tolist():
        neighbours.setdefault(tail, []).append(head)
        neighbours.setdefault(head, []).append(tail)
    rims, visited = [], set()
    for tail, head in border.tolist():
        if tail in visited:
            continue
        rim, previous, vertex = [tail], tail, head
        while vertex != tail and vertex not in visited and len(neighbours[vertex]) == 2:
            rim.append(vertex)
            visited.add(vertex)
            onward = neighbours[vertex][0] if neighbours[vertex][0] != previous else neighbours[vertex][1]
            previous, vertex = vertex, onward
        visited.add(tail)
        if vertex == tail and len(rim) >= 3 and len(neighbours[tail]) == 2:
            rims.append(np.array(rim, dtype=np.int64))
    return rims
