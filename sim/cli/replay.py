"""`sounding replay`: what happened in a run, from its recorded states."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import FieldError

from .terminal import INTERRUPTED, parse

EXAMPLES = """
sounding replay renders/first                             # a line for each action
sounding replay renders/first --video first.mp4
sounding replay renders/first --video first.mp4 --speed 1 --fps 50
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Show what happened in a run, from its recorded states.

    A line per action is printed and checked against the table of the run; with --video an MP4 is rendered as well, and
    with --joints the path of the joints is written.
    Nothing is planned or solved again.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of a run of `sounding episode`."""
    video: Path | None = None
    """Video to write (.mp4), which needs the extra video (`sounding doctor` says how to get it)."""
    joints: Path | None = None
    """File to write the timed path of the joints to: a table (.csv), or a JointTrajectory of ROS 2 (.json)."""
    fps: int = 25
    """Frames of the video a second, from 1 to 120."""
    speed: float = 4.0
    """How many times faster than the run the video is, from 0.01 to 1000."""
    width_px: int = 960
    """Width of the video [pixels], an even number from 64 to 1920."""
    height_px: int = 720
    """Height of the video [pixels], an even number from 64 to 1440."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 1 <= self.fps <= 120:
            raise FieldError("fps", self.fps, "must be from 1 to 120.")
        if not 0.01 <= self.speed <= 1000.0:
            raise FieldError("speed", self.speed, "must be from 0.01 to 1000.")
        for name, most in (("width_px", 1920), ("height_px", 1440)):
            value = getattr(self, name)
            if not 64 <= value <= most or value % 2:
                raise FieldError(name, value, f"must be an even number from 64 to {most}.")
        if self.video is not None and self.video.suffix.lower() != ".mp4":
            raise FieldError("video", self.video, "must end with .mp4.")
        if self.joints is not None and self.joints.suffix.lower() not in (".csv", ".json"):
            raise FieldError("joints", self.joints, "must end with .csv or .json.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Print the replay, render it where a video is wanted, and return the exit code."""
    from sim.record.recording import read_recording
    from sim.viewing.joint_path import joint_path, write_joint_path
    from sim.viewing.replay import replay_table

    recording = read_recording(options.folder)
    if options.joints is not None:
        path = joint_path(recording)
        write_joint_path(path, options.joints)
        print(f"wrote {len(path.time_s)} positions of {len(path.names)} joints to {options.joints}")
    if options.video is None:
        print(replay_table(recording))
        return 0
    from sim.viewing.video import VideoSettings, write_video

    settings = VideoSettings(
        fps=options.fps, speed=options.speed, width_px=options.width_px, height_px=options.height_px
    )
    try:
        n_frames = write_video(recording, options.video, settings)
    except KeyboardInterrupt:
        print("sounding: interrupted; no video was written.", file=sys.stderr)
        return INTERRUPTED
    print(f"{replay_table(recording)}\nwrote {n_frames} frames to {options.video}")
    return 0
