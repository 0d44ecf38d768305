"""The study: which episodes a campaign runs, as combinations of values of an episode's options."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from sim.errors import UsageError
from sim.running.config import EpisodeConfig
from sim.running.fields import config_of, converted, default_of, field_names, flat, plain
from sim.running.parts import check_config

NOT_AXES = ("config", "out", "overwrite", "frames", "report", "live")
"""Options that say where an episode comes from and what it writes, which a campaign decides itself."""
SETUP_OPTIONS = (
    *(
        "scenario",
        "organ",
        "tumour",
        "n_tumours",
        "unit",
        "mesh_frame",
        "coding",
        "organ_label",
        "tumour_label",
    ),
    *("spacing_mm", "target", "target_label", "target_name", "structure", "structure_label"),
    *("keepout", "keepout_label", "keepout_mm", "organ_pose", "cone_half_angle_deg", "cone_depth_mm"),
    *("arm", "flange", "probe"),
)
"""Options from which a setup is built. They vary slowest, so that a process rarely builds a setup anew."""
LEADING = ("scenario", "planner", "arm", "seed")
"""Options that every trial's key states, also where they are the default."""
Values = Sequence[Any]


@dataclass(frozen=True)
class Trial:
    """One episode of a study."""

    config: EpisodeConfig
    folder: Path | None = None
    """Where the episode's folder is written; None for no folder."""

    @property
    def settings(self) -> dict[str, Any]:
        """Options that tell this trial from others: the leading ones, and all that are not the default."""
        values = {name: value for name, value in flat(self.config).items() if name not in NOT_AXES}
        return {name: values[name] for name in LEADING} | {
            name: value for name, value in values.items() if name not in LEADING and value != default_of(name)
        }

    @property
    def key(self) -> str:
        """The settings as one line of text, by which a campaign knows the trial."""
        return key_of(self.settings)

    @property
    def name(self) -> str:
        """A name for the trial's folder, which is readable and differs from that of any other trial."""
        config = self.config
        words = (Path(config.scenario).stem, config.planner.replace(":", "."), Path(config.arm).stem)
        return f"{'-'.join(words)}-{config.seed}-{zlib.crc32(self.key.encode()):08x}"


@dataclass(frozen=True)
class Part:
    """Every combination of some values; options that are left out keep their default."""

    values: Mapping[str, Values]
    """One or more values of each option."""

    def __post_init__(self) -> None:
        """Validate names, values and each combination."""
        for name, values in self.values.items():
            if name not in option_names():
                raise UsageError(f"unknown key {name!r}. Known keys: {', '.join(option_names())}.")
            if not len(values):
                raise UsageError(f"{name}: no value is given.")
            if len(set(map(str, values))) < len(values):
                raise UsageError(f"{name}: a value is given twice.")
        for config in self.combinations():
            check_config(config)

    @property
    def seeds(self) -> Values:
        """The seeds of every combination."""
        return self.values.get("seed", (0,))

    def combinations(self) -> Iterator[EpisodeConfig]:
        """Every combination of all options but the seed, in the order of the trials."""
        names = sorted((name for name in self.values if name != "seed"), key=_slowness)
        for combination in itertools.product(*(self.values[name] for name in names)):
            yield config_of(dict(zip(names, combination, strict=True)) | {"seed": self.seeds[0]})

    def __len__(self) -> int:
        """The number of trials."""
        return math.prod(len(values) for values in self.values.values())

    def trials(self) -> Iterator[Trial]:
        """Every trial; what a setup is built from varies slowest, the seed fastest."""
        for config in self.combinations():
            for seed in self.seeds:
                yield Trial(dataclasses.replace(config, seed=seed))


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
            for config in part.combinations():
                yield Trial(config), len(part.seeds)

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
    return tuple(name for name in field_names() if name not in NOT_AXES)


def make_study(title: str = "trials", **values: Any) -> Study:
    """A study of one part from values by name.

    Args:
        title: Title of the study.
        values: Options of an episode, each with one value or a list of them; every combination is run. `seed` also
            takes `"0:100"` for the seeds from 0 to 99.

    Raises:
        UsageError: An option is unknown, or does not take a value.
    """
    lists = {}
    for name, value in values.items():
        if name not in option_names():
            raise UsageError(f"unknown option {name!r}. Known options: {', '.join(option_names())}.")
        if name == "seed":
            lists[name] = parse_seeds(value)
        else:
            items = value if isinstance(value, list) else [value]
            lists[name] = tuple(converted(name, each) for each in items)
    return Study(title, (Part(lists),))


def parse_seeds(value: Any) -> Values:
    """The seeds that `first:end` (without the end), a number, or a list of both names.

    Raises:
        UsageError: The value is none of these.
    """
    if isinstance(value, list | tuple):
        return tuple(itertools.chain.from_iterable(parse_seeds(each) for each in value))
    if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return range(value, value + 1)
    first, colon, end = str(value).partition(":")
    if not (first.isdecimal() and (end.isdecimal() if colon else True)):
        raise UsageError(f"seeds {value!r}: must be first:end, for example 5000:5100, or a number from 0 on.")
    seeds = range(int(first), int(end) if colon else int(first) + 1)
    if not len(seeds):
        raise UsageError(f"seeds {value!r}: the end must lie above the first.")
    return seeds


def _slowness(name: str) -> tuple[int, int]:
    if name in SETUP_OPTIONS:
        return (0, SETUP_OPTIONS.index(name))
    return (1 if name == "planner" else 2, option_names().index(name))


def _described(values: Values) -> Any:
    if isinstance(values, range):
        return f"{values.start}:{values.stop}"
    return [plain(value) for value in values]
