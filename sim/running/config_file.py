"""The file config.json of a run: its configuration and what that stands for, enough to run the episode again."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.episode.scenario import SCENARIOS
from sim.episode.scenario_file import load_scenario, scenario_record
from sim.world.volumes.files import files_of

from .config import EpisodeConfig
from .fields import OPTIONS_OF, recorded
from .parts import EpisodeParts, scenario_of

if TYPE_CHECKING:
    from sim.episode.setup import Setup


def run_config(
    parts: EpisodeParts, setup: Setup, options: Mapping[str, Any], cannot_repeat: Sequence[str] = ()
) -> dict[str, Any]:
    """Everything that is needed to repeat a run: the options and what they stand for."""
    return {
        "options": dict(options),
        **({"cannot_repeat": list(cannot_repeat)} if cannot_repeat else {}),
        "scenario": scenario_record(setup.scenario),
        "map": dataclasses.asdict(parts.map_settings),
        "detail": None if parts.detail is None else dataclasses.asdict(parts.detail),
        "T_world_organ": setup.T_world_organ,
        "T_input_world": np.linalg.inv(setup.T_world_organ),
        "input_axes": "LPS [m]: +x left, +y back, +z head of the patient; NIfTI has RAS [mm]",
        "n_poses": setup.workspace.n_poses,
        "n_hinges": int(setup.hinge_mask.sum()),
        "n_search_points": len(setup.search_points_m),
    }


def recorded_config(config: EpisodeConfig, brought: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The configuration as config.json keeps it.

    Args:
        config: What was run.
        brought: Objects that were given in memory, by the name of the field in whose place they stand. Each is told by
            the text that names its class, and a dataclass by its settings too, so that the run repeats from them. A
            scenario is told by its name only.
    """
    values = recorded(config)
    for name, thing in (brought or {}).items():
        values[name] = text_of(thing)
        if name in OPTIONS_OF:
            values[OPTIONS_OF[name]] = option_words(thing)
    return values


def inputs_of(config: EpisodeConfig) -> dict[str, Any]:
    """What the scenario and the files of a configuration hold, on which a run depends as much as on its options.

    Returns:
        The scenario as plain data, and the SHA-256 of each file, by names such as `scenario liver` and `file FILE`.
    """
    record = scenario_record(load_scenario(config.scenario))
    inputs: dict[str, Any] = {f"scenario {config.scenario}": json.loads(json.dumps(record))}
    files = scenario_of(config).case_files
    for name in (config.arm, config.probe, *(() if files is None else files.paths)):
        for file in files_of(Path(name)):
            if file.is_file():
                inputs[f"file {file}"] = hashlib.sha256(file.read_bytes()).hexdigest()
    return inputs


def option_words(thing: Any) -> list[str]:
    """The settings of a dataclass's object that differ from their defaults, as name=value; only numbers and texts."""
    if isinstance(thing, type) or not dataclasses.is_dataclass(thing):
        return []
    values = {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing) if field.init}
    defaults = {field.name: field.default for field in dataclasses.fields(thing)}
    return [
        f"{name}={json.dumps(value)}"
        for name, value in values.items()
        if isinstance(value, bool | int | float | str) and value != defaults[name]
    ]


def cannot_repeat(brought: Mapping[str, Any]) -> tuple[str, ...]:
    """What config.json does not hold of objects that were given in memory, a sentence each; empty where it holds all.

    Args:
        brought: The objects, by the name of the field in whose place they stand.
    """
    told = []
    for name, thing in brought.items():
        if name == "scenario":
            is_held = thing == SCENARIOS.get(thing.name)
        elif _is_made_from_its_fields(thing):
            is_held = all(
                _is_held(getattr(thing, field.name), _default_of(field))
                for field in dataclasses.fields(thing)
                if field.init
            )
        else:
            is_held = isinstance(thing, type) or not inspect.signature(type(thing)).parameters
        if not is_held or "<locals>" in text_of(thing):
            told.append(
                f"the {name} was made in memory by a script, with settings that the file does not hold"
            )
    return tuple(told)


def _is_made_from_its_fields(thing: Any) -> bool:
    """Whether a thing is an object of a dataclass that has no constructor of its own beside that of its fields."""
    if isinstance(thing, type) or not dataclasses.is_dataclass(thing):
        return False
    names = {field.name for field in dataclasses.fields(thing) if field.init}
    return set(inspect.signature(type(thing)).parameters) == names


def _default_of(field: dataclasses.Field[Any]) -> Any:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def _is_held(value: Any, default: Any) -> bool:
    """Whether config.json holds a setting: it is a number or a text, or nobody changed it."""
    if isinstance(value, bool | int | float | str):
        return True
    try:
        return bool(value == default)
    except ValueError:  # an array, which is equal to a default in parts
        return False


def text_of(thing: Any) -> str:
    """The text `package.module:Class` of an object's class, or of a class or function; a scenario's name."""
    if hasattr(thing, "n_tumours"):
        return str(thing.name)
    named = thing if hasattr(thing, "__qualname__") else type(thing)
    return f"{_module_name(named)}:{named.__qualname__}"


def _module_name(named: Any) -> str:
    """The module that defines a class, as others import it: a script that is running is called __main__ by itself."""
    script = getattr(sys.modules["__main__"], "__file__", None)
    if named.__module__ == "__main__" and script is not None:
        return Path(script).stem
    return named.__module__
