"""Making a closed, outward surface of triangles that nearly form one.

In order: duplicate vertices and triangles are merged, small holes filled and stray triangles dropped,
neighbours turned to agree, and bodies turned outward.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sim.world.solids.crossings import VerticalCrossings

from .topology import Faces, agree, bodies, border_edges, is_closed

Vertices = NDArray[np.float64]

MERGE_SHARES = (0.0, 1e-6, 1e-5)
"""Vertices closer than this share of the box's diagonal are one; the next is tried while it is open."""

KEY_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers that scatter triples of indices over 64 bits."""

LARGEST_HOLE_SHARE = 0.35
"""Longest rim that is filled, as a share of the bounding box's diagonal: a longer fan invents anatomy."""

STRAY_SHARE = 0.01
"""Open bodies with a smaller share of the area are debris and dropped."""

MOST_INVERTED_BODIES = 200
"""More bodies than this that face inwards among others that do not are no anatomy."""


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
    vertices_m, faces = _merge_until_closed(vertices_m, faces)
    faces, n_doubled = _drop_doubled(faces)
    notices = [f"{n_doubled} doubled triangles were dropped"] if n_doubled else []
    if len(faces) < 4:
        raise RepairError("fewer than 4 triangles with an area remain; export a closed surface")
    if not is_closed(faces):
        vertices_m, faces, said = _close(vertices_m, faces)
        notices += said
    faces, n_inverted = _turn_outward(vertices_m, faces)
    if n_inverted:
        part = "the surface was" if n_inverted == 1 else f"{n_inverted} bodies were"
        notices.append(f"{part} inside out and the winding was reversed")
    return *compact(vertices_m, faces), notices


def compact(vertices_m: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """The vertices that faces use, and the faces over these."""
    is_used = np.zeros(len(vertices_m), dtype=bool)
    is_used[faces] = True
    return vertices_m[is_used], (np.cumsum(is_used) - 1)[faces]


def _close(vertices_m: Vertices, faces: Faces) -> tuple[Vertices, Faces, list[str]]:
    """The surface with holes filled, debris dropped and triangles turned to agree."""
    notices: list[str] = []
    if len(border_edges(faces)):
        vertices_m, faces, n_filled = _fill_holes(vertices_m, faces, border_edges(faces))
        if n_filled:
            holes = "small holes were" if n_filled > 1 else "small hole was"
            notices.append(f"the surface was open: {n_filled} {holes} filled")
        faces, n_stray = _drop_stray(vertices_m, faces)
        if n_stray:
            notices.append(f"{n_stray} stray triangles beside the surface were dropped")
        n_open = len(border_edges(faces))
        if n_open:
            raise RepairError(
                f"the surface is open: {n_open} edges border a hole too large or too tangled to fill; "
                "close it (for instance with MeshLab's Close Holes) and load it again"
            )
    agreed = agree(faces)
    if agreed is None:
        raise RepairError("the surface has only one side, like a Moebius strip; remesh it")
    faces, is_turned = agreed
    if not is_closed(faces):
        raise RepairError(
            "triangles meet at edges so that no orientation makes the surface closed; "
            "separate the touching parts or remesh it"
        )
    if is_turned.any():
        notices.append(f"{is_turned.sum()} triangles faced the wrong way and were turned")
    return vertices_m, faces, notices


def _fill_holes(vertices_m: Vertices, faces: Faces, border: NDArray[np.int64]) -> tuple[Vertices, Faces, int]:
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


def _merge_until_closed(vertices_m: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """The same triangles over merged vertices, merged no more than closing needs."""
    vertices_m, faces = compact(vertices_m, faces)
    diagonal_m = float(np.linalg.norm(np.ptp(vertices_m, axis=0)))
    first: tuple[Vertices, Faces] | None = None
    for share in MERGE_SHARES:
        merged = _merge(vertices_m, faces, share * diagonal_m)
        if first is None:
            vertices_m, faces = first = merged
        if not len(border_edges(merged[1])) if share else is_closed(merged[1]):
            return merged
    assert first is not None
    return first


def _merge(vertices_m: Vertices, faces: Faces, tolerance_m: float) -> tuple[Vertices, Faces]:
    """The same triangles over vertices of which no two are equal, nor linked by distances up to the tolerance."""
    if tolerance_m == 0.0:
        vertices_m, label = _distinct(vertices_m)
    else:
        pairs = KDTree(vertices_m).query_pairs(tolerance_m, output_type="ndarray")
        graph = coo_array((np.ones(len(pairs), dtype=np.int32), pairs.T), shape=(len(vertices_m),) * 2)
        _, label = connected_components(graph, directed=False)
        vertices_m = vertices_m[np.unique(label, return_index=True)[1]]
    merged = np.asarray(label, dtype=np.int64)[faces]
    has_area = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    return vertices_m, merged[has_area]


def _distinct(vertices_m: Vertices) -> tuple[Vertices, NDArray[np.int64]]:
    """The distinct rows, and for each row which of them it equals.

    Rows are compared by one product each, which sorts several times faster than three columns, and checked.
    """
    product = vertices_m @ np.sqrt([2.0, 3.0, 5.0])
    _, first, label = np.unique(product, return_index=True, return_inverse=True)
    if np.array_equal(vertices_m[first][label], vertices_m):
        return vertices_m[first], label
    return np.unique(vertices_m, axis=0, return_inverse=True)


def _drop_doubled(faces: Faces) -> tuple[Faces, int]:
    """The faces without repetitions of the same three vertices, and how many were dropped.

    Copies that face the same way leave one. Two that face each other cancel, as they bound nothing.
    """
    corners = np.sort(faces, axis=1)
    keys = np.sort((corners.astype(np.uint64) * KEY_FACTORS).sum(axis=1))
    # Where no two are alike, which is the common case, this takes a fifth of the time.
    if not (keys[1:] == keys[:-1]).any():
        return faces, 0
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


def _drop_stray(vertices_m: Vertices, faces: Faces) -> tuple[Faces, int]:
    """The faces without small open bodies beside the surface, and how many were dropped."""
    border = border_edges(faces)
    if not len(border):
        return faces, 0
    body = bodies(faces)
    is_border = np.zeros(len(vertices_m), dtype=bool)
    is_border[border] = True
    corners = vertices_m[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    area = np.bincount(body, areas)
    is_open = np.bincount(body, is_border[faces].any(axis=1)) > 0
    is_stray = is_open & (area < STRAY_SHARE * area.sum())
    kept = faces[~is_stray[body]]
    return kept, len(faces) - len(kept)


def _turn_outward(vertices_m: Vertices, faces: Faces) -> tuple[Faces, int]:
    """The faces with every inside-out body turned, and how many bodies were.

    A body of negative volume is a cavity, and stays, if another body contains it.
    """
    body = bodies(faces)
    corners = (vertices_m - vertices_m.mean(axis=0))[faces]
    volume = np.bincount(body, np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    n_inverted = int((volume < 0).sum())
    if n_inverted == len(volume):
        return faces[:, ::-1].copy(), n_inverted
    if n_inverted > MOST_INVERTED_BODIES:
        raise RepairError(f"{n_inverted} loose bodies are inside out; keep the organ's own surface only")
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
