"""Readings that a map takes in together: those of a sweep, whose cones overlap, with what was seen twice said once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .labelled_points import LabelledPoints


def merged(readings: Sequence[LabelledPoints], spacing_m: float) -> list[LabelledPoints]:
    """Readings of one sweep as one, without the points of later readings that say what earlier ones said already.

    A point is left out where a label of an earlier reading lies in its cube of side `spacing_m`, and all labels in the
    cube agree. A map whose labels are exact learns nothing more from it.

    Args:
        readings: What the sensor returned one after the other; where labels say how far they can be believed, each is
            kept, since views that may be wrong confirm one another.
        spacing_m: Side of the cubes [m]; 0 keeps every point.

    Returns:
        One reading; those that were given where they do not go together.
    """
    given = list(readings)
    if len(given) < 2:
        return given
    told = [(each.log_odds is not None, each.weight is not None) for each in given]
    if len(set(told)) > 1:
        return given
    points_m = np.concatenate([each.points_m for each in given])
    is_occupied = np.concatenate([each.is_occupied for each in given])
    if told[0] != (False, False) or spacing_m <= 0.0:
        parts = {
            name: None
            if getattr(given[0], name) is None
            else np.concatenate([getattr(each, name) for each in given])
            for name in ("log_odds", "weight")
        }
        return [LabelledPoints(points_m, is_occupied, **parts)]
    view = np.repeat(np.arange(len(given)), [len(each.points_m) for each in given])
    if not len(points_m):
        return [LabelledPoints(points_m, is_occupied)]
    _, cube = np.unique(np.floor(points_m / spacing_m).astype(np.int64), axis=0, return_inverse=True)
    cube = cube.ravel()
    first = np.full(cube.max() + 1, len(given))
    np.minimum.at(first, cube, view)
    n_occupied = np.bincount(cube, weights=is_occupied)
    agree = (n_occupied == 0) | (n_occupied == np.bincount(cube))
    is_kept = (view == first[cube]) | ~agree[cube]
    return [LabelledPoints(points_m[is_kept], is_occupied[is_kept])]
