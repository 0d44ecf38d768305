"""Where a NIfTI volume lies: the answers that its header holds, and which of them each tool follows.

A header has room for two maps of voxels to the patient. The sform is any affine map; the qform is a rotation, a shift
and the spacings. Each has a code, 0 where it is not set. nibabel follows the sform where its code is set, then the
qform. ITK, and with it 3D Slicer, takes a sform only if its code is 1 (scanner) or the qform has no code, and if its
axes are at right angles with the header's spacings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .volume import orientation_of

Affine = NDArray[np.float64]

SCANNER = 1
"""The code with which ITK prefers a sform to a qform."""

SAME_MM = 0.25
"""Answers whose voxels all lie closer than this are one [mm]: a qform's quaternion is kept in single precision."""

SAME_ANGLE_RAD = np.deg2rad(0.1)
"""Smaller turns between two answers are not worth a word."""

SAME_SPACING = 1e-3
"""Share of a spacing by which ITK lets the lengths of a sform's axes differ from the header's."""

LPS_FROM_RAS = np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False, kw_only=True)
class Place:
    """One answer to where a volume lies.

    Attributes:
        affine: Map of voxel indices to RAS [mm], shape (4, 4).
        shape: Numbers of voxels.
    """

    affine: Affine
    shape: tuple[int, ...]

    @property
    def text(self) -> str:
        """Where the middle lies, and the directions of the axes."""
        middle = self.affine @ [*((np.array(self.shape) - 1) / 2), 1.0]
        numbers = " ".join(f"{each + 0.0:.1f}" for each in np.round(middle[:3] * LPS_FROM_RAS, 1))
        axes = self.affine[:3, :3] * LPS_FROM_RAS[:, None]
        return f"its middle lies at LPS {numbers} mm, its axes run {orientation_of(axes)}"

    def apart_mm(self, other: Place) -> float:
        """The farthest that a voxel of one place lies from the same voxel of the other [mm]."""
        ends = np.stack(np.meshgrid(*((0, n - 1) for n in self.shape), indexing="ij"), axis=-1).reshape(-1, 3)
        moved = self.affine - other.affine
        return float(np.linalg.norm(ends @ moved[:3, :3].T + moved[:3, 3], axis=1).max())

    def against(self, other: Place) -> str:
        """What differs between two places, beside the middle and the axes' letters; empty if nothing does."""
        one, two = self.affine[:3, :3], other.affine[:3, :3]
        if np.linalg.det(one) * np.linalg.det(two) < 0.0:
            return ", so that one is the mirror image of the other"
        spacings = [np.linalg.norm(each, axis=0) for each in (one, two)]
        turn = (one / spacings[0]) @ np.linalg.inv(two / spacings[1])
        angle_rad = float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
        texts = [f"turned by {np.rad2deg(angle_rad):.3g} degrees"] if angle_rad > SAME_ANGLE_RAD else []
        if not np.allclose(*spacings, rtol=SAME_SPACING):
            first, second = (" x ".join(f"{each:.4g}" for each in spacing) for spacing in spacings)
            texts.append(f"with voxels of {first} mm in place of {second} mm")
        return f", {' and '.join(texts)}" if texts else ""


def remarks_on_place(header: Any, affine: Affine, shape: tuple[int, ...], *, unit_mm: float) -> list[str]:
    """A sentence or two, where tools disagree about the place of a volume or none is named.

    Args:
        header: nibabel's header.
        affine: The map of voxel indices to RAS in the header's unit that is followed here, which is nibabel's.
        shape: Numbers of voxels; volumes that have no three axes get no remarks.
        unit_mm: The header's unit [mm].
    """
    if len(shape) < 3 or not np.isfinite(affine).all() or not np.linalg.det(affine[:3, :3]):
        return []

    def place(T: Affine | None) -> Place | None:
        return None if T is None else Place(affine=np.diag([unit_mm] * 3 + [1.0]) @ T, shape=shape[:3])

    s_code, (qform, q_code) = int(header["sform_code"]), _qform(header)
    followed, by_qform, by_itk = place(affine), place(qform), place(itk_affine(header))
    assert followed is not None
    if not s_code and not q_code:
        return _without_code(followed, by_itk)
    if s_code and by_qform is not None and followed.apart_mm(by_qform) > SAME_MM:
        is_on_scan = by_itk is not None and by_itk.apart_mm(followed) <= SAME_MM
        return [_two_answers(followed, by_qform, (s_code, q_code), is_on_scan=is_on_scan)]
    if by_itk is None:
        return [
            "the axes of its sform are not at right angles, as ITK wants them; they are followed, as in nibabel"
        ]
    if by_itk.apart_mm(followed) > SAME_MM:
        return [_other_spacings(followed, by_itk)]
    return []


def _two_answers(followed: Place, by_qform: Place, codes: tuple[int, int], *, is_on_scan: bool) -> str:
    others = "ITK and 3D Slicer follow it too" if is_on_scan else "ITK and 3D Slicer follow the qform"
    where = "older tools that follow the qform" if is_on_scan else "ITK and 3D Slicer"
    return (
        f"its header holds two answers to where it lies, up to {followed.apart_mm(by_qform):.3g} mm apart: by the "
        f"sform (code {codes[0]}) {followed.text}; by the qform (code {codes[1]}) {by_qform.text}"
        f"{by_qform.against(followed)}. The sform is followed here, as in nibabel, since it is what registration "
        f"writes; {others}. In {where} the map will not lie on the scan: if the qform is right, copy it over the "
        "sform, and otherwise the sform over the qform (nibabel's set_sform and set_qform)"
    )


def _other_spacings(followed: Place, by_itk: Place) -> str:
    return (
        f"the spacings of its header contradict its sform: by the sform, which is followed here as in nibabel, "
        f"{followed.text}; ITK and 3D Slicer take the spacings, by which {by_itk.text}{by_itk.against(followed)}. The "
        f"map will lie on the scan in nibabel, and up to {by_itk.apart_mm(followed):.3g} mm off it in ITK and 3D Slicer"
    )


def _without_code(followed: Place, by_itk: Place | None) -> list[str]:
    remarks = [
        "the header names no patient axes; its grid is taken for LAS, as NIfTI prescribes: check left and right"
    ]
    if by_itk is not None and by_itk.apart_mm(followed) > SAME_MM:
        remarks.append(
            f"without patient axes tools disagree about where it lies: here, as in nibabel, {followed.text}; in ITK "
            f"and 3D Slicer {by_itk.text}{by_itk.against(followed)}. The map will lie on the scan in nibabel, and up "
            f"to {by_itk.apart_mm(followed):.3g} mm off it in ITK and 3D Slicer: export the volume with its axes"
        )
    return remarks


def itk_affine(header: Any) -> Affine | None:
    """The map of voxel indices to RAS [header's unit] that ITK takes, shape (4, 4); None where it takes none.

    Args:
        header: nibabel's header.
    """
    (sform, s_code), (qform, q_code) = header.get_sform(coded=True), _qform(header)
    zooms = np.abs(np.asarray(header["pixdim"][1:4], dtype=np.float64))
    if s_code and sform is not None:
        is_usable, is_square = _fits(sform, zooms)
        if is_usable and (s_code == SCANNER or not q_code):
            return np.asarray(sform, dtype=np.float64)
        if not q_code:
            return _respaced(sform, zooms) if is_square else None
    if q_code:
        return qform
    # Without a code its axes are LPS, and its first voxel lies at the origin.
    return np.diag([-zooms[0], -zooms[1], zooms[2], 1.0])


def _fits(sform: Affine, zooms: NDArray[np.float64]) -> tuple[bool, bool]:
    """Whether ITK takes a sform as it is, and whether its axes are at right angles."""
    lengths = np.linalg.norm(sform[:3, :3], axis=0)
    if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        return False, False
    R = sform[:3, :3] / lengths
    is_square = bool(np.abs(R.T @ R - np.eye(3)).max() < SAME_SPACING)
    return is_square and bool(np.allclose(lengths, zooms, rtol=SAME_SPACING)), is_square


def _respaced(sform: Affine, zooms: NDArray[np.float64]) -> Affine:
    T = np.array(sform, dtype=np.float64)
    T[:3, :3] *= zooms / np.linalg.norm(T[:3, :3], axis=0)
    return T


def _qform(header: Any) -> tuple[Affine | None, int]:
    """The qform and its code; one that is no rotation counts as not set."""
    try:
        qform, code = header.get_qform(coded=True)
    except ValueError:
        return None, 0
    return (None, 0) if qform is None else (np.asarray(qform, dtype=np.float64), int(code))
