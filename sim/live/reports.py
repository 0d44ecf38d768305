"""Reports: what the outside says, in the world's frame and SI units, whichever transport brought it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.episode.planned.planned_organ import PlannedOrgan
from sim.world.sensing.reading import Reading

from .errors import RefusedError

FREE, TUMOUR = 1, 2
"""Labels of an image: what was seen and holds no tumour, and tumour; 0 was not seen."""
RIGID = 1e-3
"""Largest entry of R^T R - I of a pose that came in single precision."""
MOST_POINTS = 1000
"""Points in the organ, of an image or of a message of points, that the map learns from: a reading of the cone has as
many."""
MOST_LISTED = 20_000
"""Points that a message of points may list, and of an image that are looked at for whether they lie in the organ."""
SAW_NOTHING = "The sensor saw nothing of the organ there."
"""Why a pose is declined from which a reading has no point."""
FARTHEST_M = 2.0
"""A tip or a point farther from the organ than this is in another frame or unit [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TipMoved:
    """Where the probe's tip is."""

    T_world_probe: NDArray[np.float64]
    """Pose of the tip, +z along the beam, shape (4, 4) [m]."""
    stamp_s: float | None
    """When it was there, in seconds since 1970; None where nobody says."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PointsSensed:
    """Labelled points that the probe saw from where it was last."""

    points_m: NDArray[np.float64]
    """Points, world frame [m], shape (N, 3)."""
    is_occupied: NDArray[np.bool_]
    """Whether each is taken for tumour, shape (N,)."""
    stamp_s: float | None
    """When they were seen, in seconds since 1970; None where nobody says."""
    log_odds: NDArray[np.float64] | None = None
    """How far each label can be believed, as of a `Reading`, shape (N,); None where nobody says."""
    weight: NDArray[np.float64] | None = None
    """For how many labels each counts, as of a `Reading`, shape (N,); None where nobody says."""
    most: int | None = None
    """How many of the points in the organ are learnt at most, drawn evenly; None for all."""

    @classmethod
    def of_reading(cls, reading: Reading, stamp_s: float | None) -> PointsSensed:
        """What a sensor of ours read."""
        return cls(
            points_m=reading.points_m,
            is_occupied=reading.is_occupied,
            stamp_s=stamp_s,
            log_odds=reading.log_odds,
            weight=reading.weight,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseDeclined:
    """A pose that the probe cannot be brought to."""

    pose_index: int
    reason: str
    stamp_s: float | None
    """When that was found, in seconds since 1970; None where nobody says."""


Report = TipMoved | PointsSensed | PoseDeclined


def check_report(report: Report, organ: PlannedOrgan) -> None:
    """Nothing, if a report may be of this organ.

    Raises:
        RefusedError: It may not.
    """
    if isinstance(report, PoseDeclined):
        return
    values = report.T_world_probe if isinstance(report, TipMoved) else report.points_m
    if not np.isfinite(values).all():
        raise RefusedError("malformed", "a value is not finite")
    if isinstance(report, TipMoved):
        R = values[:3, :3]
        if np.abs(R.T @ R - np.eye(3)).max() > RIGID or np.linalg.det(R) < 0.0:
            raise RefusedError(
                "wrong frame", "the tip's pose is not a rotation: it scales, shears or mirrors"
            )
    places_m = values[None, :3, 3] if isinstance(report, TipMoved) else values
    low_m, high_m = organ.organ.bounds_m
    off_m = np.maximum(np.maximum(low_m - places_m, places_m - high_m), 0.0)
    farthest_m = float(np.linalg.norm(off_m, axis=1).max(initial=0.0))
    if farthest_m > FARTHEST_M:
        raise RefusedError("wrong frame", f"a place is {farthest_m:.3g} m from the organ; is its unit mm?")


def reading_of(report: PointsSensed, T_world_probe: NDArray[np.float64], organ: PlannedOrgan) -> Reading:
    """The reading of labelled points: those that lie in the organ, thinned evenly where they are too many.

    Args:
        report: The points.
        T_world_probe: Where the tip was, shape (4, 4) [m].
        organ: The organ.
    """
    kept = np.flatnonzero(organ.organ.contains(report.points_m))
    kept = kept if report.most is None else kept[thinned(len(kept), report.most)]
    return Reading(
        report.points_m[kept],
        report.is_occupied[kept],
        T_world_probe,
        log_odds=None if report.log_odds is None else report.log_odds[kept],
        weight=None if report.weight is None else report.weight[kept],
    )


def points_of_image(
    labels: NDArray[np.integer],
    T_world_index: NDArray[np.float64],
    *,
    stamp_s: float | None,
    most: int = MOST_LISTED,
) -> PointsSensed:
    """The points of a labelled image, thinned evenly where there are more than can be looked at.

    Args:
        labels: 0 not seen, 1 free, 2 tumour, shape (I, J, K).
        T_world_index: Maps indices to the world [m], shape (4, 4).
        stamp_s: When the image was taken.
        most: Points to keep at most, at least 1.

    Raises:
        RefusedError: A label has another value.
    """
    if labels.min(initial=0) < 0 or labels.max(initial=0) > TUMOUR:
        known = f"0 not seen, {FREE} free, {TUMOUR} tumour"
        raise RefusedError("malformed", f"the image has labels other than {known}")
    places = np.flatnonzero(labels)
    places = places[thinned(len(places), most)]
    seen, values = np.column_stack(np.unravel_index(places, labels.shape)), labels.ravel()[places]
    points_m = seen @ T_world_index[:3, :3].T + T_world_index[:3, 3]
    return PointsSensed(points_m=points_m, is_occupied=values == TUMOUR, stamp_s=stamp_s, most=MOST_POINTS)


def thinned(n: int, most: int) -> NDArray[np.intp]:
    """The indices of `most` of n things at most, in order and without a pattern that rows of an image might share.

    Args:
        n: How many there are.
        most: How many to keep at most.
    """
    if n <= most:
        return np.arange(n)
    return np.sort(np.random.default_rng(0).choice(n, most, replace=False, shuffle=False))
