"""What users bring along by text, made with the options that they give it."""

from __future__ import annotations

from typing import Any

from mapping import MapSpace, TumourMap, TumourMapFactory
from sim.episode.planned.checks import MAP_METHODS, map_fault
from sim.errors import FieldError
from sim.plugs import MAP, PlugError, load_plug, make_plug, parse_plug_options


def own_plug(text: str, kind: Any, words: tuple[str, ...]) -> Any:
    """What a user brings along by text, made with its options.

    Args:
        text: Names it, as package.module:Class.
        kind: What it has to be.
        words: Its options as name=value.

    Raises:
        PlugError: It cannot be made.
    """
    return make_plug(text, kind, parse_plug_options(words))


def own_map(text: str, words: tuple[str, ...]) -> TumourMapFactory:
    """What makes the map that a user brings along by text; a text that leads nowhere is told now.

    Args:
        text: Names it, as package.module:Class.
        words: Its options as name=value.

    Raises:
        PlugError: It cannot be loaded. What is returned raises it too, where no map is made.
    """
    load_plug(text, MAP)
    options = parse_plug_options(words)

    def make(space: MapSpace) -> TumourMap:
        made = make_plug(text, MAP, options, space)
        if (fault := map_fault(made)) is not None:
            raise PlugError(
                f"`map` '{text}' returned {fault}; a map has the methods {', '.join(MAP_METHODS)}. Name a class that "
                "has them, or a function that returns an object of one."
            )
        return made

    return make


def refuse_options(field: str, words: tuple[str, ...], whose: str) -> None:
    """Refuse options of a plug where there is none.

    Args:
        field: The field that holds them.
        words: The options.
        whose: Whose they would be, and what has none.

    Raises:
        FieldError: There are options.
    """
    if words:
        raise FieldError(field, words, f"goes only with a {whose} has no such options.")
