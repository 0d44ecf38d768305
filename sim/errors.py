"""Errors of the programs that people run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class UsageError(Exception):
    """What the user wants cannot be done; the text names the value and the remedy.

    Where the text speaks of a field that the user can set, the field's name stands in backticks. The command line
    writes it as its flag.
    """


class FieldError(UsageError):
    """The value of a field cannot be used."""

    def __init__(self, field: str, value: Any, problem: str) -> None:
        """Keep the field and the value beside the sentence that says what is wrong and what would be right."""
        super().__init__(f"{field}={value_text(value)}: {problem}")
        self.field, self.value, self.problem = field, value, problem


def value_text(value: Any) -> str:
    """A value as people type it: the items of a tuple one after the other, no quotes."""
    return " ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)


def other_values(began: Mapping[str, Any], given: Mapping[str, Any]) -> str:
    """The values that differ between what was begun and what is given now, as text; empty where none does."""
    changed = sorted(key for key in {*began, *given} if began.get(key) != given.get(key))
    return ", ".join(
        f"`{key}` ({_short(began.get(key))} then, {_short(given.get(key))} now)" for key in changed
    )


def other_input(began: Mapping[str, Any], given: Mapping[str, Any]) -> str:
    """The first input whose content is not what it was when something was begun; empty where all are, or are new."""
    return next((name for name, content in given.items() if began.get(name, content) != content), "")


def _short(value: Any, n_most: int = 60) -> str:
    text = "none" if value is None else value_text(value)
    return text if len(text) <= n_most else f"{text[: n_most - 3]}..."
