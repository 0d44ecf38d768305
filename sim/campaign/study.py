"""The study: which episodes a campaign is made of, as combinations of values of an episode's options."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import types
import typing
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from sim.errors import UsageError
from sim.running.options import EpisodeOptions

NOT_AXES = ("out", "overwrite", "frames", "report")
"""Options that say where and what an episode writes, which a campaign decides itself."""
SETUP_OPTIONS = (
    "scenario",
    "organ",
    *("tumour", "n_tumours", "unit", "mesh_frame", "coding", "organ_label", "tumour_label", "spacing_mm"),
    *(
        "target",
        "target_label",
        "target_name",
        "structure",
        "structure_label",
        "keepout",
        "keepout_label",
        "keepout_mm",
        "organ_pose",
    ),
    "cone_half_angle_deg",
    "cone_depth_mm",
    "arm",
    "flange",
)
"""Options that what all seeds share is built from. They vary slowest, so that a process rarely builds anew."""
LEADING = ("scenario", "planner", "arm", "seed")
"""Options that every trial's key states, also where they are the default."""
Values = Sequence[Any]


@dataclass(frozen=True)
class Trial:
    """One episode of a study."""

    options: EpisodeOptions
    folder: Path | None = None
    """Where the episode's folder is written; None for no folder."""

    @property
    def run_options(self) -> EpisodeOptions:
        """The options to run it with."""
        return dataclasses.replace(self.options, out=self.folder, overwrite=True)

    @property
    def settings(self) -> dict[str, Any]:
        """Options that tell this trial from others: the leading ones, and all that are not the default."""
        values = {name: getattr(self.options, name) for name in option_names()}
        return {name: _plain(values[name]) for name in LEADING} | {
            name: _plain(value)
            for name, value in values.items()
            if name not in LEADING and value != _defaults()[name]
        }

    @property
    def key(self) -> str:
        """The settings as one line of text, by which a campaign knows the trial."""
        return key_of(self.settings)

    @property
    def name(self) -> str:
        """A name for its folder: readable, and no other trial's."""
        words = (Path(self.options.scenario).stem, self.options.planner, Path(self.options.arm).stem)
        return f"{'-'.join(words)}-{self.options.seed}-{zlib.crc32(self.key.encode()):08x}"


@dataclass(frozen=True)
class Part:
    """Every combination of some values; options that are left out keep their default."""

    values: Mapping[str, Values]
    """Values of each option, one or more."""

    def __post_init__(self) -> None:
        """Validate names, values and each combination."""
        for name, values in self.values.items():
            if name not in option_names():
                raise UsageError(f"unknown key {name!r}. Known keys: {', '.join(option_names())}.")
            if not len(values):
                raise UsageError(f"{name}: no value is given.")
            if len(set(map(str, values))) < len(values):
                raise UsageError(f"{name}: a value is given twice.")
        for options in self.combinations():
            options.check()

    @property
    def seeds(self) -> Values:
        """The seeds of every combination."""
        return self.values.get("seed", (0,))

    def combinations(self) -> Iterator[EpisodeOptions]:
        """Every combination of all options but the seed, in the order of the trials."""
        names = sorted((name for name in self.values if name != "seed"), key=_slowness)
        for combination in itertools.product(*(self.values[name] for name in names)):
            yield EpisodeOptions(**dict(zip(names, combination, strict=True)), seed=self.seeds[0])

    def __len__(self) -> int:
        """The number of trials."""
        return math.prod(len(values) for values in self.values.values())

    def trials(self) -> Iterator[Trial]:
        """Every trial; what a setup is built from varies slowest, the seed fastest."""
        for options in self.combinations():
            for seed in self.seeds:
                yield Trial(dataclasses.replace(options, seed=seed))


@dataclass(frozen=True)
class Study:
    """Parts, one after the other, with values of their own."""

    title: str
    parts: tuple[Part, ...]

    def __len__(self) -> int:
        """The number of trials."""
        return sum(len(part) for part in self.parts)

    def trials(self) -> Iterator[Trial]:
        """Every trial once, in the order of the tables."""
        return itertools.chain.from_iterable(part.trials() for part in self.parts)

    def first_trials(self) -> Iterator[tuple[Trial, int]]:
        """The first trial of each combination, and how many seeds it has."""
        for part in self.parts:
            for options in part.combinations():
                yield Trial(options), len(part.seeds)

    def describe(self) -> dict[str, Any]:
        """The study as plain data."""
        parts = [
            {name: _described(values) for name, values in sorted(part.values.items())} for part in self.parts
        ]
        return {"title": self.title, "n_trials": len(self), "parts": parts}


def key_of(settings: Mapping[str, Any]) -> str:
    """The text by which a trial of these settings is known."""
    return json.dumps(settings, sort_keys=True)


@lru_cache(maxsize=1)
def option_names() -> tuple[str, ...]:
    """The options of an episode that a study may set."""
    return tuple(field.name for field in dataclasses.fields(EpisodeOptions) if field.name not in NOT_AXES)


def default_of(name: str) -> Any:
    """The value of an option that nobody sets, as plain data."""
    return _plain(_defaults()[name])


def option_value(name: str, value: Any) -> Any:
    """A value as the option's type has it: a whole number where a float is due, a text where a path is.

    Raises:
        UsageError: The value has another type.
    """
    hint = _hints()[name]
    for kind in _kinds(hint):
        if (converted := _converted(kind, value)) is not None:
            return converted
    raise UsageError(f"{name}={value!r}: {_wanted(hint)}.")


def options_of(settings: Mapping[str, Any]) -> EpisodeOptions:
    """The options that a trial's settings stand for."""
    return EpisodeOptions(**{name: option_value(name, value) for name, value in settings.items()})


def parse_seeds(value: Any) -> Values:
    """Seeds from `first:end` (the end is left out), one number, or a list of both.

    Raises:
        UsageError: Something else.
    """
    if isinstance(value, list | tuple):
        return tuple(itertools.chain.from_iterable(parse_seeds(each) for each in value))
    if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return range(value, value + 1)
    first, colon, end = str(value).partition(":")
    if not (first.isdecimal() and (end.isdecimal() if colon else True)):
        raise UsageError(f"seeds {value!r}: first:end, for example 5000:5100, or a number from 0 on.")
    seeds = range(int(first), int(end) if colon else int(first) + 1)
    if not len(seeds):
        raise UsageError(f"seeds {value!r}: the end must lie above the first.")
    return seeds


def _slowness(name: str) -> tuple[int, int]:
    if name in SETUP_OPTIONS:
        return (0, SETUP_OPTIONS.index(name))
    return (1 if name == "planner" else 2, option_names().index(name))


@lru_cache(maxsize=1)
def _defaults() -> dict[str, Any]:
    return {field.name: field.default for field in dataclasses.fields(EpisodeOptions)}


@lru_cache(maxsize=1)
def _hints() -> dict[str, Any]:
    return typing.get_type_hints(EpisodeOptions)


def _converted(kind: Any, value: Any) -> Any:
    """The value as that type, None where it is none."""
    if typing.get_origin(kind) is Literal:
        return value if value in typing.get_args(kind) else None
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list | tuple):
            return None
        item = typing.get_args(kind)[0]
        items = tuple(_converted(item, each) for each in value)
        return None if None in items else items
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is Path and isinstance(value, str | Path):
        return Path(value)
    return value if type(value) is kind else None


def _kinds(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a type: `X | None` is one kind of union, `Literal[...] | None` another."""
    return typing.get_args(hint) if typing.get_origin(hint) in (types.UnionType, typing.Union) else (hint,)


def _wanted(hint: Any) -> str:
    return " or ".join(_kind_in_words(kind) for kind in _kinds(hint) if kind is not types.NoneType)


def _kind_in_words(kind: Any) -> str:
    if typing.get_origin(kind) is Literal:
        return f"one of {', '.join(typing.get_args(kind))}"
    names = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
    return names.get(kind, "a path, or a list of them")


def _described(values: Values) -> Any:
    if isinstance(values, range):
        return f"{values.start}:{values.stop}"
    return [_plain(value) for value in values]


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value
