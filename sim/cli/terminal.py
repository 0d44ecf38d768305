"""What stands between commands and terminal: options read from flags, fields written as flags in texts, exit codes."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import textwrap
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from sim.errors import FieldError, UsageError, value_text
from sim.running.fields import field_names, leaf_fields

NOT_REACHED, NOT_USABLE, FAILED, BAD_INPUT, INTERRUPTED = 1, 1, 1, 2, 130
"""Exit codes besides 0."""
Options = TypeVar("Options")
_IN_BACKTICKS = re.compile(r"`(\w+)`")


def parse(
    options_class: type[Options],
    arguments: Sequence[str],
    *,
    prog: str,
    examples: str,
    default: Options | None = None,
) -> Options:
    """The options that the command line gives; where it cannot be understood, the process ends with a message.

    Args:
        options_class: A dataclass. The groups in it are flattened, so that no flag has a prefix.
        arguments: What was typed after the command.
        prog: The command, for usage and messages.
        examples: Command lines with which the help begins, one a line.
        default: Values of all options that are not given; by default those of the class.

    Raises:
        UsageError: An option that takes several values is given more than once.
    """
    _refuse_lists_given_twice(options_class, arguments)
    more: dict[str, Any] = {} if default is None else {"default": default}
    shown = "".join(f"    {line}\n" for line in examples.strip().splitlines())
    more["description"] = f"Examples:\n{shown}\n{_in_paragraphs(inspect.getdoc(options_class) or '')}"
    with _readable_help(options_class):
        return tyro.cli(tyro.conf.OmitArgPrefixes[options_class], args=list(arguments), prog=prog, **more)


def _refuse_lists_given_twice(options_class: type[Any], arguments: Sequence[str]) -> None:
    """Refuse `--planner a --planner b`, of which the parser would keep the last alone without a word."""
    written = [argument.partition("=")[0].replace("_", "-") for argument in arguments]
    for name in _list_fields(options_class):
        if written.count(flag(name)) > 1:
            raise UsageError(
                f"{flag(name)} is given {written.count(flag(name))} times, and only the last would count. Give it "
                f"once, with all its values after it: {flag(name)} A B."
            )


def _list_fields(options_class: type[Any]) -> Iterator[str]:
    """The names of the options that take any number of values, those of groups too."""
    for name, kind in typing.get_type_hints(options_class).items():
        if dataclasses.is_dataclass(kind):
            yield from _list_fields(typing.cast(type[Any], kind))
        elif any(typing.get_args(each)[-1:] == (Ellipsis,) for each in (kind, *typing.get_args(kind))):
            yield name


def _in_paragraphs(text: str) -> str:
    """A docstring with each paragraph on one line, which the terminal breaks where it ends."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _readable_help(options_class: type[Any]) -> ConstructorRegistry:
    """A context in which help is made of the fields' docstrings on one line, with other fields as flags.

    The parser would keep the line breaks of a docstring, which fall in the middle of the lines of a terminal.
    """
    registry, names = ConstructorRegistry(), set(leaf_fields(options_class))
    is_inner = False

    @registry.struct_rule
    def rule(info: StructTypeInfo) -> StructConstructorSpec | None:
        nonlocal is_inner
        if is_inner or not dataclasses.is_dataclass(info.type):
            return None
        # From within this rule, the registry answers by the parser's own rules.
        is_inner = True
        try:
            spec = ConstructorRegistry.get_struct_spec(info)
        finally:
            is_inner = False
        if not isinstance(spec, StructConstructorSpec):
            return None
        return dataclasses.replace(
            spec, fields=tuple(_with_readable_help(each, names) for each in spec.fields)
        )

    return registry


def _with_readable_help(field: StructFieldSpec, names: set[str]) -> StructFieldSpec:
    def text() -> str | None:
        help_text = field.helptext() if callable(field.helptext) else field.helptext
        return None if help_text is None else _replaced(" ".join(help_text.split()), names)

    return dataclasses.replace(field, helptext=text)


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
    """A text or an error in which the names of fields, which stand in backticks, are written as flags.

    Args:
        said: The text or the error.
        options_class: Options of the command; the fields of an episode are known without it.
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


def wrapped(text: str) -> str:
    """A text in lines of at most 100 characters."""
    return textwrap.fill(text, width=100, break_long_words=False, break_on_hyphens=False)


def aligned_lines(rows: Sequence[tuple[str, str, str]], summary: Mapping[str, Any]) -> list[str]:
    """The lines of some figures of a summary, with a dash where a figure is missing.

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
