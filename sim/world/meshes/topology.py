"""How triangles are joined: edges, borders, bodies, the way they face, and the volume they enclose.

Made for millions of them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Faces = NDArray[np.int64]


def is_closed(faces: Faces) -> bool:
    """True if every edge is passed as often one way as the other.

    This, not the stricter "exactly two triangles per edge", is what a winding number needs; so bodies that
    share an edge are fine.
    """
    edges, keys = _edges(faces)
    is_forward = edges[:, 0] < edges[:, 1]
    forward, backward = keys[is_forward], keys[~is_forward]
    return len(forward) == len(backward) and np.array_equal(np.sort(forward), np.sort(backward))


def border_edges(faces: Faces) -> NDArray[np.int64]:
    """Edges that an odd number of triangles pass, as the triangle passes them, shape (E, 2)."""
    edges, keys = _edges(faces)
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    return edges[first[count % 2 == 1]]


def bodies(faces: Faces) -> NDArray[np.int64]:
    """Index of the body that each face belongs to, shape (F,): faces that share a vertex are of one body."""
    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    return _components(links[:, 0], links[:, 1], int(faces.max(initial=0)) + 1)[faces[:, 0]]


def agree(faces: Faces) -> tuple[Faces, NDArray[np.bool_]] | None:
    """The faces turned so that neighbours pass their common edge in opposite directions.

    Each face stands twice in a graph, as it is and turned. Neighbours that agree link like with like, others
    link crosswise. A component of this graph is then one consistent orientation of a body; of the two, the
    one that keeps more faces is chosen.

    Args:
        faces: Vertex indices, shape (F, 3).

    Returns:
        The faces and which of them were turned, shape (F,); None if a body has only one side, so that a face
        and its turned self fall in one component.
    """
    n = len(faces)
    edges, keys = _edges(faces)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    # Where four triangles share an edge, it does not tell which of them are neighbours.
    pairs = starts[np.diff(starts, append=len(order)) == 2]
    one, other = order[pairs], order[pairs + 1]
    is_crosswise = edges[one, 0] == edges[other, 0]
    a, b = one // 3, other // 3
    rows, columns = np.concatenate([a, a + n]), np.concatenate([b + n * is_crosswise, b + n * ~is_crosswise])
    label = _components(rows, columns, 2 * n)
    as_is, turned = label[:n], label[n:]
    if (as_is == turned).any():
        return None
    n_kept = np.bincount(as_is, minlength=int(label.max()) + 1)
    turns = (n_kept[as_is] < n_kept[turned]) | ((n_kept[as_is] == n_kept[turned]) & (as_is > turned))
    return np.where(turns[:, None], faces[:, ::-1], faces), turns


def signed_volume_m3(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> float:
    """The volume that a closed surface encloses [m^3], negative where it is inside out.

    By the divergence theorem it is one sixth of the sum of a . (b x c) over the triangles.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
    """
    corners = (vertices_m - vertices_m.mean(axis=0))[faces]
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


def _edges(faces: Faces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges as the triangles pass them, shape (3 F, 2), and a number for each that both directions share."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    return edges, keys


def _components(rows: NDArray[np.int64], columns: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(rows), dtype=np.int32), (rows, columns)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
