"""The kinds of plugs, and how an object shows that it is of one.

The base classes are imported when an object is looked at, so that naming a kind costs nothing.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class PlugKind:
    """What can be brought along in one place."""

    name: str
    """What a plug of this kind is called, and the option that takes its text."""
    group: str
    """Entry points of this group are plugs of this kind."""
    expected: str
    """What a plug of this kind is, to follow "a planner is" in an error."""
    fault: Callable[[Any], str | None]
    """What keeps an object from being a plug of this kind, to follow its name in an error; None where nothing does."""


def _what(plug: Any) -> str:
    """What an object is that is no class, in words."""
    if inspect.ismodule(plug):
        return "is a module"
    return "is a function" if inspect.isroutine(plug) else f"is an object of the type {type(plug).__name__}"


def _planner_fault(plug: Any) -> str | None:
    from planner import Planner

    if not isinstance(plug, type):
        return _what(plug)
    if not issubclass(plug, Planner):
        return "derives from another class"
    return _undefined(plug) or (None if hasattr(plug, "needs_belief") else "does not set needs_belief")


def _sensor_fault(plug: Any) -> str | None:
    # `Sensor` itself is not looked at, since its module needs MuJoCo; all that derive from it have the method.
    if not isinstance(plug, type):
        return _what(plug)
    if not callable(getattr(plug, "sense", None)):
        return "has no method sense"
    return _undefined(plug)


def _map_fault(plug: Any) -> str | None:
    return _undefined(plug) if callable(plug) else _what(plug)


def _undefined(plug: Any) -> str | None:
    """The methods that an abstract class leaves open, as a fault."""
    missing = sorted(getattr(plug, "__abstractmethods__", ())) if inspect.isabstract(plug) else []
    return f"does not define {' and '.join(missing)}" if missing else None


PLANNER = PlugKind(
    name="planner",
    group="sounding.planners",
    expected="a class that derives from planner.Planner, defines rank and sets needs_belief",
    fault=_planner_fault,
)
SENSOR = PlugKind(
    name="sensor",
    group="sounding.sensors",
    expected="a class with a method sense, as sim.world.sensing.sensor.Sensor describes it",
    fault=_sensor_fault,
)
MAP = PlugKind(
    name="map",
    group="sounding.maps",
    expected="a class or a function that makes a map",
    fault=_map_fault,
)
