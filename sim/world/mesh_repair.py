"""Making a closed, outward surface of triangles that nearly form one.

In order: duplicate vertices and triangles are merged, small holes filled, neighbouring triangles turned to
agree, and bodies turned outward. A surface is closed when as many triangles pass each edge one way as the
other; this, not the stricter "exactly two triangles per edge", is what a winding number needs, so bodies that
share an edge are fine.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from .crossings import VerticalCrossings
from .hole_filling import fill_holes

Faces = NDArray[np.int64]
Vertices = NDArray[np.float64]

MERGE_SHARES = (1e-9, 1e-6, 1e-5)
"""Vertices closer than this share of the box's diagonal are one; the next is tried while holes remain."""


class RepairError(ValueError):
    """The surface cannot be closed or oriented; the text names why and the remedy."""


def repair(vertices_m: Vertices, faces: Faces) -> tuple[Vertices, Faces, list[str]]:
    """A closed, outward surface near the one given.

    Args:
        vertices_m: Vertices [m], shape (V, 3), all finite where a face uses them.
        faces: Vertex indices, shape (F, 3).

    Returns:
        Vertices, faces, and one sentence for each repair that a user should know of.

    Raises:
        RepairError: The surface stays open or cannot be oriented.
    """
    notices: list[str] = []
    vertices_m, faces = _merge_until_closed(vertices_m, faces)
    faces, n_doubled = _drop_doubled(faces)
    if n_doubled:
        notices.append(f"{n_doubled} doubled triangles were dropped")
    if len(faces) < 4:
        raise RepairError("fewer than 4 triangles with an area remain; export a closed surface")
    if len(border_edges(faces)):
        vertices_m, faces, n_filled = fill_holes(vertices_m, faces, border_edges(faces))
        n_open = len(border_edges(faces))
        if n_open:
            raise RepairError(
                f"the surface is open: {n_open} edges border a hole too large or too tangled to fill; "
                "close it (for instance with MeshLab's Close Holes) and load it again"
            )
        notices.append(
            f"the surface was open: {n_filled} small hole{'s were' if n_filled > 1 else ' was'} filled"
        )
    faces, n_turned = _agree(faces)
    if n_turned:
        notices.append(f"{n_turned} triangles faced the wrong way and were turned")
    faces, n_inverted = _turn_outward(vertices_m, faces)
    if n_inverted:
        part = "the surface was" if n_inverted == 1 else f"{n_inverted} bodies were"
        notices.append(f"{part} inside out and the winding was reversed")
    used, flat = np.unique(faces, return_inverse=True)
    return vertices_m[used], flat.reshape(faces.shape).astype(np.int64), notices


def border_edges(faces: Faces) -> NDArray[np.int64]:
    """Edges that an odd number of triangles pass, as the triangle passes them, shape (E, 2)."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, first, count = np.unique(_edge_keys(edges), return_index=True, return_counts=True)
    return edges[first[count % 2 == 1]]


def _edge_keys(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    ordered = np.sort(edges, axis=1)
    return ordered[:, 0] * (int(edges.max(initial=0)) + 1) + ordered[:, 1]


def _merge_until_closed(vertices_m: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """The same triangles over merged vertices, merged no more than closing needs."""
    used = np.unique(faces)
    diagonal_m = float(np.linalg.norm(np.ptp(vertices_m[used], axis=0)))
    first: tuple[Vertices, Faces] | None = None
    for share in MERGE_SHARES:
        merged = _merge(vertices_m, faces, max(share * diagonal_m, 1e-12))
        if not len(border_edges(merged[1])):
            return merged
        first = first or merged
    assert first is not None
    return first


def _merge(vertices_m: Vertices, faces: Faces, tolerance_m: float) -> tuple[Vertices, Faces]:
    """The same triangles over vertices of which no two are closer than the tolerance."""
    used, compact = np.unique(faces, return_inverse=True)
    distinct_m, label = np.unique(vertices_m[used], axis=0, return_inverse=True)
    pairs = KDTree(distinct_m).query_pairs(tolerance_m, output_type="ndarray")
    if len(pairs):
        graph = coo_array((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(len(distinct_m),) * 2)
        _, group = connected_components(graph, directed=False)
        _, first = np.unique(group, return_index=True)
        distinct_m, label = distinct_m[first], group[label]
    merged = label[compact.reshape(faces.shape)].astype(np.int64)
    has_area = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    return distinct_m, merged[has_area]


def _drop_doubled(faces: Faces) -> tuple[Faces, int]:
    """The faces without repetitions of the same three vertices, and how many were dropped.

    Copies that face the same way leave one. Two that face each other cancel, as they bound nothing.
    """
    corners = np.sort(faces, axis=1)
    order = np.lexsort(corners.T)
    is_new = np.ones(len(faces), dtype=bool)
    is_new[1:] = (np.diff(corners[order], axis=0) != 0).any(axis=1)
    if is_new.all():
        return faces, 0
    group = np.empty(len(faces), dtype=np.int64)
    group[order] = np.cumsum(is_new) - 1
    start = np.take_along_axis(faces, faces.argmin(axis=1)[:, None], axis=1)[:, 0]
    follower = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + 1) % 3, axis=1)[:, 0]
    is_cyclic = (start == corners[:, 0]) & (follower == corners[:, 1])
    balance = np.bincount(group, np.where(is_cyclic, 1, -1))
    keeps = np.zeros(len(faces), dtype=bool)
    keeps[order[is_new]] = True
    is_kept = keeps & (balance[group] != 0)
    # The copy that is kept must face the way of the majority.
    kept = faces[is_kept]
    faces_the_other_way = is_cyclic[is_kept] != (balance[group[is_kept]] > 0)
    kept[faces_the_other_way] = kept[faces_the_other_way][:, ::-1]
    return kept, len(faces) - len(kept)


def _agree(faces: Faces) -> tuple[Faces, int]:
    """The faces turned so that neighbours pass their common edge in opposite directions; how many were.

    Each face stands twice in a graph, as it is and turned. Neighbours that agree link like with like, others
    link crosswise. A component of this graph is then one consistent orientation of a body; of the two, the
    one that keeps more faces is chosen. If a face and its turned self fall in one component, the body has
    only one side.
    """
    if not _is_balanced_failure(faces):
        return faces, 0
    n = len(faces)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = _edge_keys(edges)
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    counts = np.unique(sorted_keys, return_counts=True)[1]
    first = (np.cumsum(counts) - counts)[
        counts == 2
    ]  # edges of four triangles do not tell who neighbours whom
    one, other = order[first], order[first + 1]
    is_crosswise = edges[one, 0] == edges[other, 0]
    a, b = one // 3, other // 3
    rows, columns = np.concatenate([a, a + n]), np.concatenate([b + n * is_crosswise, b + n * ~is_crosswise])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * n, 2 * n))
    n_components, label = connected_components(graph, directed=False)
    as_is, turned = label[:n], label[n:]
    if (as_is == turned).any():
        raise RepairError("the surface has only one side, like a Moebius strip; remesh it")
    n_kept = np.bincount(as_is, minlength=n_components)
    turns = (n_kept[as_is] < n_kept[turned]) | ((n_kept[as_is] == n_kept[turned]) & (as_is > turned))
    result = np.where(turns[:, None], faces[:, ::-1], faces)
    if _is_balanced_failure(result):
        raise RepairError(
            "triangles meet at edges so that no orientation makes the surface closed; "
            "separate the touching parts or remesh it"
        )
    return result, int(turns.sum())


def _is_balanced_failure(faces: Faces) -> bool:
    """True if some edge is passed more often one way than the other."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, label = np.unique(_edge_keys(edges), return_inverse=True)
    return bool(np.bincount(label.ravel(), np.where(edges[:, 0] < edges[:, 1], 1, -1)).any())


def _turn_outward(vertices_m: Vertices, faces: Faces) -> tuple[Faces, int]:
    """The faces with every inside-out body turned, and how many bodies were.

    A body of negative volume is a cavity, and stays, if another body contains it.
    """
    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_array((np.ones(len(links), dtype=np.int8), links.T), shape=(len(vertices_m),) * 2)
    body = connected_components(graph, directed=False)[1][faces[:, 0]]
    corners = vertices_m[faces] - vertices_m[faces].mean(axis=(0, 1))
    volume = np.bincount(body, np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    faces, n_turned = faces.copy(), 0
    for inverted in np.flatnonzero(volume < 0):
        is_member = body == inverted
        rest = faces[~is_member & (volume[body] > 0)]
        probe = vertices_m[faces[is_member][:1, 0]]
        if len(rest) and VerticalCrossings(vertices_m, rest).winding(probe)[0] > 0:
            continue
        faces[is_member] = faces[is_member][:, ::-1]
        n_turned += 1
    return faces, n_turned
