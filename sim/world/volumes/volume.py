"""A label volume: which structure each voxel of a scan belongs to, and where the voxels lie in the patient.

Patient axes are LPS here (+x left, +y back, +z head), metres; NIfTI files are RAS millimetres and are turned
when read.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

AXIS_LETTERS = (("R", "L"), ("A", "P"), ("I", "S"))
"""Where decreasing and increasing LPS coordinates lead: right and left, front and back, foot and head."""

BARE_TOLERANCE = 1e-6
"""Share by which the voxels of a lost header may differ from 1 mm."""

OBLIQUE_RAD = np.deg2rad(0.5)
"""A volume is oblique if an axis is turned further off the patient's axes than this."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Volume:
    """Labels on a grid of voxels: the part of a scan that holds any.

    Attributes:
        labels: Label of each voxel, 0 for none, shape (I, J, K), uint16. Where labels overlap, a number that stands for
            all of them.
        T_lps_voxel: Affine map of indices of `labels` to patient axes [m], shape (4, 4).
        box: The part of the scan's voxels that `labels` are.
        scan_shape: Numbers of voxels of the whole scan.
        counts: Number of voxels of each label that occurs, 0 left out; a voxel of several counts for each.
        name: The file's name.
        notices: One sentence for each remarkable property.
        label_names: Names of labels that the file itself gives.
        overlaps: The numbers of `labels` that stand for several labels, and these.
        is_bare: Whether the header has voxels of 1 mm along the patient's axes, as one that was lost has.
        is_respaced: Whether the spacing is not the header's but given.
        is_turned: Whether the axes are not the header's but given.
    """

    labels: NDArray[np.uint16]
    T_lps_voxel: NDArray[np.float64]
    box: tuple[slice, slice, slice]
    scan_shape: tuple[int, int, int]
    counts: Mapping[int, int]
    name: str
    notices: tuple[str, ...] = ()
    label_names: Mapping[int, str] = field(default_factory=dict)
    overlaps: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    is_bare: bool = False
    is_respaced: bool = False
    is_turned: bool = False

    def numbers_of(self, labels: Iterable[int]) -> tuple[int, ...]:
        """The numbers of voxels that have at least one of some labels."""
        wanted = tuple(labels)
        shared = (number for number, members in self.overlaps.items() if set(members) & set(wanted))
        return (*wanted, *shared)

    def label_text(self, label: int) -> str:
        """A label with its name, if the file gives it one."""
        return f"{label} {self.label_names[label]!r}" if label in self.label_names else str(label)

    @property
    def spacing_m(self) -> NDArray[np.float64]:
        """Distance between neighbouring voxels along each axis [m], shape (3,)."""
        return np.linalg.norm(self.T_lps_voxel[:3, :3], axis=0)

    @property
    def voxel_volume_m3(self) -> float:
        """Volume of a voxel [m^3]."""
        return float(abs(np.linalg.det(self.T_lps_voxel[:3, :3])))

    @property
    def orientation(self) -> str:
        """Direction in which each axis mainly runs, for example LPS or RAS."""
        return orientation_of(self.T_lps_voxel[:3, :3])

    @property
    def obliquity_rad(self) -> float:
        """Largest angle between an axis of the grid and the patient axis that it mainly follows [rad]."""
        directions = np.abs(self.T_lps_voxel[:3, :3] / self.spacing_m)
        return float(np.arccos(np.clip(directions.max(axis=0).min(), 0.0, 1.0)))

    @property
    def is_oblique(self) -> bool:
        """Whether the grid is turned off the patient's axes."""
        return self.obliquity_rad > OBLIQUE_RAD


def counts_with_overlaps(
    counts: Mapping[int, int], overlaps: Mapping[int, tuple[int, ...]]
) -> dict[int, int]:
    """Number of voxels of each label, those that several labels hold included.

    Args:
        counts: Number of voxels of each number.
        overlaps: Numbers that stand for several labels.
    """
    found: dict[int, int] = {}
    for number, n in counts.items():
        for label in overlaps.get(number, (number,)):
            found[label] = found.get(label, 0) + n
    return dict(sorted(found.items()))


def directions_of(letters: str) -> NDArray[np.float64] | None:
    """The directions in LPS of axes that are named by letters, as columns, shape (3, 3); None if they are no axes.

    Args:
        letters: Where the axes run, for example RAS.
    """
    columns = []
    for letter in letters.upper():
        for axis, pair in enumerate(AXIS_LETTERS):
            if letter in pair:
                columns.append(np.eye(3)[axis] * (1.0 if letter == pair[1] else -1.0))
    if len(letters) != 3 or len(columns) != 3:
        return None
    matrix = np.array(columns).T
    return matrix if abs(np.linalg.det(matrix)) > 0.5 else None


def is_bare(T_lps_voxel: NDArray[np.float64]) -> bool:
    """Whether a map of voxels has steps of 1 mm along the patient's axes in their order, as a lost header has."""
    steps = np.abs(T_lps_voxel[:3, :3])
    return bool(np.allclose(steps, np.eye(3) * 1e-3, rtol=0.0, atol=1e-3 * BARE_TOLERANCE))


def orientation_of(axes: NDArray[np.float64]) -> str:
    """Direction in which each axis of a grid mainly runs, for example LPS or RAS.

    Args:
        axes: The axes in LPS as columns, of any length, shape (3, 3).
    """
    letters = []
    for column in axes.T:
        axis = int(np.abs(column).argmax())
        letters.append(AXIS_LETTERS[axis][int(column[axis] > 0)])
    return "".join(letters)


def shifted(T_lps_voxel: NDArray[np.float64], box: tuple[slice, ...]) -> NDArray[np.float64]:
    """The map of a part's own indices to the patient, shape (4, 4)."""
    T = np.array(T_lps_voxel)
    T[:3, 3] = T[:3, :3] @ [each.start for each in box] + T[:3, 3]
    return T
