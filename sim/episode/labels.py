"""From a reading to the map: its labels with how far they can be believed."""

from __future__ import annotations

import inspect
from typing import Any

from mapping import LabelledPoints, LabelTrust, TumourMap
from sim.world.sensing.reading import Reading


def labelled(reading: Reading, trust: LabelTrust | None) -> LabelledPoints:
    """The labels of a reading, by what the sensor says of them and what is believed of the sensor.

    Args:
        reading: What the sensor returned.
        trust: How far the sensor is trusted; None where its labels are taken as they are.
    """
    plain = LabelledPoints(reading.points_m, reading.is_occupied, reading.log_odds, reading.weight)
    return plain if trust is None else trust.judge(plain)


def teach(tumour_map: TumourMap, labels: LabelledPoints) -> None:
    """Updates a map with labels; a map that takes no doubts gets the labels alone.

    Args:
        tumour_map: The map, which may be a user's own.
        labels: What a sensing action returned.
    """
    told = {
        name: values
        for name, values in (("log_odds", labels.log_odds), ("weight", labels.weight))
        if values is not None and takes(tumour_map, name)
    }
    tumour_map.update(labels.points_m, labels.is_occupied, **told)


def takes(tumour_map: Any, name: str) -> bool:
    """Whether the `update` of a map takes an argument of that name."""
    parameters = inspect.signature(tumour_map.update).parameters.values()
    return any(each.name == name or each.kind is each.VAR_KEYWORD for each in parameters)
