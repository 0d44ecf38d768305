"""Teaching a map, which may be a user's own: what is known of its labels goes along where the map takes it."""

from __future__ import annotations

import inspect
from typing import Any

from ..labelled_points import LabelledPoints
from ..tumour_map import TumourMap


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


def _takes(tumour_map: Any, name: str) -> bool:
    """Whether the `update` of a map takes an argument of that name."""
    parameters = inspect.signature(tumour_map.update).parameters.values()
    return any(each.name == name or each.kind is each.VAR_KEYWORD for each in parameters)
