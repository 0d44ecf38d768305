"""Video: a recorded run as an MP4 file, drawn from its states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from sim.errors import FieldError
from sim.pictures.captions import captioned, frame_settings
from sim.pictures.moved_anatomy import moved_anatomy
from sim.record.recording import Recording, set_state
from sim.world.camera.rendering import Overlay, SceneRenderer
from sim.world.optional import optional_module

CODEC = "libx264"
STATES_A_MOTION = 4
"""States of each motion that the camera is placed for; where another leaves the picture it moves once."""
PATH_EVERY = 8
"""Recorded states from one corner of the drawn path of the tip to the next."""


@dataclass(frozen=True, kw_only=True)
class VideoSettings:
    """How a video is made."""

    fps: int = 25
    """Frames a second."""
    speed: float = 4.0
    """How many times faster than the run the video is."""
    width_px: int = 960
    """Width of a frame, which must be even."""
    height_px: int = 720
    """Height of a frame, which must be even."""


def write_video(recording: Recording, path: Path, settings: VideoSettings) -> int:
    """Render a recording to an MP4 file, and return the number of frames.

    Frame i shows the procedure at i speed / fps seconds; the last one is at or just before its end.

    Args:
        recording: The recording to play.
        path: The file.
        settings: How the video is made.

    Raises:
        UsageError: The file cannot be written.
        MissingPackageError: PyAV is not installed.
        RenderingError: No OpenGL works here.
    """
    av: Any = optional_module("av", "video", "`video`")
    partial = path.with_name(f".{path.stem}.part.mp4")
    n_frames = int(np.floor(recording.duration_s * settings.fps / settings.speed + 1e-9)) + 1
    try:
        with av.open(str(partial), "w") as container:
            stream = container.add_stream(CODEC, rate=settings.fps)
            stream.width, stream.height, stream.pix_fmt = settings.width_px, settings.height_px, "yuv420p"
            for picture in _pictures(recording, settings, n_frames):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(stream.encode())
        partial.replace(path)
    except (OSError, av.FFmpegError) as error:
        raise FieldError("video", path, f"cannot be written ({error}).") from error
    finally:
        partial.unlink(missing_ok=True)
    return n_frames


def _pictures(recording: Recording, settings: VideoSettings, n_frames: int) -> Iterator[NDArray[np.uint8]]:
    """The frames in order, each of shape (height, width, 3)."""
    data = recording.scene.new_data()
    anatomy = recording.scene.anatomy
    has_trace = recording.readings is not None
    size = frame_settings(
        anatomy, width_px=settings.width_px, height_px=settings.height_px, has_trace=has_trace
    )
    with SceneRenderer(recording.scene, size) as renderer:
        _show_all(renderer, recording)
        for frame in tqdm(range(n_frames), desc="rendering", unit="frame", mininterval=0.5):
            time_s = frame * settings.speed / settings.fps
            step, state = recording.at(time_s)
            set_state(recording.scene, data, state)
            T = recording.T_world_rest_at(time_s)
            # The poses lie in the organ, and move along with it.
            sensed_m = recording.read_m(time_s) @ T[:3, :3].T + T[:3, 3]
            trace_m = recording.trace(time_s).pieces_m @ T[:3, :3].T + T[:3, 3]
            path_m = recording.motions[step].tips_m[::PATH_EVERY]
            overlay = Overlay(sensed_m=sensed_m, path_m=path_m, trace_m=trace_m)
            caption = f"{recording.folder.name}   ·   action {step}   ·   {time_s:.1f} s"
            with moved_anatomy(data, T):
                picture = renderer.render(data, overlay)
            yield captioned(picture, caption, anatomy, has_trace=has_trace)


def _show_all(renderer: SceneRenderer, recording: Recording) -> None:
    """Choose one viewpoint for the whole run, so that the camera stands still."""
    states = []
    for motion in recording.motions.values():
        for state in motion.states[:: max(len(motion.states) // STATES_A_MOTION, 1)]:
            data = recording.scene.new_data()
            set_state(recording.scene, data, state)
            states.append(data)
    renderer.look_at(states)
