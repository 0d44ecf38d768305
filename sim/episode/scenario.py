"""Scenarios: which organ, which tumours, which probe and which lattices an episode runs on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from sim.errors import UsageError
from sim.world.anatomy.case_files import CaseFiles
from sim.world.meshes.coordinates import MeshFrame, Unit
from sim.world.volumes.label_coding import CodingName

if TYPE_CHECKING:
    from sim.world.anatomy.case_files import Body

TumourShape = Literal["sphere", "lobulated"]
TumourLoad = Literal["fixed", "lits"]
Placing = Literal["table", "best"]
PAPER_ORGAN = "paper-organ"
LIVER = "liver"
GENERATED_LIVER = "generated-liver"
NAMED_ORGANS = (LIVER, PAPER_ORGAN, GENERATED_LIVER)
MOST_NAME_LETTERS = 40
PAPER_UNIT_M = 0.03
"""One unit of length of the paper; see docs/architecture.md."""


def _require(holds: bool, text: str) -> None:
    if not holds:
        raise UsageError(text)


def _require_one_of(name: str, value: object, known: tuple[str, ...]) -> None:
    _require(value in known, f"{name}={value!r}: {' or '.join(known)}.")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything about the case at hand; SI units. Any field can be set in a scenario's TOML file."""

    name: str = "scenario"
    """Name under which results are kept."""
    organ: Body = LIVER
    """`liver` (the embedded one), `generated-liver` (one of its own for each seed), `paper-organ` (the paper's
    synthetic surface), the path of a mesh or a label volume, or a closed surface in memory (a `Solid` or a
    `trimesh.Trimesh`, in metres and patient axes)."""
    files: CaseFiles | None = None
    """A patient's files, where there are more than the organ's; `organ` is then left out."""
    organ_seed: int | None = None
    """Seed of a generated liver; by default the episode's, so that every seed has another."""
    target_name: str = "target"
    """What to call a second class that is mapped beside the tumours, for example cysts."""
    keepout_distance_m: float = 0.005
    """Poses closer than this to a structure to keep away from are left out [m]."""
    n_tumours: int = 3
    """Tumours to plant where no file holds any; 0 is allowed."""
    tumour_load: TumourLoad = "fixed"
    """`fixed`: `n_tumours` of them. `lits`: number and diameters are drawn by seed as LiTS has them."""
    tumour_shape: TumourShape = "lobulated"
    """Planted tumours are `sphere`s of one radius or `lobulated` shapes of many sizes."""
    tumour_radius_m: float = 0.4 * PAPER_UNIT_M
    """Radius of planted spheres [m]."""
    tumour_diameter_range_m: tuple[float, float] = (0.008, 0.040)
    """Range of the diameters of planted lobulated tumours [m]."""
    cone_half_angle_rad: float = math.radians(11.5)
    """Half-angle of the sensed cone [rad]."""
    cone_depth_m: float = 3.4 * PAPER_UNIT_M
    """Depth of the sensed cone along its axis [m]."""
    n_poses: int = 5000
    """Sensing poses on the organ's upper surface; the paper's organ has its own 14,400."""
    score_spacing_m: float = 0.003
    """Spacing of the lattice on which the map is queried and scored [m]; the paper's organ has its own."""
    organ_position_m: tuple[float, float, float] | None = None
    """Where the organ's own origin lies in the world [m]; by default the organ is laid on the table."""
    organ_quaternion: tuple[float, float, float, float] | None = None
    """Orientation of the organ's axes in the world (wxyz), together with `organ_position_m`."""
    organ_turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How the organ on the table is turned from anterior up: about the world's x, then y, then z [rad]."""
    organ_placing: Placing = "table"
    """`table`: as turned. `best`: whichever way up brings the largest surface within the arm's reach."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("n_tumours", "n_poses"):
            value = getattr(self, name)
            _require(type(value) is int, f"{name}={value!r}: a whole number.")
        for name in ("tumour_radius_m", "cone_half_angle_rad", "cone_depth_m", "score_spacing_m"):
            value = getattr(self, name)
            _require(type(value) in (int, float), f"{name}={value!r}: a number.")
        _require(0 <= self.n_tumours <= 50, f"n_tumours={self.n_tumours}: from 0 to 50.")
        self._check_files()
        self._check_target()
        _require(
            self.tumour_shape in get_args(TumourShape),
            f"tumour_shape={self.tumour_shape!r}: sphere or lobulated.",
        )
        _require(
            0.001 <= self.tumour_radius_m <= 0.1,
            f"tumour_radius_m={self.tumour_radius_m}: from 0.001 to 0.1 m.",
        )
        low_m, high_m = self.tumour_diameter_range_m
        _require(
            0.002 <= low_m <= high_m <= 0.2,
            f"tumour_diameter_range_m={self.tumour_diameter_range_m}: two rising lengths from 0.002 to 0.2 m.",
        )
        half_angle_deg = math.degrees(self.cone_half_angle_rad)
        _require(
            1.0 <= half_angle_deg <= 80.0,
            f"cone half-angle {half_angle_deg:.3g} degrees: from 1 to 80 degrees.",
        )
        _require(0.005 <= self.cone_depth_m <= 1.0, f"cone_depth_m={self.cone_depth_m}: from 0.005 to 1 m.")
        _require(50 <= self.n_poses <= 100_000, f"n_poses={self.n_poses}: from 50 to 100000.")
        _require(
            0.001 <= self.score_spacing_m <= 0.02, f"score_spacing_m={self.score_spacing_m}: 0.001 to 0.02 m."
        )
        if (self.organ_position_m is None) != (self.organ_quaternion is None):
            raise UsageError("organ_position_m and organ_quaternion belong together: give both or neither.")

    def has_organ(self, name: str) -> bool:
        """Whether the organ is the one of that name that Sounding brings along."""
        return self.files is None and isinstance(self.organ, str) and self.organ == name

    @property
    def is_named_organ(self) -> bool:
        """Whether the organ is one of those that Sounding brings along."""
        return any(self.has_organ(name) for name in NAMED_ORGANS)

    @property
    def case_files(self) -> CaseFiles | None:
        """The files of the case; None where the organ is one that Sounding brings along."""
        if self.is_named_organ:
            return None
        return self.files or CaseFiles(organ=self.organ)

    @property
    def has_target(self) -> bool:
        """Whether a second class is mapped beside the tumours."""
        return self.files is not None and self.files.has_targets

    def _check_target(self) -> None:
        name, n_most = self.target_name, MOST_NAME_LETTERS
        is_name = (
            type(name) is str and 0 < len(name) <= n_most and name.isprintable() and name == name.strip()
        )
        _require(is_name, f"target_name={name!r}: a name of 1 to {n_most} letters.")
        _require(
            self.has_target or name == "target",
            f"target_name={name!r}: names nothing. Give the class's bodies (`target` or `target_label`; in a scenario "
            "file target_files or target_labels), or leave the name out.",
        )

    def _check_files(self) -> None:
        _require(
            self.files is None or (isinstance(self.organ, str) and self.organ == LIVER),
            "organ, files: both name an organ. Leave `organ` out, and name it in the files.",
        )
        kinds = {"tumour_load": TumourLoad, "organ_placing": Placing}
        for name, kind in kinds.items():
            _require_one_of(name, getattr(self, name), get_args(kind))
        if self.files is not None:
            _check_reading(self.files)
        _require(
            0.0 <= self.keepout_distance_m <= 0.1,
            f"keepout_distance_m={self.keepout_distance_m}: from 0 to 0.1 m.",
        )
        _require(
            len(self.organ_turn_rad) == 3 and all(math.isfinite(each) for each in self.organ_turn_rad),
            f"organ_turn_rad={self.organ_turn_rad}: three angles.",
        )
        _require(
            self.organ_seed is None or (type(self.organ_seed) is int and self.organ_seed >= 0),
            f"organ_seed={self.organ_seed}: a whole number from 0 on.",
        )


def _check_reading(files: CaseFiles) -> None:
    """Nothing, if labels, unit, frame and spacing are ones that there are; texts name the keys of a scenario file."""
    kinds = {
        "organ_unit": (files.unit, Unit),
        "organ_frame": (files.frame, MeshFrame),
        "label_coding": (files.labels.coding, CodingName),
    }
    for name, (value, kind) in kinds.items():
        _require_one_of(name, value, get_args(kind))
    for role in ("organ", "tumours", "targets", "structures", "keepouts"):
        labels = getattr(files.labels, role)
        is_labels = all(type(each) is int and 1 <= each <= 65_535 for each in labels)
        _require(is_labels, f"{role.removesuffix('s')}_labels={labels}: whole numbers from 1 to 65535.")
    spacing_m = files.spacing_m
    if spacing_m is not None:
        is_spacing = len(spacing_m) == 3 and all(2e-5 <= each <= 0.03 for each in spacing_m)
        _require(is_spacing, f"voxel_spacing_m={spacing_m}: three lengths from 0.00002 to 0.03 m.")


SCENARIOS: dict[str, Scenario] = {
    "sphere": Scenario(name="sphere", organ=PAPER_ORGAN, n_tumours=1, tumour_shape="sphere"),
    "spheres": Scenario(name="spheres", organ=PAPER_ORGAN, n_tumours=3, tumour_shape="sphere"),
    "liver": Scenario(name="liver", cone_half_angle_rad=math.radians(15.0), cone_depth_m=0.13),
    "generated-liver": Scenario(
        name="generated-liver",
        organ=GENERATED_LIVER,
        tumour_load="lits",
        cone_half_angle_rad=math.radians(15.0),
        cone_depth_m=0.13,
    ),
}
"""The paper's scenario 1 and 2; in place of its LiTS case, the embedded liver; and a liver of its own for each seed.

The paper does not state its cone. For the synthetic organ it is pinned down by the baselines; for the liver it is that
of an abdominal probe, 130 mm deep and 70 mm wide at that depth.
"""
