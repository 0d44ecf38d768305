"""The file config.json of a run: its configuration and what that stands for, enough to run the episode again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from sim.episode.scenario_file import scenario_record
from sim.episode.setup import Setup

from .config import EpisodeConfig
from .fields import recorded
from .parts import EpisodeParts


def run_config(parts: EpisodeParts, setup: Setup, options: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that is needed to repeat a run: the options and what they stand for."""
    return {
        "options": dict(options),
        "scenario": scenario_record(setup.scenario),
        "map": dataclasses.asdict(parts.map_settings),
        "insets": None if parts.insets is None else dataclasses.asdict(parts.insets),
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
            the text that names its class; a run repeats from it only where the class needs no options.
    """
    return recorded(config) | {name: text_of(thing) for name, thing in (brought or {}).items()}


def text_of(thing: Any) -> str:
    """The text `package.module:Class` of an object's class, or of a class or function; a scenario's name."""
    if hasattr(thing, "n_tumours"):
        return str(thing.name)
    named = thing if hasattr(thing, "__qualname__") else type(thing)
    return f"{named.__module__}:{named.__qualname__}"
