"""What a run writes, and where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.record.default_folders import default_folder, file_part
from sim.world.sensing.sweep import KeptPlanes

from .config import DEFAULT_PROBE, EpisodeConfig, Frames
from .parts import EpisodeParts

DEFAULT_ARM = "default"


@dataclass(frozen=True, kw_only=True)
class Output:
    """What a run writes, and where."""

    folder: Path
    options: Mapping[str, Any]
    """The configuration as plain data, which config.json keeps."""
    frames: Frames = "none"
    keep_images: KeptPlanes = "middle"
    """Which pictures of an action's sweep."""
    report: bool = True
    cannot_repeat: tuple[str, ...] = ()
    """What the run was given in memory and config.json does not hold, a sentence each."""
    overwrite: bool = False
    """Whether a run that the folder already holds is replaced."""
    live: str | None = None
    """Address at which clients are shown the run as it happens; None shows it to nobody."""


def output_of(config: EpisodeConfig, parts: EpisodeParts, options: Mapping[str, Any]) -> Output:
    """What a configuration writes, and where: by default to a new folder that is named by what runs."""
    words = [parts.scenario.name, file_part(str(parts.names["planner"]))]
    words += [] if config.arm == DEFAULT_ARM else [file_part(config.arm)]
    words += [] if config.probe == DEFAULT_PROBE else [file_part(config.probe)]
    name = "-".join([*words, str(config.seed)])
    return Output(
        folder=config.out or default_folder(name, options, overwrite=config.output.overwrite),
        options=options,
        frames=config.frames,
        keep_images=config.ultrasound.keep_images,
        report=config.output.report,
        overwrite=config.output.overwrite,
        live=config.output.live,
    )
