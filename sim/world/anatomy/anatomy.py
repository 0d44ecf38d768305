"""An organ with its tumours: the truth of an episode.

Truth is what lies inside the organ and inside a tumour. Segmented tumours may protrude by some millimetres;
what protrudes is never sensed and counts as nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.world.errors import AnatomyError, MeshError
from sim.world.solids.solid import Solid, check_points

from .structures import Structure

N_DETECTION_POINTS = 500
"""Points per tumour whose share within the cones is the paper's measure of detection."""

LEAST_INSIDE_SHARE = 0.5
"""A tumour with a smaller share of its volume inside the organ belongs elsewhere."""

REMARKABLE_OUTSIDE_SHARE = 0.01
"""Share of a tumour outside the organ that is worth a notice."""

MAX_DRAWS = 50
"""Rounds of drawing points of a tumour that are also inside the organ."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Organ and tumours in one frame, with the points by which detection is measured.

    Use `build_anatomy`, which draws the points and checks that the tumours fit.

    Attributes:
        organ: The organ.
        tumours: The tumours, possibly none.
        name: What to call it in outputs.
        notices: What a user should know of it, one sentence each.
        detection_points_m: Points drawn evenly inside each tumour and the organ [m], shape (D, 3).
        detection_tumours: Index of the tumour each of these lies in, shape (D,).
        structures: Vessels and the like, in the same frame.
        target: A second class to be mapped, as an anatomy of its own: the same organ, with the class's bodies in the
            tumours' place and the class's name. None where there is none.
    """

    organ: Solid
    tumours: tuple[Solid, ...]
    name: str
    notices: tuple[str, ...]
    detection_points_m: NDArray[np.float64]
    detection_tumours: NDArray[np.int64]
    structures: tuple[Structure, ...] = ()
    target: Anatomy | None = None

    def is_inside_organ(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point inside the organ. Points [m], shape (N, 3); result shape (N,)."""
        return self.organ.contains(points_m)

    def is_tumour(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point inside the organ and a tumour. Points [m], shape (N, 3); result shape (N,)."""
        return self.tumour_of(points_m) >= 0

    def tumour_of(self, points_m: ArrayLike) -> NDArray[np.int64]:
        """Index of the first tumour that holds each point, or -1.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,); -1 for points outside the organ too.
        """
        points = check_points(points_m)
        tumour_of = np.full(len(points), -1, dtype=np.int64)
        for index in reversed(range(len(self.tumours))):
            tumour_of[self.tumours[index].contains(points)] = index
        held = np.flatnonzero(tumour_of >= 0)
        tumour_of[held[~self.organ.contains(points[held])]] = -1
        return tumour_of

    @property
    def tumour_volumes_m3(self) -> NDArray[np.float64]:
        """Volume of each tumour's mesh [m^3], shape (number of tumours,)."""
        return np.array([tumour.volume_m3 for tumour in self.tumours], dtype=np.float64)


def build_anatomy(
    organ: Solid,
    tumours: tuple[Solid, ...] = (),
    *,
    name: str,
    rng: np.random.Generator,
    notices: tuple[str, ...] = (),
    tumour_names: tuple[str, ...] | None = None,
    n_detection_points: int = N_DETECTION_POINTS,
    structures: tuple[Structure, ...] = (),
    target: Anatomy | None = None,
) -> Anatomy:
    """An anatomy whose tumours have been checked to lie in the organ.

    Args:
        organ: The organ.
        tumours: The tumours in the same frame; none is allowed.
        name: What to call it in outputs.
        rng: Source of the detection points.
        notices: What a user should know of it already, for instance from the loader.
        tumour_names: What to call each tumour in messages; "tumour 1", "tumour 2", ... by default.
        n_detection_points: Detection points per tumour.
        structures: What lies in or about the organ, in the same frame.
        target: The second class, if there is one; its notices become those of the whole.

    Returns:
        The anatomy.

    Raises:
        AnatomyError: A tumour lies mostly outside the organ.
    """
    names = tumour_names or tuple(f"tumour {i + 1}" for i in range(len(tumours)))
    if len(names) != len(tumours):
        raise AnatomyError(f"{len(names)} tumour names were given for {len(tumours)} tumours")
    remarks, points = list(notices), [np.empty((0, 3))]
    for tumour, tumour_name in zip(tumours, names, strict=True):
        inside_m, outside_share = _draw_inside(organ, tumour, tumour_name, n_detection_points, rng)
        points.append(inside_m)
        if outside_share > REMARKABLE_OUTSIDE_SHARE:
            remarks.append(
                f"{tumour_name}: {outside_share:.0%} of it protrudes from the organ and is left out"
            )
    remarks += target.notices if target is not None else ()
    points_m = np.concatenate(points)
    tumour_index = np.repeat(np.arange(len(tumours)), n_detection_points)
    points_m.setflags(write=False)
    tumour_index.setflags(write=False)
    return Anatomy(
        organ, tuple(tumours), name, tuple(remarks), points_m, tumour_index, tuple(structures), target
    )


def _draw_inside(
    organ: Solid, tumour: Solid, name: str, n: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], float]:
    """Points even in the part of the tumour inside the organ, shape (n, 3), and the share of it outside."""
    kept: list[NDArray[np.float64]] = []
    n_kept = n_drawn = 0
    for _ in range(MAX_DRAWS):
        try:
            drawn = tumour.sample_inside(max(n, 1), rng)
        except MeshError as error:
            raise AnatomyError(f"{name}: has no interior; remove it or export it again") from error
        kept.append(drawn[organ.contains(drawn)])
        n_kept, n_drawn = n_kept + len(kept[-1]), n_drawn + len(drawn)
        inside_share = n_kept / n_drawn
        if inside_share < LEAST_INSIDE_SHARE:
            raise AnatomyError(
                f"{name}: only {inside_share:.0%} of it lies inside the organ, at least "
                f"{LEAST_INSIDE_SHARE:.0%} must; check that both files share one frame and unit"
            )
        if n_kept >= n:
            break
    return np.concatenate(kept)[:n], 1.0 - n_kept / n_drawn
