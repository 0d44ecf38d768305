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
_RANGES = {
    "n_tumours": (0, 50, ""),
    "n_poses": (50, 100_000, ""),
    "tumour_radius_m": (0.001, 0.1, " m"),
    "cone_depth_m": (0.005, 1.0, " m"),
    "score_spacing_m": (0.001, 0.02, " m"),
    "keepout_distance_m": (0.0, 0.1, " m"),
}
"""The least and the largest value of fields, and their unit."""


def _require(holds: bool, text: str) -> None:
    if not holds:
        raise UsageError(text)


def _require_one_of(name: str, value: object, known: tuple[str, ...]) -> None:
    _require(value in known, f"{name}={value!r}: must be {' or '.join(known)}.")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What an episode runs on, in SI units. Any field can be set in a scenario's TOML file."""

    name: str = "scenario"
    """Name under which results are kept."""
    organ: Body = LIVER
    """`liver` (the embedded one), `generated-liver` (a new one for each seed), `paper-organ` (the paper's synthetic
    surface), the path of a mesh or a label volume, or a closed surface in memory (a `Solid` or a `trimesh.Trimesh`,
    in metres and patient axes)."""
    files: CaseFiles | None = None
    """A patient's files, where there are more than the organ's; `organ` is then left out."""
    organ_seed: int | None = None
    """Seed of a generated liver; by default that of the episode, so that every seed has a new one."""
    target_name: str = "target"
    """What to call a second class that is mapped beside the tumours, for example cysts."""
    keepout_distance_m: float = 0.005
    """Poses closer than this to a structure to keep away from are left out [m]."""
    n_tumours: int = 3
    """Tumours to plant where no file holds any; 0 is allowed."""
    tumour_load: TumourLoad = "fixed"
    """`fixed` plants `n_tumours`; `lits` draws their number and diameters by seed from those of the LiTS patients."""
    tumour_shape: TumourShape = "lobulated"
    """Planted tumours are spheres of one radius (`sphere`) or lumpy bodies of many sizes (`lobulated`)."""
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
    """`table` lays the organ as turned, `best` the way up in which the cones of poses within reach see most."""

    def __post_init__(self) -> None:
        """Validate the values."""
        for name in ("n_tumours", "n_poses"):
            value = getattr(self, name)
            _require(type(value) is int, f"{name}={value!r}: must be a whole number.")
        for name in ("tumour_radius_m", "cone_half_angle_rad", "cone_depth_m", "score_spacing_m"):
            value = getattr(self, name)
            _require(type(value) in (int, float), f"{name}={value!r}: must be a number.")
        self._check_choices()
        self._check_target()
        self._check_ranges()
        self._check_place()

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
        _require(is_name, f"target_name={name!r}: must be a name of 1 to {n_most} letters.")
        _require(
            self.has_target or name == "target",
            f"target_name={name!r}: names nothing. Give the class's bodies (`target` or `target_label`; in a scenario "
            "file target_files or target_labels), or leave the name out.",
        )

    def _check_choices(self) -> None:
        _require(
            self.files is None or (isinstance(self.organ, str) and self.organ == LIVER),
            "organ, files: both name an organ. Leave `organ` out, and name it in the files.",
        )
        kinds = {"tumour_load": TumourLoad, "tumour_shape": TumourShape, "organ_placing": Placing}
        for name, kind in kinds.items():
            _require_one_of(name, getattr(self, name), get_args(kind))
        if self.files is not None:
            _check_reading(self.files)

    def _check_ranges(self) -> None:
        for name, (low, high, unit) in _RANGES.items():
            value = getattr(self, name)
            _require(low <= value <= high, f"{name}={value}: must be from {low:g} to {high:g}{unit}.")
        low_m, high_m = self.tumour_diameter_range_m
        _require(
            0.002 <= low_m <= high_m <= 0.2,
            f"tumour_diameter_range_m={self.tumour_diameter_range_m}: must be two rising lengths from 0.002 to 0.2 m.",
        )
        half_angle_deg = math.degrees(self.cone_half_angle_rad)
        _require(
            1.0 <= half_angle_deg <= 80.0,
            f"cone half-angle {half_angle_deg:.3g} degrees: must be from 1 to 80 degrees.",
        )

    def _check_place(self) -> None:
        _require(
            len(self.organ_turn_rad) == 3 and all(math.isfinite(each) for each in self.organ_turn_rad),
            f"organ_turn_rad={self.organ_turn_rad}: must be three angles.",
        )
        _require(
            self.organ_seed is None or (type(self.organ_seed) is int and self.organ_seed >= 0),
            f"organ_seed={self.organ_seed}: must be a whole number from 0 on.",
        )
        _require(
            (self.organ_position_m is None) == (self.organ_quaternion is None),
            "organ_position_m and organ_quaternion belong together: give both or neither.",
        )


def _check_reading(files: CaseFiles) -> None:
    """Check labels, unit, frame and spacing; the texts name the keys of a scenario file."""
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
        _require(
            is_labels, f"{role.removesuffix('s')}_labels={labels}: must be whole numbers from 1 to 65535."
        )
    spacing_m = files.spacing_m
    if spacing_m is not None:
        is_spacing = len(spacing_m) == 3 and all(2e-5 <= each <= 0.03 for each in spacing_m)
        _require(is_spacing, f"voxel_spacing_m={spacing_m}: must be three lengths from 0.00002 to 0.03 m.")


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
"""The paper's scenarios 1 and 2, the embedded liver in place of its LiTS case, and a new liver for each seed.

The paper does not state its cone. For the synthetic organ it follows from the results of the baselines; for the liver
it is that of an abdominal probe, 130 mm deep and 70 mm wide at that depth.
"""
