"""Organ, tumours and structures from files: meshes, label volumes, or both, in one frame.

All coordinates are those of the files in metres, taken for patient axes (LPS: +x left, +y back, +z head). Label
volumes say where they lie; meshes are LPS unless their header or the user says RAS.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.world.errors import MeshError, VolumeError
from sim.world.meshes.bodies import separate_solids
from sim.world.meshes.meshes import load_mesh, load_surface
from sim.world.meshes.pieces import is_piece_name
from sim.world.names import fold
from sim.world.solids.solid import Solid
from sim.world.volumes.files import is_volume, load_volume
from sim.world.volumes.label_coding import LabelChoice, describe_labels
from sim.world.volumes.label_meaning import coding_of
from sim.world.volumes.label_surface import STRUCTURE_SURFACE, surface_of
from sim.world.volumes.masks import box_of
from sim.world.volumes.volume import Volume, shifted

from .anatomy import joined_with_organ
from .case_files import CaseFiles
from .given.bodies import BodyKind, given_bodies, solid_of
from .given.whereabouts import check_organ_extent, remarks_on_distance
from .label_anatomy import LabelledAnatomy, anatomy_of
from .structures import Structure

if TYPE_CHECKING:
    from .case_files import Body


@dataclass(frozen=True, eq=False, kw_only=True)
class LoadedAnatomy:
    """An anatomy in the coordinates of its files, LPS [m].

    Attributes:
        organ: The organ.
        tumours: Its tumours.
        tumour_names: What to call each.
        targets: The bodies of a second class to be mapped.
        target_names: What to call each.
        structures: Vessels and other structures.
        notices: One sentence for each repair, assumption and remarkable property.
    """

    organ: Solid
    tumours: tuple[Solid, ...] = ()
    tumour_names: tuple[str, ...] = ()
    targets: tuple[Solid, ...] = ()
    target_names: tuple[str, ...] = ()
    structures: tuple[Structure, ...] = ()
    notices: tuple[str, ...] = ()


def load_anatomy(files: CaseFiles, *, volume: Volume | None = None) -> LoadedAnatomy:
    """The anatomy that files hold.

    Args:
        files: The files.
        volume: The organ's label volume, where the caller has loaded it already.

    Raises:
        WorldError: A file cannot be used.
    """
    notices: list[str] = []
    if not isinstance(files.organ, str):
        found = LabelledAnatomy(organ=solid_of(files.organ, "organ"))
    elif is_volume(files.organ):
        found = _labelled(files, volume or load_volume(files.organ, **reading_of(files)), notices)
    else:
        found = _from_mesh(files, notices)
        _refuse_labels(files)
    check_organ_extent(found.organ, organ_name(files), _remedy_for_extent(files))
    tumours, tumour_names = _with_files(found, "tumour", files, notices)
    targets, target_names = _with_files(found, "target", files, notices)
    if not targets and (files.targets or files.labels.targets):
        raise VolumeError(
            f"{organ_name(files)}: nothing is left of the target class ({'; '.join(notices)}); pass another "
            "`target_label`, or leave it out"
        )
    organ = found.organ
    for names, bodies, role in ((tumour_names, tumours, "tumour"), (target_names, targets, "target")):
        organ, said = joined_with_organ(organ, list(zip(names, bodies, strict=True)), role)
        notices += said
    structures = list(found.structures)
    structures += [_structure(file, files, notices, is_keepout=False) for file in files.structures]
    structures += [_structure(file, files, notices, is_keepout=True) for file in files.keepouts]
    notices += remarks_on_distance(tuple(structures), organ)
    return LoadedAnatomy(
        organ=organ,
        tumours=tumours,
        tumour_names=tumour_names,
        targets=targets,
        target_names=target_names,
        structures=tuple(structures),
        notices=tuple(notices),
    )


def _with_files(
    found: LabelledAnatomy, role: BodyKind, files: CaseFiles, notices: list[str]
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    """The tumours or targets that the organ's file holds and those in files of their own, and their names."""
    solids = list(found.tumours if role == "tumour" else found.targets)
    names = [f"{organ_name(files)}: {role} {i + 1}" for i in range(len(solids))]
    given = given_bodies(role, files, found.organ, notices)
    return (*solids, *(each.solid for each in given)), (*names, *(each.name for each in given))


def _remedy_for_extent(files: CaseFiles) -> str:
    """What to do where the organ is too small or too large to be one."""
    if not isinstance(files.organ, str):
        return "a surface in memory is in metres"
    if is_volume(files.organ):
        return "pass the scan's own spacing as `spacing_mm` X Y Z, or another `organ_label`"
    return "check the unit of its coordinates (`unit`)"


def organ_name(files: CaseFiles) -> str:
    """What to call the organ in messages: its file's name."""
    return Path(files.organ).name if isinstance(files.organ, str) else "the organ in memory"


def _from_mesh(files: CaseFiles, notices: list[str]) -> LabelledAnatomy:
    """The organ of a mesh file, and what else its objects are."""
    mesh = load_mesh(
        str(files.organ), files.unit, role="organ", frame=files.frame, organ_object=files.organ_object
    )
    notices += mesh.notices
    tumours: list[Solid] = []
    for body in mesh.tumours:
        solids, said = separate_solids(body, "tumour")
        notices += [f"{mesh.name}: {text}" for text in said]
        tumours += [each for each in solids if mesh.solid.contains(each.vertices_m).any()]
        if n_outside := len(solids) - sum(any(each is kept for kept in tumours) for each in solids):
            noun = "a tumour's body" if n_outside == 1 else f"{n_outside} bodies of tumours"
            notices.append(
                f"{mesh.name}: {noun} outside the organ {'was' if n_outside == 1 else 'were'} dropped"
            )
    tumours.sort(key=lambda each: -each.volume_m3)
    structures = tuple(Structure(name=name, solid=solid) for name, solid in mesh.structures.items())
    return LabelledAnatomy(organ=mesh.solid, tumours=tuple(tumours), structures=structures)


def _labelled(files: CaseFiles, volume: Volume, notices: list[str]) -> LabelledAnatomy:
    labels, piece = _choice(files, volume)
    coding, remarks = coding_of(volume, labels, str(files.organ))
    found = anatomy_of(volume, coding, str(files.organ), piece=piece)
    said = [*remarks, *found.notices]
    notices += [*volume.notices, *(f"{volume.name}: {text}" for text in said)]
    return found


def _choice(files: CaseFiles, volume: Volume) -> tuple[LabelChoice, str | None]:
    """What is said of the labels and of the organ's pieces; an object may be a label by its name.

    Raises:
        VolumeError: There is no label of that name.
    """
    name, labels = files.organ_object, files.labels
    if any(map(is_label_volume, files.tumours)):
        # The others are those of the tumours' own files.
        labels = replace(labels, tumours=tuple(each for each in labels.tumours if each in volume.counts))
    if any(map(is_label_volume, files.targets)):
        labels = replace(labels, targets=tuple(each for each in labels.targets if each in volume.counts))
    if name is None or is_piece_name(name):
        return labels, name
    named = [label for label, each in volume.label_names.items() if fold(each) == fold(name)]
    if not named or files.labels.organ:
        raise VolumeError(
            f"{files.organ}: `organ_object` {name!r} is no name of a label in the file, which holds "
            f"{describe_labels(volume)}; pass one of these names or `organ_label` N"
            if not named
            else f"{files.organ}: `organ_label` and `organ_object` both name the organ; leave one out"
        )
    return replace(labels, organ=tuple(named)), None


def reading_of(files: CaseFiles) -> dict[str, Any]:
    """What is said of the grids of volumes, as arguments of `load_volume`."""
    return {"spacing_m": files.spacing_m, "axes": files.voxel_axes}


def is_label_volume(body: Body) -> bool:
    """Whether a body is to be read from a label volume."""
    return isinstance(body, str) and is_volume(body)


def _refuse_labels(files: CaseFiles) -> None:
    """Nothing, unless labels are named and there is only a mesh.

    Raises:
        MeshError: They are.
    """
    labels = files.labels
    if (
        (labels.organ or labels.structures or labels.keepouts)
        or (labels.tumours and not any(is_label_volume(file) for file in files.tumours))
        or (labels.targets and not any(is_label_volume(file) for file in files.targets))
    ):
        raise MeshError(
            f"{files.organ}: labels go with a label volume (.nii, .nii.gz, .nrrd), and this is a mesh; give "
            "tumours as `tumour` FILE, targets as `target` FILE, structures as `structure` FILE or `keepout` FILE"
        )


def _structure(file: str, files: CaseFiles, notices: list[str], *, is_keepout: bool) -> Structure:
    name = Path(file).name.split(".")[0]
    if not is_volume(file):
        surface = load_surface(file, files.unit, frame=files.frame)
        notices += surface.notices
        return Structure(name=name, solid=surface.solid, is_keepout=is_keepout)
    volume = load_volume(file, **reading_of(files))
    notices += volume.notices
    if len(volume.counts) > 1:
        raise VolumeError(
            f"{file}: holds {len(volume.counts)} labels, and a structure's file one; name labels of the organ's "
            "own volume with `structure_label` or `keepout_label`"
        )
    box = box_of(volume.labels > 0)
    solid = surface_of(volume.labels[box] > 0, shifted(volume.T_lps_voxel, box), STRUCTURE_SURFACE)
    return Structure(name=name, solid=solid, is_keepout=is_keepout)
