"""Teaching a map, which may be a user's own: what is known of its labels goes along where the map takes it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

from ..detailed_map import DetailedMap
from ..hilbert_map import HilbertMap
from ..labelled_points import LabelledPoints
from ..tumour_map import TumourMap

_FEW = 3
"""Up to so many readings are sooner taught anew than moved at once."""


def teach(tumour_map: TumourMap, labels: LabelledPoints) -> None:
    """Updates a map with labels; a map that takes no doubts gets the labels alone.

    Args:
        tumour_map: The map, which may be a user's own.
        labels: What a sensing action returned.
    """
    told = {
        name: values
        for name, values in (("log_odds", labels.log_odds), ("weight", labels.weight))
        if values is not None and _takes(tumour_map, name)
    }
    tumour_map.update(labels.points_m, labels.is_occupied, **told)


def settle(tumour_map: TumourMap) -> None:
    """Has a map do what its last update has put off, where it puts off anything.

    Args:
        tumour_map: The map, which may be a user's own.
    """
    if isinstance(tumour_map, HilbertMap | DetailedMap):
        tumour_map.settle()


def laid_anew(
    tumour_map: TumourMap,
    readings: Sequence[LabelledPoints],
    new_map: Callable[[], TumourMap],
    *,
    is_far: bool,
) -> TumourMap:
    """A map of readings that lie elsewhere than where they were taught, the last of which is new.

    A map in detail moves what decides near tumour, and its coarse map only where they have moved by much, at once.
    Where there are few readings, or a map can move nothing, another is taught them one after the other.

    Args:
        tumour_map: The map of the readings before the last, which may be changed.
        readings: All readings where they lie now.
        new_map: Makes a map without readings.
        is_far: Whether some reading has moved by much since it was laid into a new map.
    """
    is_detailed = type(tumour_map) is DetailedMap
    is_soonest = not is_far or len(readings) > _FEW
    if is_detailed and is_soonest and tumour_map.lay_labels(readings, is_far=is_far):
        return tumour_map
    laid = new_map()
    if isinstance(laid, DetailedMap) and is_detailed:
        laid.lay_labels(readings)
    else:
        for each in readings:
            teach(laid, each)
    return laid


def _takes(tumour_map: Any, name: str) -> bool:
    """Whether the `update` of a map takes an argument of that name."""
    parameters = inspect.signature(tumour_map.update).parameters.values()
    return any(each.name == name or each.kind is each.VAR_KEYWORD for each in parameters)
