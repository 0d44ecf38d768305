"""The sensor that images: a sweep of B-mode planes about the contact."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.errors import FieldError
from sim.suggestions import did_you_mean
from sim.world.anatomy.anatomy import Anatomy
from sim.world.memory import spare_bytes
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor
from sim.world.sensing.sweep import Sweep

from .convex_array import ConvexArray
from .imager import Imager
from .label_grid import LabelGrid, cut_grid
from .labels import exact_labels
from .settings import Settings
from .sweep_pattern import sweep_pattern
from .tissues import BY_LESION, lesion_bodies, tissue_named, tissue_of_structure


@dataclass(frozen=True, kw_only=True)
class TissueChoice:
    """Which tissue everything in a scene is, by the names of `TISSUES`."""

    organ: str = "liver"
    """Tissue of the organ."""
    tumour: str = "hypoechoic"
    """Tissue of the tumours; or `by-lesion`, where each has a look of its own."""
    target: str = "hyperechoic"
    """Tissue of the bodies of a second class."""
    surroundings: str = "fat"
    """Tissue about the organ, where no structure lies."""
    structures: tuple[tuple[str, str], ...] = ()
    """Tissues of structures, as pairs of a structure's name and a tissue; by default what the name says."""

    def __post_init__(self) -> None:
        """Checks that the tissues are known."""
        for name in ("organ", "target", "surroundings"):
            tissue_named(getattr(self, name), field=f"{name}_tissue")
        if self.tumour != BY_LESION:
            tissue_named(self.tumour, field="tumour_tissue", others=(BY_LESION,))
        for _, tissue in self.structures:
            tissue_named(tissue, field="structure_tissue")


@dataclass(frozen=True, kw_only=True)
class UltrasoundSensor(Sensor):
    """Sweeps a convex array about the contact, draws its planes, and labels points on them.

    The planes are rocked about the axis x of the tip through the angle of the cone. A reading has the points at which
    enough of the pulse is left: none behind bone or gas, none too deep, none on a line that lost contact.
    """

    array: ConvexArray = field(default_factory=ConvexArray)
    """The array. Its depth is the cone's unless `has_own_depth`."""
    settings: Settings = field(default_factory=Settings)
    """What the machine is set to."""
    tissues: TissueChoice = field(default_factory=TissueChoice)
    """How the scene sounds."""
    has_own_depth: bool = False
    """Whether the array keeps its own depth and does not take that of the cone."""
    n_planes: int = 16
    """Planes of a sweep."""
    half_sweep_rad: float | None = None
    """Angle of the first and the last plane to the beam [rad]; None for the cone's half-angle."""
    middle_rock_rad: float = 0.0
    """Angle to the beam of the middle of the sweep [rad], and so that of a single plane."""
    n_points: int = 1500
    """Points on all planes together, of which a reading has those that were seen and lie in the organ."""
    seen_db: float = 60.0
    """Points are seen down to this loss on the way there and back [dB]; beyond it the receiver's noise is louder."""
    shadow_db: float = 20.0
    """Points lie in a shadow where more than this is lost beyond what the time-gain compensation makes up for [dB]."""
    tissue_spacing_m: float = 0.001
    """Distance of the nodes of the grid of tissues [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges, and that memory holds a sweep."""
        if not self.n_planes >= 1:
            raise FieldError("planes", self.n_planes, "must be at least 1.")
        if not self.n_points >= self.n_planes:
            raise FieldError("sweep_points", self.n_points, "must be at least 1 on each plane.")
        if self.half_sweep_rad is not None and not 0.0 <= self.half_sweep_rad < math.pi / 2.0:
            raise FieldError(
                "sweep_half_angle_deg", math.degrees(self.half_sweep_rad), "must be from 0 to below 90."
            )
        for name in ("seen_db", "shadow_db"):
            if not getattr(self, name) > 0.0:
                raise FieldError(name, getattr(self, name), "must be above 0.")
        if not self.tissue_spacing_m > 0.0:
            raise FieldError("tissue_spacing_mm", self.tissue_spacing_m * 1e3, "must be above 0.")
        needed = float(self.n_planes) * float(self.settings.n_pixels) ** 2
        if needed > spare_bytes():
            problem = (
                f"{self.n_planes} pictures take {needed / 2**30:.0f} GiB, more than there is; name fewer."
            )
            raise FieldError("image_pixels", self.settings.n_pixels, problem)

    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        """The points of a sweep that were seen, labelled, with the pictures beside them.

        Args:
            state: The scene now.
            rng: Shifts the points on the planes, and chooses the noise.
        """
        array = self.array_of(state.cone)
        imager = _imager(array, self.settings)
        grid = _grid(state.scene.anatomy, self.tissues, self.tissue_spacing_m)
        T_world_planes = self.plane_poses(state)
        noise_seeds = rng.integers(1 << 31, size=self.n_planes).tolist()
        planes, lines, samples = sweep_pattern(array, n_planes=self.n_planes, n_points=self.n_points, rng=rng)
        images, left, compensated = [], np.empty(self.n_points), np.empty(self.n_points)
        for plane, T_world_plane in enumerate(T_world_planes):
            drawn = imager.plane(grid, T_world_plane, noise_seeds[plane])
            images.append(drawn.image)
            on_plane = planes == plane
            rows, columns = samples[on_plane].round().astype(int), lines[on_plane].round().astype(int)
            left[on_plane] = drawn.left[rows, columns]
            compensated[on_plane] = left[on_plane] * imager.gains[rows]
        is_loud, is_unshadowed = left >= _factor(-self.seen_db), compensated >= _factor(-self.shadow_db)
        is_seen = is_loud & is_unshadowed
        planes, in_plane_m = planes[is_seen], array.points_m(lines[is_seen], samples[is_seen])
        T = T_world_planes[planes]
        points_m = np.einsum("nij,nj->ni", T[:, :3, :3], in_plane_m) + T[:, :3, 3]
        fan = imager.fan
        sweep = Sweep(np.stack(images), T_world_planes, fan.pixel_m, fan.left_m, fan.top_m, planes)
        return _reading(sweep, points_m, state)

    def array_of(self, cone: Cone) -> ConvexArray:
        """The array that draws, whose lines are as long as the cone unless it keeps its own depth.

        Args:
            cone: The scene's cone.
        """
        return self.array if self.has_own_depth else dataclasses.replace(self.array, depth_m=cone.depth_m)

    def plane_poses(self, state: SceneState) -> NDArray[np.float64]:
        """Where the planes of a sweep lie: the pose of the tip, rocked about its x, shape (n_planes, 4, 4)."""
        half_rad = self.half_sweep_rad if self.half_sweep_rad is not None else state.cone.half_angle_rad
        rock_rad = np.linspace(-half_rad, half_rad, self.n_planes) if self.n_planes > 1 else np.zeros(1)
        rock_rad = rock_rad + self.middle_rock_rad
        T = np.tile(np.eye(4), (self.n_planes, 1, 1))
        T[:, 1, 1] = T[:, 2, 2] = np.cos(rock_rad)
        T[:, 1, 2], T[:, 2, 1] = -np.sin(rock_rad), np.sin(rock_rad)
        return state.T_world_probe @ T


def _factor(db: float) -> float:
    """The factor of an amplitude that decibels mean."""
    return 10.0 ** (db / 20.0)


def _reading(sweep: Sweep, points_m: NDArray[np.float64], state: SceneState) -> Reading:
    """The reading of points on a sweep, those outside the organ left out."""
    labels = exact_labels(sweep, points_m, state)
    is_in = labels.is_in_organ
    return Reading(
        points_m[is_in],
        labels.is_tumour[is_in],
        state.T_world_probe,
        labels.is_target[is_in] if labels.is_target is not None else None,
        images=sweep.part(is_in),
    )


@lru_cache(maxsize=4)
def _imager(array: ConvexArray, settings: Settings) -> Imager:
    """The imager of an array, with its tables, kept for the next sweep."""
    return Imager(array, settings)


@lru_cache(maxsize=1)
def _grid(anatomy: Anatomy, choice: TissueChoice, spacing_m: float) -> LabelGrid:
    """The grid of an anatomy, kept for the next sweep of the same episode.

    Raises:
        FieldError: A tissue is given for a structure that is not there, or the grid does not fit memory.
    """
    given, names = dict(choice.structures), list(dict.fromkeys(each.name for each in anatomy.structures))
    for name in given.keys() - set(names):
        known = f"the structures here are {', '.join(names)}." if names else "there are no structures here."
        raise FieldError("structure_tissue", name, f"{known}{did_you_mean(name, names)}")
    return cut_grid(
        anatomy,
        surroundings=tissue_named(choice.surroundings, field="surroundings_tissue"),
        organ=tissue_named(choice.organ, field="organ_tissue"),
        lesions=lesion_bodies(anatomy.tumours, choice.tumour),
        target=tissue_named(choice.target, field="target_tissue"),
        structures=[tissue_of_structure(each.name, given) for each in anatomy.structures],
        spacing_m=spacing_m,
    )
