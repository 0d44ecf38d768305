"""A run in MuJoCo's own viewer, played from its recorded states."""

from __future__ import annotations

import os
import sys
import time

import mujoco

from sim.errors import UsageError
from sim.pictures.moved_anatomy import moved_anatomy
from sim.record.recording import Recording, set_state
from sim.world.scene.scene import Group

FRAME_S = 1 / 60


def check_display() -> None:
    """Check that a window can be opened.

    Raises:
        UsageError: There is no display.
    """
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise UsageError(
            "view: there is no display here (neither DISPLAY nor WAYLAND_DISPLAY is set). Open the run's report.html "
            "in a browser, make a video of it (`sounding replay`), or log it for Rerun (`rerun`)."
        )


def play(recording: Recording, speed: float) -> None:
    """Play a run over and over until the window is closed.

    Args:
        recording: The recording to play.
        speed: How many times faster than the run it plays.

    Raises:
        UsageError: The window cannot be opened.
    """
    # The viewer needs GLFW, which works only with a display.
    from mujoco import viewer as mujoco_viewer

    data = recording.scene.new_data()
    set_state(recording.scene, data, recording.at(0.0)[1])
    try:
        window = mujoco_viewer.launch_passive(
            recording.scene.model, data, show_left_ui=False, show_right_ui=False
        )
    except (RuntimeError, mujoco.FatalError) as error:
        raise UsageError(f"view: MuJoCo's viewer cannot open a window ({error}).") from error
    with window:
        # The viewer hides groups from 3 on.
        window.opt.geomgroup[[Group.ORGAN, Group.TUMOUR]] = 1
        centre_m = recording.scene.anatomy.organ.bounds_m.mean(axis=0)
        window.cam.lookat[:] = centre_m
        window.cam.distance, window.cam.azimuth, window.cam.elevation = 0.9, 120.0, -28.0
        began = time.perf_counter()
        while window.is_running():
            time_s = (time.perf_counter() - began) * speed % max(recording.duration_s, FRAME_S)
            set_state(recording.scene, data, recording.at(time_s)[1])
            with moved_anatomy(data, recording.T_world_rest_at(time_s)):
                window.sync()
            time.sleep(FRAME_S)
