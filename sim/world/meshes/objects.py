"""The named objects of a mesh file: objects, groups or materials of OBJ, nodes of glTF, solids of STL.

Objects that are closed by themselves, or together with those whose vertices they share, are told apart. A surface that
is merely cut into groups is one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sim.world.names import fold, is_generic, meaning_of, roles_of

from .pieces import RIVAL_SHARE, PieceError, millilitres, place
from .repair import RepairError, repair
from .topology import Faces, signed_volume_m3

OBJ_KINDS = ("o", "g", "usemtl")
"""Lines of an OBJ file that name what follows; the first kind that tells apart is taken."""

MOST_TOLD = 6
"""Objects that a sentence names before it counts the rest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshObject:
    """An object of a mesh file.

    Attributes:
        name: What the file calls it.
        vertices: Vertices, in the file's unit and axes or in metres and LPS, shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        is_closed: Whether it bounds a solid.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: Faces
    is_closed: bool = False

    @property
    def volume_m3(self) -> float:
        """The volume it bounds, roughly where it is open [m^3]."""
        return abs(signed_volume_m3(self.vertices, self.faces))

    @property
    def text(self) -> str:
        """Its name, volume and place."""
        middle_m = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        size = millilitres(self.volume_m3) if self.is_closed else "open"
        return f"{self.name!r} ({size}, {place(middle_m)})"


@dataclass(frozen=True, eq=False, kw_only=True)
class SortedObjects:
    """What the objects of an organ's file are."""

    organ: tuple[MeshObject, ...]
    tumours: tuple[MeshObject, ...]
    structures: tuple[MeshObject, ...]
    remark: str


def obj_text_by_object(text: str) -> tuple[str, list[str], tuple[str, ...]]:
    """The text of an OBJ file in which each object begins with an `o` line, the objects' names in order, and all names.

    Where no kind of line tells several objects apart, the text is as it was and there are no objects.

    Args:
        text: The file's text.
    """
    kinds = {kind: _names_of(text, kind) for kind in OBJ_KINDS}
    able = [kind for kind in OBJ_KINDS if len(kinds[kind]) > 1]
    if not able:
        return text, [], tuple(name for names in kinds.values() for name in names)
    telling = [kind for kind in able if not all(is_generic(name) for name in kinds[kind])]
    chosen = (telling or able)[0]
    lines = re.sub(
        rf"^[ \t]*(?:{'|'.join(kind for kind in OBJ_KINDS if kind != chosen)})\b.*$", "", text, flags=re.M
    )
    return re.sub(rf"^[ \t]*{chosen}[ \t]+", "o ", lines, flags=re.M), kinds[chosen], tuple(kinds[chosen])


def _names_of(text: str, kind: str) -> list[str]:
    found = re.findall(rf"^[ \t]*{kind}[ \t]+(\S.*?)[ \t\r]*$", text, flags=re.M)
    return list(dict.fromkeys(found))


def objects_of_scene(scene: trimesh.Scene, order: Sequence[str] = ()) -> list[MeshObject]:
    """The objects of a scene, each where its node puts it.

    Args:
        scene: The scene.
        order: Names in the order in which objects are to come; the others follow.
    """
    found = []
    for node in scene.graph.nodes_geometry:
        T, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ T[:3, :3].T + T[:3, 3]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if np.linalg.det(T[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        name = geometry if is_generic(str(node)) and not is_generic(str(geometry)) else node
        found.append(MeshObject(name=str(name), vertices=vertices, faces=faces))
    rank = {name: index for index, name in enumerate(order)}
    return sorted(found, key=lambda each: rank.get(each.name, len(rank)))


def told_apart(objects: Sequence[MeshObject]) -> list[MeshObject]:
    """The objects that are things of their own, in metres; those that are parts of one surface are put together.

    Args:
        objects: All objects [m].
    """
    closed = {index: each for index, each in enumerate(map(_closed, objects)) if each is not None}
    is_open = [index for index in range(len(objects)) if index not in closed]
    units = list(closed.items())
    for group in _sharing_vertices([objects[index] for index in is_open]):
        members = [objects[is_open[each]] for each in group]
        whole = members[0] if len(members) == 1 else _as_one(members)
        units.append((is_open[group[0]], _closed(whole) or whole))
    return _named_apart([each for _, each in sorted(units, key=lambda unit: unit[0])])


def _closed(body: MeshObject) -> MeshObject | None:
    """The object repaired, or None where it bounds no solid."""
    try:
        vertices, faces, _ = repair(body.vertices, body.faces)
    except RepairError:
        return None
    return MeshObject(name=body.name, vertices=vertices, faces=faces, is_closed=True)


def _as_one(members: Sequence[MeshObject]) -> MeshObject:
    """Several objects as one, with all of their names."""
    vertices, faces = joined(members)
    return MeshObject(name=" + ".join(each.name for each in members), vertices=vertices, faces=faces)


def joined(members: Sequence[MeshObject]) -> tuple[NDArray[np.float64], Faces]:
    """The vertices and faces of several objects together."""
    starts = np.cumsum([0, *(len(each.vertices) for each in members[:-1])])
    faces = [each.faces + start for each, start in zip(members, starts, strict=True)]
    return np.concatenate([each.vertices for each in members]), np.concatenate(faces)


def _sharing_vertices(objects: Sequence[MeshObject]) -> list[list[int]]:
    """Groups of objects that are linked by common vertices."""
    if not objects:
        return []
    owner = np.repeat(np.arange(len(objects)), [len(each.vertices) for each in objects])
    _, place_of = np.unique(np.concatenate([each.vertices for each in objects]), axis=0, return_inverse=True)
    n = len(objects)
    links = (np.ones(len(owner)), (owner, n + place_of.ravel()))
    label = connected_components(coo_array(links, shape=(n + len(owner),) * 2), directed=False)[1][:n]
    return [np.flatnonzero(label == each).tolist() for each in dict.fromkeys(label.tolist())]


def _named_apart(units: Sequence[MeshObject]) -> list[MeshObject]:
    """The objects with names of which no two are equal."""
    used: dict[str, int] = {}
    found = []
    for each in units:
        name = each.name or "unnamed"
        used[name] = used.get(name, 0) + 1
        name = name if used[name] == 1 else f"{name} ({used[name]})"
        found.append(
            MeshObject(name=name, vertices=each.vertices, faces=each.faces, is_closed=each.is_closed)
        )
    return found


def sort_objects(units: Sequence[MeshObject], wanted: str | None) -> SortedObjects:
    """What the objects of an organ's file are: by name, or where the names do not tell, by size.

    Args:
        units: The objects [m], at least two.
        wanted: The name of the organ; None where the user gives none.

    Raises:
        PieceError: Several objects could be the organ, or the one wanted is not there.
    """
    roles = roles_of({index: each.name for index, each in enumerate(units)})
    organ, why = roles.organ, ""
    if wanted is not None:
        organ, why = (_index_of(units, wanted),), " as named"
    elif not organ:
        organ, why = (_largest(units),), " as the largest"
    tumours = tuple(i for i in roles.tumours if i not in organ)
    structures = tuple(i for i in roles.others if i not in organ) if roles.organ and wanted is None else ()
    rest = tuple(i for i in range(len(units)) if i not in (*organ, *tumours, *structures))
    uses = {
        f"{'is' if len(organ) == 1 else 'are'} taken for the organ{why}": organ,
        "for tumours": tumours,
        "for structures to show": structures,
        f"{'is' if len(rest) == 1 else 'are'} left out": rest,
    }
    texts = [f"{_told([units[i] for i in which])} {use}" for use, which in uses.items() if which]
    remark = f"of its {len(units)} objects {_listed(texts)}"
    if why == " as the largest":
        remark += "; pass another name as `organ_object` to take it in its place"
    return SortedObjects(
        organ=tuple(units[i] for i in organ),
        tumours=tuple(units[i] for i in tumours),
        structures=tuple(units[i] for i in structures),
        remark=remark,
    )


def sort_bodies(units: Sequence[MeshObject], noun: str) -> SortedObjects | None:
    """Which objects of a file of tumours, or of a second class, are meant by their names; None where that is all.

    Args:
        units: The objects [m], at least two.
        noun: What is wanted, `tumour` or `target`.
    """
    meanings = [meaning_of(each.name) for each in units]
    unwanted = ("liver", "other organ") if noun == "tumour" else ("liver", "other organ", "tumour")
    meant = [i for i, each in enumerate(meanings) if noun == "tumour" and each == "tumour"]
    meant = meant or [i for i, each in enumerate(meanings) if each not in unwanted]
    rest = [i for i in range(len(units)) if i not in meant]
    if not meant or not rest:
        return None
    are = "is" if len(rest) == 1 else "are"
    uses = f"{_told([units[i] for i in meant])} for {noun}s, and {_told([units[i] for i in rest])} {are} left out"
    return SortedObjects(
        organ=(),
        tumours=tuple(units[i] for i in meant),
        structures=(),
        remark=f"of its {len(units)} objects the names take {uses}",
    )


def _index_of(units: Sequence[MeshObject], wanted: str) -> int:
    """The object of a name; accents and capitals do not matter where they tell nothing apart."""
    exact = [i for i, each in enumerate(units) if each.name == wanted]
    alike = [i for i, each in enumerate(units) if fold(each.name) == fold(wanted)]
    for found in (exact, alike):
        if len(found) == 1:
            return found[0]
    raise PieceError(
        f"holds no object {wanted!r}; it holds {_told(units)}: pass one of these names as `organ_object`"
    )


def _largest(units: Sequence[MeshObject]) -> int:
    """The object that is the organ by its size.

    Raises:
        PieceError: Another is nearly as large, or none can be.
    """
    able = [
        i for i, each in enumerate(units) if each.is_closed and meaning_of(each.name) in (None, "other organ")
    ]
    able.sort(key=lambda i: -units[i].volume_m3)
    rivals = [i for i in able[1:] if units[i].volume_m3 >= RIVAL_SHARE * units[able[0]].volume_m3]
    if not able or rivals:
        raise PieceError(
            f"which of its objects is the organ? It holds {_told(units)}: pass the name of one as `organ_object`"
        )
    return able[0]


def _told(units: Sequence[MeshObject]) -> str:
    texts = [each.text for each in units[:MOST_TOLD]]
    texts += [f"{len(units) - MOST_TOLD} more"] if len(units) > MOST_TOLD else []
    return _listed(texts)


def _listed(texts: Sequence[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]
