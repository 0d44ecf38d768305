"""What users bring along by text, made with the options that they give it."""

from __future__ import annotations

from typing import Any

from sim.errors import FieldError
from sim.plugs import make_plug, parse_plug_options


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
