"""Organ, tumours and structures from a label volume: pieces told apart, debris dropped, surfaces drawn."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, find_objects
from scipy.spatial import KDTree

from sim.world.errors import MeshError, VolumeError
from sim.world.meshes.bodies import LEAST_DIAMETER_M
from sim.world.meshes.pieces import LEAST_SHARE, Piece, PieceError, keep_pieces
from sim.world.meshes.sizes import remarks_on_size
from sim.world.names import is_no_liver, meaning_of
from sim.world.solids.solid import Solid
from sim.world.volumes.grid import remarks_on_lost_header
from sim.world.volumes.label_coding import Coding, describe_labels
from sim.world.volumes.label_surface import (
    ORGAN_SURFACE,
    STRUCTURE_SURFACE,
    SurfaceSettings,
    surface_of,
    tumour_surface,
)
from sim.world.volumes.masks import box_of, count_pieces, filled, label_pieces
from sim.world.volumes.volume import Volume, shifted

from .structures import Structure

LEAST_ORGAN_SHARE = 0.5
"""Share of an organ's voxels that its largest piece must hold: scattered ones are no outline."""

MOST_OF_ORGAN = 0.9
"""Where the largest piece holds less than half, the pieces that are no debris must hold this share together."""

LEAST_TUMOUR_DIAMETER_M = LEAST_DIAMETER_M
"""Smaller pieces of a tumour label are taken for noise of the outline, as bodies of a mesh are [m]."""

LEAST_DRAWN_SHARE = 0.95
"""A surface that encloses less of the volume of an organ's voxels is told; of an organ it is 99.5 %."""

MOST_TUMOURS = 50
"""Tumours kept, the largest first."""

LEAST_STRUCTURE_M3 = 0.05e-6
"""Smaller structures are left out [m^3]."""

NEAR_ORGAN_M = 0.03
"""Structures are kept up to this far beyond the organ's bounding box [m]: the aorta goes on to the legs."""


@dataclass(kw_only=True)
class LabelledAnatomy:
    """What a volume holds, in patient axes [m].

    Attributes:
        organ: The organ, tumours and targets included.
        tumours: Its tumours, the largest first.
        targets: The bodies of the second class in it, the largest first.
        structures: Vessels and the like.
        notices: One sentence for each thing left out or assumed.
    """

    organ: Solid
    tumours: tuple[Solid, ...] = ()
    targets: tuple[Solid, ...] = ()
    structures: tuple[Structure, ...] = ()
    notices: list[str] = field(default_factory=list)


def anatomy_of(volume: Volume, coding: Coding, path: object, *, piece: str | None = None) -> LabelledAnatomy:
    """The anatomy that a label volume holds.

    Args:
        volume: The labels.
        coding: What they mean.
        path: The file, for messages.
        piece: The piece of the organ's label to take, as `piece 2`; None to take what lies together.

    Raises:
        VolumeError: The organ is scattered, several pieces could be it, or no surface can be drawn about it.
    """
    notices: list[str] = []
    wanted = np.zeros(int(max((*volume.counts, *volume.overlaps))) + 1, dtype=bool)
    parts = volume.numbers_of((*coding.organ, *coding.tumours, *coding.targets))
    wanted[[each for each in parts if each < len(wanted)]] = True
    box = box_of(wanted[volume.labels])
    labels, T = volume.labels[box], shifted(volume.T_lps_voxel, box)
    mask, said = _organ_pieces(wanted[labels], T, volume, piece, path)
    notices += said
    if _touches_end(mask, box, volume):
        notices.append("the organ is cut off at the end of the scan and closed with a flat face there")
    whole = filled(mask)
    organ = _surface(whole, T, ORGAN_SURFACE, path, "the organ")
    notices += _on_lost_volume(organ, float(whole.sum() * volume.voxel_volume_m3))
    name = _called(volume, coding)
    on_size = remarks_on_size(organ.volume_m3, name)
    numbers = [
        tuple(volume.numbers_of((each,)) for each in kind) for kind in (coding.tumours, coding.targets)
    ]
    tumours = _tumours(labels, T, mask, numbers[0], "tumour", path, notices)
    targets = _tumours(labels, T, mask, numbers[1], "target", path, notices)
    structures = _structures(volume, coding, organ, path, notices)
    notices += on_size
    # A liver's shape tells what a lost header said; another organ's does not.
    if not is_no_liver(name):
        notices += remarks_on_lost_header(volume, mask, is_implausible=bool(on_size))
    return LabelledAnatomy(
        organ=organ, tumours=tumours, targets=targets, structures=structures, notices=notices
    )


def _on_lost_volume(organ: Solid, voxels_m3: float) -> list[str]:
    """A sentence, where an outline is so thin that its surface holds less than its voxels."""
    if organ.volume_m3 >= LEAST_DRAWN_SHARE * voxels_m3:
        return []
    return [
        f"the organ's surface encloses {organ.volume_m3 * 1e6:.3g} ml of the {voxels_m3 * 1e6:.3g} ml of its voxels, "
        "as it is thin next to them: check that the label is an organ's, and the spacing"
    ]


def _called(volume: Volume, coding: Coding) -> str:
    """What the file calls the organ: its label's name, or the file's own."""
    names = [volume.label_names.get(label, "") for label in coding.organ]
    known = [name for name in names if meaning_of(name)]
    liver = [name for name in known if meaning_of(name) == "liver"]
    return (*liver, *known, volume.name.split(".")[0])[0]


def _organ_pieces(
    mask: NDArray[np.bool_], T: NDArray[np.float64], volume: Volume, wanted: str | None, path: object
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """The mask without what is no part of the organ, and what is said of that.

    Raises:
        VolumeError: No piece holds half of it, or several could be the organ.
    """
    numbers = np.empty(mask.shape, dtype=np.int32)
    n = count_pieces(mask, numbers)
    if n <= 1 and wanted is None:
        return mask, ()
    sizes = np.bincount(numbers.ravel())[1:]
    is_large = sizes >= LEAST_SHARE * sizes.sum()
    if sizes.max() < LEAST_ORGAN_SHARE * sizes.sum() and sizes[is_large].sum() < MOST_OF_ORGAN * sizes.sum():
        raise VolumeError(
            f"{path}: the organ's label is scattered over {n:,} pieces, of which the largest holds "
            f"{sizes.max() / sizes.sum():.0%}; it holds {describe_labels(volume)}. Pass the right `organ_label`, or "
            "clean the outline"
        )
    boxes = find_objects(numbers)
    pieces = [
        Piece(volume_m3=float(size * volume.voxel_volume_m3), middle_m=_middle_m(box, T))
        for size, box in zip(sizes, boxes, strict=True)
    ]
    try:
        kept = keep_pieces(pieces, lambda i, j: _gap_m(numbers, boxes, T, (i, j)), wanted)
    except PieceError as error:
        raise VolumeError(f"{path}: the organ's label {error}") from error
    return np.isin(numbers, np.array(kept.indices) + 1), kept.remarks


def _middle_m(box: tuple[slice, ...], T: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of a part of a grid [m]."""
    return T[:3, :3] @ [0.5 * (each.start + each.stop - 1) for each in box] + T[:3, 3]


def _gap_m(
    numbers: NDArray[np.int32], boxes: list[Any], T: NDArray[np.float64], pair: tuple[int, int]
) -> float:
    """The distance between two pieces of a mask [m], 0 where voxels of both touch by a corner."""
    trees = []
    for piece in pair:
        box = boxes[piece]
        mask = numbers[box] == piece + 1
        rim = np.argwhere(mask & ~np.asarray(binary_erosion(mask), dtype=bool)) + [each.start for each in box]
        trees.append(rim @ T[:3, :3].T)
    diagonal_m = float(np.linalg.norm(np.linalg.norm(T[:3, :3], axis=0)))
    return max(float(KDTree(trees[0]).query(trees[1])[0].min()) - diagonal_m, 0.0)


def _touches_end(mask: NDArray[np.bool_], box: tuple[slice, ...], volume: Volume) -> bool:
    """Whether the mask reaches a face of the scan."""
    ends = []
    for axis, size in enumerate(volume.scan_shape):
        along, offset = np.moveaxis(mask, axis, 0), volume.box[axis].start
        ends += [offset + box[axis].start == 0 and along[0].any()]
        ends += [offset + box[axis].stop == size and along[-1].any()]
    return any(ends)


def _tumours(
    labels: NDArray[np.uint16],
    T: NDArray[np.float64],
    organ: NDArray[np.bool_],
    wanted: tuple[tuple[int, ...], ...],
    noun: str,
    path: object,
    notices: list[str],
) -> tuple[Solid, ...]:
    """A surface for each connected piece of the tumours' labels, or the targets', in the organ."""
    if not wanted:
        return ()
    is_wanted = np.isin(labels, [number for each in wanted for number in each])
    if not is_wanted.any():
        return ()
    part = box_of(is_wanted)
    labels, T, organ = labels[part], shifted(T, part), organ[part]
    pieces, sizes = label_pieces(labels, wanted)
    voxel_m3 = abs(float(np.linalg.det(T[:3, :3])))
    inside = np.bincount(pieces[organ].ravel(), minlength=len(sizes))
    sizes[0] = inside[0] = 0
    diameters_m = np.cbrt(6.0 * sizes * voxel_m3 / np.pi)
    is_there, is_inside = sizes > 0, inside > 0
    _count(notices, is_there & ~is_inside, "outside the organ {} dropped", noun)
    is_large = diameters_m >= LEAST_TUMOUR_DIAMETER_M
    is_small = is_there & is_inside & ~is_large
    if is_small.any():
        size = f"of up to {diameters_m[is_small].max() * 1e3:.2g} mm across"
        least = f"as all under {LEAST_TUMOUR_DIAMETER_M * 1e3:g} mm are"
        _count(notices, is_small, f"{size} {{}} taken for noise of the outline and dropped, {least}", noun)
    kept = np.flatnonzero(is_there & is_inside & is_large)
    kept = kept[np.argsort(-sizes[kept], kind="stable")]
    if len(kept) > MOST_TUMOURS:
        notices.append(f"of {len(kept)} {noun}s the {MOST_TUMOURS} largest are kept")
    boxes = find_objects(pieces)
    solids = []
    for piece in kept[:MOST_TUMOURS]:
        box = boxes[piece - 1]
        settings = tumour_surface(float(diameters_m[piece]))
        solids.append(_surface(pieces[box] == piece, shifted(T, box), settings, path, f"a {noun}"))
    return tuple(solids)


def _count(notices: list[str], which: NDArray[np.bool_], text: str, noun: str) -> None:
    n = int(which.sum())
    if n:
        verb = "was" if n == 1 else "were"
        notices.append(f"{n:,} {noun} piece{'' if n == 1 else 's'} {text.format(verb)}")


def _structures(
    volume: Volume, coding: Coding, organ: Solid, path: object, notices: list[str]
) -> tuple[Structure, ...]:
    """A surface for each structure's label, as far as it lies about the organ."""
    found, far = [], []
    box = _box_about(volume, organ)
    labels, T = volume.labels[box], shifted(volume.T_lps_voxel, box)
    for name, each in {**coding.structures, **coding.keepouts}.items():
        mask = np.isin(labels, volume.numbers_of((each,)))
        if mask.sum() * volume.voxel_volume_m3 < LEAST_STRUCTURE_M3:
            if each in volume.counts:
                far.append(name)
            continue
        piece = box_of(mask)
        solid = _surface(mask[piece], shifted(T, piece), STRUCTURE_SURFACE, path, name)
        found.append(Structure(name=name, solid=solid, is_keepout=name in coding.keepouts))
    if far:
        verb = (
            "has next to no volume near the organ and is"
            if len(far) == 1
            else "have next to no volume near it and are"
        )
        notices.append(f"{', '.join(far)} {verb} left out")
    return tuple(found)


def _box_about(volume: Volume, organ: Solid) -> tuple[slice, slice, slice]:
    """The part of a volume that lies about an organ."""
    low_m, high_m = organ.bounds_m
    corners = np.stack(np.meshgrid(*zip(low_m, high_m, strict=True)), axis=-1).reshape(-1, 3)
    to_voxel = np.linalg.inv(volume.T_lps_voxel)
    indices = corners @ to_voxel[:3, :3].T + to_voxel[:3, 3]
    margin = NEAR_ORGAN_M / volume.spacing_m
    first = np.clip(np.floor(indices.min(axis=0) - margin).astype(int), 0, None)
    last = np.minimum(np.ceil(indices.max(axis=0) + margin).astype(int) + 1, volume.labels.shape)
    i, j, k = (slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
    return i, j, k


def _surface(
    mask: NDArray[np.bool_], T: NDArray[np.float64], settings: SurfaceSettings, path: object, what: str
) -> Solid:
    try:
        return surface_of(mask, T, settings)
    except MeshError as error:
        raise VolumeError(f"{path}: {what}: {error}; clean the outline and load it again") from error
