"""Tumours, or bodies of a second class, from files of their own and from memory: the same rule for whatever holds them.

Bodies under 3 mm are noise, the organ itself is no body in it, and what lies apart from the organ beside others that do
not is none of the organ's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.anatomy.anatomy import LEAST_INSIDE_SHARE, is_left_out
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.label_anatomy import LEAST_TUMOUR_DIAMETER_M, MOST_TUMOURS
from sim.world.errors import MeshError
from sim.world.meshes.meshes import load_bodies
from sim.world.solids.solid import Solid
from sim.world.volumes.files import is_volume, load_volume
from sim.world.volumes.label_surface import surface_of, tumour_surface
from sim.world.volumes.masks import box_of, label_pieces
from sim.world.volumes.volume import Volume, shifted

from .body_labels import labels_of_bodies

BodyKind = Literal["tumour", "target"]
"""What is mapped in an organ: tumours, or the bodies of a second class."""

ORGAN_SHARE = 0.8
"""A body that fills this share of an organ, beside others in its file, is the organ itself."""

WHOLE_SHARE = 0.95
"""A body that fills this share of an organ is the organ itself, even by itself."""

REMARKABLE_SHARE = 0.5
"""A body that fills this share of an organ is worth a word."""

N_DRAWS = 1000
"""Points by which it is told how bodies lie to one another: to 2 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GivenBody:
    """A tumour, or a body of a second class.

    Attributes:
        name: What to call it in messages.
        solid: Its surface, patient axes [m].
    """

    name: str
    solid: Solid


def given_bodies(role: BodyKind, files: CaseFiles, organ: Solid, notices: list[str]) -> list[GivenBody]:
    """The tumours, or the bodies of the second class, that have files of their own or are in memory.

    Args:
        role: Which of them.
        files: The files of the case.
        organ: The organ, patient axes [m].
        notices: Takes a sentence for each thing left out or assumed.

    Raises:
        WorldError: A file cannot be used, or holds nothing but the organ itself.
    """
    found: list[GivenBody] = []
    for number, body in enumerate(files.tumours if role == "tumour" else files.targets, start=1):
        if isinstance(body, str):
            held, name = _bodies_of(body, role, files, notices), body
        else:
            name = f"{role} {number}"
            solid = solid_of(body, role)
            on_noise = _on_noise(np.array([np.cbrt(6.0 * solid.volume_m3 / np.pi)]), role, name)
            held = [] if on_noise else [GivenBody(name=name, solid=solid)]
            notices += on_noise
        held = _without_organ(held, role, name, organ, notices)
        found += _about_organ(held, role, name, organ, notices)
    return found


def _on_noise(diameters_m: NDArray[np.float64], role: BodyKind, file: str) -> list[str]:
    """A sentence on bodies that are too small, told by the balls of their volume."""
    small_mm = diameters_m[diameters_m < LEAST_TUMOUR_DIAMETER_M] * 1e3
    if not len(small_mm):
        return []
    noun, up_to, verb = (
        ("a " + role, "", "was") if len(small_mm) == 1 else (f"{len(small_mm):,} {role}s", "up to ", "were")
    )
    return [
        f"{file}: {noun} of {up_to}{small_mm.max():.2g} mm across {verb} taken for noise of the outline and dropped, "
        f"as all under {LEAST_TUMOUR_DIAMETER_M * 1e3:g} mm are"
    ]


def solid_of(body: Solid | trimesh.Trimesh, role: str) -> Solid:
    """A surface in memory as a solid.

    Args:
        body: A solid, or a closed mesh whose faces look outward [m].
        role: What it is, for messages.

    Raises:
        MeshError: The mesh is not closed, or its faces look inward.
    """
    if isinstance(body, Solid):
        return body
    if not body.is_volume:
        raise MeshError(
            f"the {role} in memory: is not a closed surface with its faces outward; call "
            "trimesh.repair.fill_holes and trimesh.repair.fix_normals on it, or save it and name the file, which is "
            "repaired when it is read"
        )
    return Solid.from_trimesh(body)


def _bodies_of(file: str, role: BodyKind, files: CaseFiles, notices: list[str]) -> list[GivenBody]:
    """The bodies of a mesh, or the pieces of a label volume, the largest first."""
    if is_volume(file):
        volume = load_volume(file, spacing_m=files.spacing_m, axes=files.voxel_axes)
        notices += volume.notices
        return _labelled_bodies(file, volume, role, files, notices)
    solids, said = load_bodies(file, files.unit, role=role, frame=files.frame)
    notices += said
    return [GivenBody(name=name, solid=solid) for name, solid in _numbered(file, role, solids)]


def _numbered(file: str, role: BodyKind, solids: Sequence[Solid]) -> list[tuple[str, Solid]]:
    if len(solids) == 1:
        return [(file, solids[0])]
    return [(f"{file}: {role} {i}", solid) for i, solid in enumerate(solids, start=1)]


def _labelled_bodies(
    file: str, volume: Volume, role: BodyKind, files: CaseFiles, notices: list[str]
) -> list[GivenBody]:
    """A body for each piece of the labels that are tumours or of the second class, with its label's name."""
    wanted, said = labels_of_bodies(volume, files.labels, role)
    notices += [f"{volume.name}: {text}" for text in said]
    pieces, sizes = label_pieces(volume.labels, [volume.numbers_of((each,)) for each in wanted])
    order = np.argsort(-sizes[1:], kind="stable") + 1
    diameters_m = np.cbrt(6.0 * sizes[order] * volume.voxel_volume_m3 / np.pi)
    notices += _on_noise(diameters_m, role, volume.name)
    n_large = int((diameters_m >= LEAST_TUMOUR_DIAMETER_M).sum())
    if n_large > MOST_TUMOURS:
        notices.append(f"{volume.name}: of {n_large:,} pieces the {MOST_TUMOURS} largest are kept")
    order, diameters_m = order[: min(n_large, MOST_TUMOURS)], diameters_m[: min(n_large, MOST_TUMOURS)]
    found: list[GivenBody] = []
    for number, (piece, diameter_m) in enumerate(zip(order, diameters_m, strict=True), start=1):
        box = box_of(pieces == piece)
        mask = pieces[box] == piece
        solid = surface_of(mask, shifted(volume.T_lps_voxel, box), tumour_surface(float(diameter_m)))
        name = file if len(order) == 1 else f"{file}: {role} {number}"
        if called := _label_name(volume, int(volume.labels[box][mask][0]), wanted):
            name += f" ({called})"
        found.append(GivenBody(name=name, solid=solid))
    return found


def _label_name(volume: Volume, number: int, wanted: Sequence[int]) -> str:
    """The name of the wanted label that a voxel's number stands for; empty where the file gives none."""
    members = volume.overlaps.get(number, (number,))
    return next(
        (volume.label_names[each] for each in members if each in wanted and each in volume.label_names), ""
    )


def _without_organ(
    bodies: list[GivenBody], role: BodyKind, file: str, organ: Solid, notices: list[str]
) -> list[GivenBody]:
    """The bodies without the organ itself, which some files of tumours hold as well.

    Raises:
        MeshError: There is nothing else.
    """
    kept = []
    for body in bodies:
        share = _filled_share(organ, body.solid)
        if share >= WHOLE_SHARE and len(bodies) == 1:
            raise MeshError(
                f"{file}: fills {share:.0%} of the organ, so it is the organ itself and no {role} in it; name the "
                f"{role}'s own file, or its label by `{role}_label`"
            )
        if share >= ORGAN_SHARE and len(bodies) > 1:
            notices.append(
                f"{body.name}: fills {share:.0%} of the organ, so it is taken for the organ itself, which the file "
                f"holds beside its {role}s, and left out"
            )
            continue
        if share >= REMARKABLE_SHARE:
            notices.append(f"{body.name}: fills {share:.0%} of the organ; check that it is a {role}")
        kept.append(body)
    return kept


def _filled_share(organ: Solid, body: Solid) -> float:
    """The share of an organ that a body fills; 0 where its volume tells that it is small."""
    if body.volume_m3 < 0.5 * REMARKABLE_SHARE * organ.volume_m3:
        return 0.0
    return float(body.contains(organ.sample_inside(N_DRAWS, np.random.default_rng(0))).mean())


def _about_organ(
    bodies: list[GivenBody], role: BodyKind, file: str, organ: Solid, notices: list[str]
) -> list[GivenBody]:
    """The bodies without those that lie apart from the organ, where others of the same file do not."""
    if len(bodies) < 2:
        return bodies
    is_there = [_is_about(organ, each.solid) for each in bodies]
    n_apart = len(bodies) - sum(is_there)
    if not n_apart or not any(is_there):
        return bodies
    noun, verb = (f"a {role}", "was") if n_apart == 1 else (f"{n_apart:,} {role}s", "were")
    notices.append(f"{file}: {noun} outside the organ {verb} dropped")
    return [each for each, holds in zip(bodies, is_there, strict=True) if holds]


def _is_about(organ: Solid, body: Solid) -> bool:
    inside = organ.contains(body.sample_inside(N_DRAWS, np.random.default_rng(0))).mean()
    return bool(inside >= LEAST_INSIDE_SHARE) or is_left_out(organ, body)
