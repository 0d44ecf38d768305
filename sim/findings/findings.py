"""Findings: what a map calls tumour, piece by piece, against the true tumours.

A piece is a connected component of the lattice points that the map calls tumour. A piece that touches a true tumour is
a finding of it, and is divided where it touches several. A piece that touches no tumour is a false finding.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from sim.episode.measures import SENSED_GOAL
from sim.record.map_field import called_from
from sim.record.run_record import RunRecord
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import closest_points_on_triangles

from .components import Pieces, grid_around
from .mapped_surface import Overlap, overlap, surface_gap, surface_of


@dataclass(frozen=True, eq=False, kw_only=True)
class TumourFinding:
    """One true tumour, and what the map made of it."""

    tumour: int
    """Number of the tumour, from 1."""
    is_found: bool | None
    """Whether a piece of the last map touches it; None without a map."""
    first_seen_step: int | None
    """The first action whose cone held some of it."""
    sensed_step: int | None
    """The action after which 95 % of it was sensed."""
    first_mapped_step: int | None
    """The first action after which the map called some of it tumour, among those whose map was kept."""
    sensed_fraction: float | None
    """Share of its detection points that was sensed; None without actions or points."""
    true_volume_m3: float
    true_centroid_m: NDArray[np.float64]
    overlap: Overlap | None = None
    """How what was mapped of it compares with it; None where it was not found."""
    surface_mean_m: float | None = None
    """Mean distance between the mapped and the true surface, both ways."""
    surface_hausdorff95_m: float | None = None
    """95th percentile of the distances between the two surfaces, the larger of both ways."""
    surface: Solid | None = None
    """The mapped surface, world frame [m]."""
    depth_m: float
    """Distance from its centre to the organ's surface."""

    @property
    def diameter_m(self) -> float:
        """The diameter of a ball of its volume."""
        return float(np.cbrt(6.0 * self.true_volume_m3 / np.pi))


@dataclass(frozen=True, eq=False, kw_only=True)
class FalseFinding:
    """A piece that the map calls tumour and that touches no tumour."""

    finding: int
    """Number of the false finding, from 1; the largest has the first."""
    volume_m3: float
    centroid_m: NDArray[np.float64]
    highest_probability: float
    tumour_distance_m: float | None
    """Distance from its centroid to the nearest point of a true tumour; None without tumours."""
    first_mapped_step: int | None
    """The first action after which the map called some of it tumour, among those whose map was kept."""
    surface: Solid | None
    """The mapped surface, world frame [m]; None where the grid was too coarse for one."""


@dataclass(frozen=True, eq=False)
class Findings:
    """All of a run's findings at its end."""

    probability: float
    """The probability from which the map calls a point tumour."""
    tumours: tuple[TumourFinding, ...]
    false: tuple[FalseFinding, ...]
    target: Findings | None = None
    """What the map of a second class found, with its bodies in the tumours' place; None where none was mapped."""
    visible_fraction: float | None = None
    """Share of the organ that lies in some pose's cone, of which alone findings can tell; None for a run that was
    killed."""

    @property
    def n_found(self) -> int:
        """The number of tumours that were found."""
        return sum(bool(finding.is_found) for finding in self.tumours)


def find(record: RunRecord) -> Findings:
    """The findings of the last map of a run, and those of the map of a second class."""
    target = None if record.target is None else find(record.target)
    probability = called_from(float(record.config["map"]["prior_prevalence"]))
    pieces = None
    if record.field is not None:
        pieces = Pieces.of(
            record.field,
            float(logit(probability)),
            record.anatomy.organ,
            record.detection_points_m,
            record.detection_tumours,
            len(record.anatomy.tumours),
        )
    is_seen = record.is_seen()
    tumours = tuple(_tumour(record, i, pieces, is_seen) for i in range(len(record.anatomy.tumours)))
    false = sorted(_false_findings(record, pieces), key=lambda finding: -finding.volume_m3)
    numbered = (dataclasses.replace(finding, finding=i + 1) for i, finding in enumerate(false))
    visible_fraction = record.summary.get("visible_fraction")
    return Findings(probability, tumours, tuple(numbered), target, visible_fraction)


def _tumour(
    record: RunRecord, index: int, pieces: Pieces | None, is_seen: NDArray[np.bool_]
) -> TumourFinding:
    solid = record.anatomy.tumours[index]
    of_tumour = record.detection_tumours == index
    seen_share = np.empty(0)
    if of_tumour.any():
        seen_share = np.logical_or.accumulate(is_seen[:, of_tumour], axis=0).mean(axis=1)
    finding = TumourFinding(
        tumour=index + 1,
        is_found=None if pieces is None else bool(pieces.touches[:, index].any()),
        first_seen_step=_first(seen_share > 0),
        sensed_step=_first(seen_share >= SENSED_GOAL),
        first_mapped_step=None,
        sensed_fraction=float(seen_share[-1]) if len(seen_share) else None,
        true_volume_m3=solid.volume_m3,
        true_centroid_m=(centre_m := centroid_m(solid)),
        depth_m=_depth_m(record.anatomy.organ, centre_m),
    )
    if pieces is None:
        return finding
    cells = pieces.field.nearest(record.detection_points_m[of_tumour])
    finding = dataclasses.replace(finding, first_mapped_step=_first_mapped(record, pieces, cells))
    return _with_surface(finding, solid, index, pieces) if finding.is_found else finding


def _depth_m(organ: Solid, point_m: NDArray[np.float64]) -> float:
    corners_m = organ.vertices_m[organ.faces]
    closest_m = closest_points_on_triangles(np.broadcast_to(point_m, (len(corners_m), 3)), corners_m)
    return float(np.linalg.norm(closest_m - point_m, axis=1).min())


def _with_surface(finding: TumourFinding, solid: Solid, index: int, pieces: Pieces) -> TumourFinding:
    """A finding with its volume, overlap and surface."""
    is_touching = pieces.touches[:, index]
    low_m, high_m = solid.bounds_m
    grid = grid_around((low_m, high_m), pieces.box_of(is_touching[pieces.labels]))
    points_m = grid.points_m()
    values = pieces.values(points_m, pieces.is_of(points_m, tumour=index))
    surface = surface_of(grid, values)
    is_true = solid.contains(points_m)
    is_true[is_true] = pieces.organ.contains(points_m[is_true])
    if surface is None or not is_true.any():
        return finding
    mean_m, hausdorff95_m = surface_gap(surface, solid, np.random.default_rng(index))
    return dataclasses.replace(
        finding,
        overlap=overlap(grid, values > 0, is_true),
        surface_mean_m=mean_m,
        surface_hausdorff95_m=hausdorff95_m,
        surface=surface,
    )


def _false_findings(record: RunRecord, pieces: Pieces | None) -> Iterator[FalseFinding]:
    for piece in pieces.false if pieces is not None else ():
        assert pieces is not None
        is_piece = pieces.labels == piece
        grid = grid_around(pieces.box_of(is_piece))
        points_m = grid.points_m()
        values = pieces.values(points_m, pieces.is_of(points_m, piece=piece))
        is_mapped = values > 0
        lattice_m = np.array(
            [axis[i].mean() for axis, i in zip(pieces.field.axes_m, np.nonzero(is_piece), strict=True)]
        )
        centre_m = points_m[is_mapped].mean(axis=0) if is_mapped.any() else lattice_m
        yield FalseFinding(
            finding=0,
            volume_m3=float(is_mapped.sum()) * grid.cell_m3,
            centroid_m=centre_m,
            highest_probability=float(expit(pieces.field.log_odds[is_piece].max())),
            tumour_distance_m=_distance_to_tumours_m(record, centre_m),
            first_mapped_step=_first_mapped(record, pieces, np.argwhere(is_piece)),
            surface=surface_of(grid, values),
        )


def _first_mapped(record: RunRecord, pieces: Pieces, cells: NDArray[np.intp]) -> int | None:
    """The first action whose kept map calls one of the lattice points tumour."""
    field = pieces.field
    number = np.full(field.is_inside.shape, -1)
    number[field.is_inside] = np.arange(field.n_inside)
    wanted = np.unique(number[tuple(cells.T)])
    wanted = wanted[wanted >= 0]
    steps = (step for step, log_odds in record.history.items() if (log_odds[wanted] > pieces.level).any())
    return next(steps, None)


def _distance_to_tumours_m(record: RunRecord, point_m: NDArray[np.float64]) -> float | None:
    if not len(record.detection_points_m):
        return None
    return float(np.linalg.norm(record.detection_points_m - point_m, axis=1).min())


def _first(is_marked: NDArray[np.bool_]) -> int | None:
    """The number, from 1, of the first action that is marked; None without a mark."""
    return int(np.argmax(is_marked)) + 1 if is_marked.any() else None


def centroid_m(solid: Solid) -> NDArray[np.float64]:
    """The centre of a solid's volume [m], shape (3,), by the divergence theorem."""
    middle = solid.bounds_m.mean(axis=0)
    a, b, c = (solid.vertices_m[solid.faces[:, i]] - middle for i in range(3))
    sixths = np.einsum("ij,ij->i", a, np.cross(b, c))
    return middle + (sixths[:, None] * (a + b + c)).sum(axis=0) / (4.0 * sixths.sum())
