"""The fields of an episode's configuration by name, whatever group they stand in, with their types and defaults."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from sim.errors import UsageError
from sim.world.text import read_text

from .config import EpisodeConfig

ORDER = (
    *("mounting", "moving", "organ", "case", "anatomy", "sensing", "reading", "ultrasound", "body"),
    *("planning", "mapping", "find_and_outline", "expected_improvement", "sweeping", "output"),
)
"""The order of groups in a study's axes and columns, after the fields outside groups. Help has another."""
OPTIONS_OF = {"planner": "planner_option", "sensor": "sensor_option", "map": "map_option"}
"""The field that holds the options of what a user brings in the place of another."""
OF_THE_CALL = ("config", "out", "overwrite", "live")
"""Fields that say where a run comes from and goes to, and nothing about the run."""


@lru_cache(maxsize=1)
def field_names() -> tuple[str, ...]:
    """The names of all fields: those outside groups first, then group by group."""
    return tuple(_places())


@lru_cache(maxsize=1)
def _places() -> dict[str, tuple[str | None, Any, Any]]:
    """The group, type and default of each field; the group is None for a field outside groups."""
    kinds = typing.get_type_hints(EpisodeConfig)
    outside = {
        field.name: (None, kinds[field.name], field.default) for field in dataclasses.fields(EpisodeConfig)
    }
    places: dict[str, tuple[str | None, Any, Any]] = {
        name: place for name, place in outside.items() if name not in ORDER
    }
    for group in ORDER:
        if not dataclasses.is_dataclass(kinds[group]):
            places[group] = outside[group]
            continue
        hints = typing.get_type_hints(kinds[group])
        for field in dataclasses.fields(kinds[group]):
            assert field.name not in places, f"{field.name} stands in two groups"
            places[field.name] = (group, hints[field.name], field.default)
    return places


def default_of(name: str) -> Any:
    """The value of a field that is not set, as plain data."""
    return plain(_places()[name][2])


def value_of(config: EpisodeConfig, name: str) -> Any:
    """The value of a field."""
    group = _places()[name][0]
    return getattr(config if group is None else getattr(config, group), name)


def config_of(values: Mapping[str, Any] | None = None, /, **more: Any) -> EpisodeConfig:
    """The configuration with some values of fields, and the defaults of all others.

    Args:
        values: Values by the names of their fields.
        more: Further values, as keyword arguments.

    Raises:
        UsageError: A name is unknown, a value has another type, or values do not go together.
    """
    return changed(EpisodeConfig(), **(values or {}), **more)


def episode_of(options: Any, **more: Any) -> EpisodeConfig:
    """The configuration of the episode that a command's options tell of: its fields and groups that they have by name.

    Args:
        options: A data class. What it says of where to write to is the command's own.
        more: Fields and groups that it has not, or means otherwise.
    """
    names = (field.name for field in dataclasses.fields(EpisodeConfig) if field.name not in OF_THE_CALL)
    own = {name: getattr(options, name) for name in names if hasattr(options, name)}
    return EpisodeConfig(**(own | more))


def changed(config: EpisodeConfig, **values: Any) -> EpisodeConfig:
    """The configuration with other values of some fields.

    Raises:
        UsageError: A name is unknown, a value has another type, or values do not go together.
    """
    outside: dict[str, Any] = {}
    inside: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if name not in _places():
            raise UsageError(f"unknown option {name!r}. Known options: {', '.join(field_names())}.")
        group = _places()[name][0]
        (outside if group is None else inside.setdefault(group, {}))[name] = converted(name, value)
    groups = {group: dataclasses.replace(getattr(config, group), **own) for group, own in inside.items()}
    return dataclasses.replace(config, **outside, **groups)


def flat(config: EpisodeConfig) -> dict[str, Any]:
    """The values of all fields by name, as plain data."""
    return {name: plain(value_of(config, name)) for name in field_names()}


def recorded(config: EpisodeConfig) -> dict[str, Any]:
    """The values that config.json keeps of a configuration: paths are absolute, so a run repeats from any folder."""
    values = {name: value_of(config, name) for name in field_names() if name not in OF_THE_CALL}
    return {name: plain(_absolute(name, value)) for name, value in values.items()}


def read_config(path: Path) -> EpisodeConfig:
    """The configuration that a run's config.json holds; fields that it does not name have their defaults.

    Raises:
        UsageError: The file cannot be read, or is not that of an episode.
    """
    try:
        content = json.loads(read_text(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror}). Name a run's config.json.") from error
    except ValueError as error:
        raise UsageError(f"{path}: is not JSON ({error}). Name a run's config.json.") from error
    options = content.get("options") if isinstance(content, dict) else None
    if not (isinstance(options, dict) and {"scenario", "planner", "seed"} <= options.keys()):
        raise UsageError(f"{path}: is not the config.json of an episode. Name one that a run wrote.")
    if isinstance(content, dict) and content.get("cannot_repeat"):
        raise UsageError(
            f"{path}: cannot be run again from the file: {'; '.join(content['cannot_repeat'])}. Run the script again."
        )
    try:
        return config_of({name: value for name, value in options.items() if name not in OF_THE_CALL})
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def without_options_of(config: EpisodeConfig, names: Iterable[str]) -> EpisodeConfig:
    """The configuration without the options of those planners, sensors and maps that others replace.

    Args:
        config: The configuration of an earlier run.
        names: The fields that are given anew.
    """
    return changed(config, **{OPTIONS_OF[name]: () for name in names if name in OPTIONS_OF})


def converted(name: str, value: Any) -> Any:
    """A value in the type of its field: a whole number may stand for a float, a text for a path, a list for a tuple.

    Raises:
        UsageError: The value has another type.
    """
    hint = _places()[name][1]
    if value is None and types.NoneType in _kinds(hint):
        return None
    for kind in _kinds(hint):
        if (found := _converted(kind, value)) is not None:
            return found
    raise UsageError(f"{name}={value!r}: must be {_wanted(hint)}.")


def plain(value: Any) -> Any:
    """A value as JSON and TOML have it: tuples become lists, and paths texts."""
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value


def _absolute(name: str, value: Any) -> Any:
    if isinstance(value, Path):
        return value.absolute()
    if isinstance(value, tuple):
        return tuple(_absolute(name, each) for each in value)
    if name in ("scenario", "arm", "probe") and Path(value).suffix:
        return str(Path(value).absolute())
    return value


def _converted(kind: Any, value: Any) -> Any:
    """The value in a type, None where it has no such form."""
    if typing.get_origin(kind) is Literal:
        return value if value in typing.get_args(kind) else None
    if typing.get_origin(kind) is tuple:
        return _converted_items(typing.get_args(kind), value)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is Path and isinstance(value, str | Path):
        return Path(value)
    return value if type(value) is kind else None


def _converted_items(kinds: tuple[Any, ...], value: Any) -> tuple[Any, ...] | None:
    """The items of a list in the types of a tuple's; None where one has no such form, or their number is another."""
    if not isinstance(value, list | tuple) or (kinds[-1] is not Ellipsis and len(value) != len(kinds)):
        return None
    items = tuple(_converted(kinds[0], each) for each in value)
    return None if None in items else items


def _kinds(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a type: `X | None` is one kind of union, `Literal[...] | None` another."""
    return typing.get_args(hint) if typing.get_origin(hint) in (types.UnionType, typing.Union) else (hint,)


def _wanted(hint: Any) -> str:
    """What a value of a type has to be, in words."""
    return " or ".join(_in_words(kind) for kind in _kinds(hint) if kind is not types.NoneType)


def _in_words(kind: Any) -> str:
    if typing.get_origin(kind) is Literal:
        return f"one of {', '.join(typing.get_args(kind))}"
    names = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
    if kind in names:
        return names[kind]
    items = [each for each in typing.get_args(kind) if each is not Ellipsis]
    if items and items[0] in names:
        many = "" if Ellipsis in typing.get_args(kind) else f"{len(items)} "
        return f"a list of {many}{ {int: 'whole numbers', float: 'numbers', str: 'texts'}[items[0]] }"
    return "a path, or a list of them"


def leaf_fields(owner: type[Any]) -> Iterator[str]:
    """The names of all fields of a configuration's class, with those of groups in their place."""
    kinds = typing.get_type_hints(owner)
    for field in dataclasses.fields(owner):
        kind = kinds[field.name]
        if dataclasses.is_dataclass(kind):
            assert isinstance(kind, type)
            yield from leaf_fields(kind)
        else:
            yield field.name
