"""Between the commands and the terminal: options read from flags, fields in texts written as flags, exit codes."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import tyro

from sim.errors import FieldError, value_text
from sim.running.fields import field_names, leaf_fields

NOT_REACHED, NOT_USABLE, BAD_INPUT, INTERRUPTED = 1, 1, 2, 130
"""Exit codes besides 0."""
Options = TypeVar("Options")
_IN_BACKTICKS = re.compile(r"`(\w+)`")


def parse(
    options_class: type[Options], arguments: Sequence[str], *, prog: str, default: Options | None = None
) -> Options:
    """The options that the command line gives; it ends the process with a message where it cannot be understood.

    Args:
        options_class: A dataclass; groups of its own are flattened, so that no flag has a prefix.
        arguments: What was typed after the command.
        prog: The command, for usage and messages.
        default: Values of all that is not given; those of the class by default.
    """
    more: dict[str, Any] = {} if default is None else {"default": default}
    return tyro.cli(tyro.conf.OmitArgPrefixes[options_class], args=list(arguments), prog=prog, **more)


def given_word(arguments: Sequence[str], name: str) -> str | None:
    """The word given for a field that decides how all others are read; None where the flag is not there."""
    for index, argument in enumerate(arguments):
        written, equals, word = argument.partition("=")
        if written == flag(name):
            word = word if equals else next(iter(arguments[index + 1 : index + 2]), "")
            return word if word and not word.startswith("--") else None
    return None


def flag(name: str) -> str:
    """The flag of a field."""
    return f"--{name.replace('_', '-')}"


def in_flags(said: str | Exception, options_class: type[Any] | None = None) -> str:
    """A text or an error with the names of fields, which stand in backticks, written as flags.

    Args:
        said: The text or the error.
        options_class: Options of the command; fields of an episode are known besides.
    """
    names = {*field_names(), *(() if options_class is None else leaf_fields(options_class))}
    if isinstance(said, FieldError) and said.field in names:
        return _replaced(f"{flag(said.field)} {value_text(said.value)}: {said.problem}", names)
    return _replaced(str(said), names)


def _replaced(text: str, names: Iterable[str]) -> str:
    return _IN_BACKTICKS.sub(lambda m: flag(m[1]) if m[1] in names else m[0], text)


def note(text: str) -> None:
    """Print a notice on stderr, with flags."""
    print(f"note: {in_flags(text)}", file=sys.stderr)


def aligned_lines(rows: Sequence[tuple[str, str, str]], summary: Mapping[str, Any]) -> list[str]:
    """Figures of a summary, one a line, with a dash where there is none.

    Args:
        rows: Label, key of the summary, and format of each figure.
        summary: The figures.
    """
    width = max(len(label) for label, *_ in rows)
    lines = []
    for label, key, form in rows:
        value = summary.get(key)
        lines.append(f"{label:<{width}}  {'–' if value is None else form.format(value)}")
    return lines
