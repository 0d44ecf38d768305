"""The options of a plug, given as words."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from .errors import PlugError


def parse_plug_options(words: Sequence[str]) -> dict[str, Any]:
    """The options that words of the form `name=value` give.

    Args:
        words: A value is read as TOML: `0.2`, `true`, `[1, 2]`, `"text"`. What is no TOML is taken as text, so that
            bare words need no quotes.

    Raises:
        PlugError: A word has another form, its value can only be a slip, or a name is given twice.
    """
    options: dict[str, Any] = {}
    for word in words:
        name, equals, value = (part.strip() for part in word.partition("="))
        if not equals:
            raise PlugError(f"'{word}' is no option; write name=value, for example rate=0.2.")
        if not name.isidentifier():
            raise PlugError(
                f"'{word}': '{name}' cannot be an option's name, which holds letters, digits and underscores "
                f"only. Write the name that the class gives it, for example n_points."
            )
        if name in options:
            raise PlugError(f"'{word}': the option {name} is given twice; leave one of the two out.")
        options[name] = _read_value(word, value)
    return options


def _read_value(word: str, value: str) -> Any:
    try:
        # Within an inline table the value must end where the word ends: no comment and no further line can follow.
        document = tomllib.loads(f"option = {{value = {value}}}")
    except tomllib.TOMLDecodeError:
        document = {}
    if list(document) == ["option"] and list(document["option"]) == ["value"]:
        return document["option"]["value"]
    remedy = _slip(value)
    if remedy is not None:
        raise PlugError(f"'{word}': the value is neither TOML nor a bare word; {remedy}.")
    return value


def _slip(value: str) -> str | None:
    """The remedy for a value that is no TOML and that was hardly meant as text; None for a bare word."""
    if not value:
        return 'write "" for an empty text, or leave the option out'
    if value[0] in "\"'[{":
        return "close its quotes and brackets, and put quotes about the whole word so that a shell leaves them in"
    if value in ("True", "False"):
        return f'write {value.lower()}, or "{value}" with quotes for a text'
    if value == "None":
        return 'leave the option out to keep its default, or write "None" with quotes for a text'
    for read in (int, float):
        with suppress(ValueError):
            return f'write the number as {read(value)}, or "{value}" with quotes for a text'
    return None
