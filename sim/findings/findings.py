"""Findings: what a map calls tumour, piece by piece, against the true tumours.

A piece is a connected component of the lattice points that the map calls tumour. A piece that touches a true tumour is
a finding of it, and is divided where it touches several. A piece that touches no tumour is a false finding. What
touching means, `Pieces` says, and nobody else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from sim.episode.measures import NEVER, SENSED_GOAL, FirstSteps
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import closest_points_on_triangles

from .components import Pieces, grid_around
from .evidence import Evidence
from .mapped_surface import Overlap, overlap, surface_gap, surface_of


@dataclass(frozen=True, eq=False, kw_only=True)
class TumourFinding:
    """One true tumour, and what the map made of it."""

    tumour: int
    """Number of the tumour, from 1."""
    is_found: bool | None
    """Whether the last map calls enough of it tumour (`Pieces.is_found`); None without a map."""
    first_seen_step: int | None
    """The first action whose cone held some of it."""
    sensed_step: int | None
    """The action after which 95 % of it was sensed."""
    first_mapped_step: int | None
    """The first action after which the map called some of it tumour, among those whose map was kept."""
    sensed_fraction: float | None
    """Share of its detection points that was sensed; None without actions or points."""
    attainable_fraction: float | None
    """Share of its detection points that reachable poses can sense; None where that is not known."""
    highest_probability: float | None = None
    """The highest probability of the last map's points nearest to it; None without a map."""
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

    @property
    def dice(self) -> float | None:
        """Dice of what was mapped of it with it, 0 where nothing was; None without a map."""
        if self.is_found is None:
            return None
        return 0.0 if self.overlap is None else self.overlap.dice

    @property
    def mapped_volume_m3(self) -> float | None:
        """The volume of what was mapped of it, 0 where nothing was; None without a map."""
        if self.is_found is None:
            return None
        return 0.0 if self.overlap is None else self.overlap.mapped_volume_m3


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
    has_map: bool
    """Whether there was a map that could find anything."""
    target: Findings | None = None
    """What the map of a second class found, with its bodies in the tumours' place; None where none was mapped."""
    visible_fraction: float | None = None
    """Share of the organ that lies in some pose's cone, of which alone findings can tell; None for a run that was
    killed."""

    @property
    def n_found(self) -> int:
        """The number of tumours that were found."""
        return sum(bool(finding.is_found) for finding in self.tumours)


def find(evidence: Evidence) -> Findings:
    """The findings of the last map of an episode, and those of the map of a second class."""
    target = None if evidence.target is None else find(evidence.target)
    pieces = pieces_of(evidence, float(logit(evidence.probability)))
    tumours = tuple(_tumour(evidence, i, pieces) for i in range(len(evidence.anatomy.tumours)))
    false = sorted(_false_findings(evidence, pieces), key=lambda finding: -finding.volume_m3)
    numbered = (dataclasses.replace(finding, finding=i + 1) for i, finding in enumerate(false))
    return Findings(
        evidence.probability,
        tumours,
        tuple(numbered),
        pieces is not None,
        target,
        evidence.visible_fraction,
    )


def pieces_of(evidence: Evidence, level: float) -> Pieces | None:
    """What the last map calls tumour if it does so from some log-odds on; None without a map."""
    if evidence.field is None:
        return None
    return Pieces.of(
        evidence.field,
        level,
        evidence.anatomy.organ,
        evidence.detection_points_m,
        evidence.detection_tumours,
        len(evidence.anatomy.tumours),
    )


def _tumour(evidence: Evidence, index: int, pieces: Pieces | None) -> TumourFinding:
    solid = evidence.anatomy.tumours[index]
    of_tumour = evidence.detection_tumours == index
    first_seen, attainable = evidence.first_seen[of_tumour], evidence.is_attainable
    has_points = bool(first_seen.size)
    finding = TumourFinding(
        tumour=index + 1,
        is_found=None if pieces is None else bool(pieces.is_found[index]),
        first_seen_step=_first(first_seen),
        sensed_step=_sensed_step(first_seen),
        first_mapped_step=None,
        sensed_fraction=float((first_seen != NEVER).mean()) if has_points and evidence.n_steps else None,
        attainable_fraction=(
            None if attainable is None or not has_points else float(attainable[of_tumour].mean())
        ),
        true_volume_m3=solid.volume_m3,
        true_centroid_m=(centre_m := solid.centroid_m),
        depth_m=_depth_m(evidence.anatomy.organ, centre_m),
    )
    if pieces is None:
        return finding
    cells = pieces.field.nearest(evidence.detection_points_m[of_tumour])
    log_odds = pieces.field.log_odds[tuple(cells.T)]
    finding = dataclasses.replace(
        finding,
        first_mapped_step=_first_mapped(evidence, pieces, cells),
        highest_probability=float(expit(log_odds.max())) if log_odds.size else None,
    )
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
    values = pieces.values(grid, pieces.is_of(points_m, tumour=index))
    surface = surface_of(grid, values)
    is_true = grid.is_in(solid) & grid.is_in(pieces.organ)
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


def _false_findings(evidence: Evidence, pieces: Pieces | None) -> Iterator[FalseFinding]:
    for piece in pieces.false if pieces is not None else ():
        assert pieces is not None
        is_piece = pieces.labels == piece
        grid = grid_around(pieces.box_of(is_piece))
        points_m = grid.points_m()
        values = pieces.values(grid, pieces.is_of(points_m, piece=piece))
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
            tumour_distance_m=_distance_to_tumours_m(evidence, centre_m),
            first_mapped_step=_first_mapped(evidence, pieces, np.argwhere(is_piece)),
            surface=surface_of(grid, values),
        )


def _first_mapped(evidence: Evidence, pieces: Pieces, cells: NDArray[np.intp]) -> int | None:
    """The first action after which the map called one of some lattice points tumour."""
    field = pieces.field
    number = np.full(field.is_inside.shape, -1)
    number[field.is_inside] = np.arange(field.n_inside)
    wanted = np.unique(number[tuple(cells.T)])
    return _first(evidence.first_called[wanted[wanted >= 0]])


def _distance_to_tumours_m(evidence: Evidence, point_m: NDArray[np.float64]) -> float | None:
    if not len(evidence.detection_points_m):
        return None
    return float(np.linalg.norm(evidence.detection_points_m - point_m, axis=1).min())


def _first(steps: FirstSteps) -> int | None:
    """The first of the actions; None where there is none."""
    first = int(steps.min(initial=NEVER))
    return None if first == NEVER else first


def _sensed_step(first_seen: FirstSteps) -> int | None:
    """The action by which 95 % of some points had been seen; None where it never came to that."""
    shares = np.arange(1, len(first_seen) + 1) / len(first_seen) if len(first_seen) else np.empty(0)
    return _first(np.sort(first_seen)[shares >= SENSED_GOAL])
