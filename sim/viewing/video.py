"""Video: a recorded run as an MP4 file, drawn from its states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from sim.cli.replay_options import ReplayOptions
from sim.errors import UsageError
from sim.pictures.captions import captioned
from sim.world.scene.rendering import Overlay, RenderSettings, SceneRenderer

if TYPE_CHECKING:
    from .replay import Recording

EXTRA = "pip install 'sounding[video]'"
CODEC = "libx264"
PATH_EVERY = 8
"""Of the recorded states every so many is a corner of the drawn path of the tip."""


def write_video(recording: Recording, options: ReplayOptions) -> int:
    """Render a recording to `options.video`; returns the number of frames.

    Frame i shows the procedure at i speed / fps seconds; the last one is at or just before its end.

    Raises:
        UsageError: PyAV is missing, or the file cannot be written.
        RenderingError: No OpenGL works here.
    """
    av = _import_av()
    path = options.video
    assert path is not None
    partial = path.with_name(f".{path.stem}.part.mp4")
    n_frames = int(np.floor(recording.duration_s * options.fps / options.speed + 1e-9)) + 1
    try:
        with av.open(str(partial), "w") as container:
            stream = container.add_stream(CODEC, rate=options.fps)
            stream.width, stream.height, stream.pix_fmt = options.width_px, options.height_px, "yuv420p"
            for picture in _pictures(recording, options, n_frames):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(stream.encode())
        partial.replace(path)
    except (OSError, av.FFmpegError) as error:
        raise UsageError(f"--video {path}: cannot be written ({error}).") from error
    finally:
        partial.unlink(missing_ok=True)
    return n_frames


def _pictures(recording: Recording, options: ReplayOptions, n_frames: int) -> Iterator[NDArray[np.uint8]]:
    """The frames in order, each of shape (height, width, 3)."""
    from .replay import set_state

    data = recording.scene.new_data()
    steps = list(recording.motions)
    settings = RenderSettings(width_px=options.width_px, height_px=options.height_px)
    with SceneRenderer(recording.scene, settings) as renderer:
        for frame in tqdm(range(n_frames), desc="rendering", unit="frame", mininterval=0.5):
            time_s = frame * options.speed / options.fps
            step, state = recording.at(time_s)
            set_state(recording.scene, data, state)
            index = steps.index(step)
            overlay = Overlay(
                sensed_m=recording.sensed_m[:index], path_m=recording.motions[step].tips_m[::PATH_EVERY]
            )
            caption = f"{recording.folder.name}   ·   action {step}   ·   {time_s:.1f} s"
            yield captioned(renderer.render(data, overlay), caption, recording.scene.anatomy.structures)


def _import_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise UsageError(f"--video needs PyAV, which is not installed: {EXTRA}.") from error
    return av
