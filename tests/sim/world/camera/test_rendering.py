"""Pictures whose pixels show what they must; and what is said where no picture can be drawn."""

from __future__ import annotations

import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.camera.extent import arm_corners_m, organ_corners_m
from sim.world.camera.gl import RenderingError, install_backend
from sim.world.camera.rendering import Overlay, SceneRenderer
from sim.world.scene.scene import build_scene


@pytest.fixture(scope="module")
def _gl() -> None:
    try:
        install_backend()
    except RenderingError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def pictures(_gl, ball_anatomy, cone):
    """(picture of the ball with its tumours, the same without tumours, the same with an overlay)."""
    pose = Workspace(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
    empty = build_anatomy(ball_anatomy.organ, name="empty", rng=np.random.default_rng(0))
    found = []
    for anatomy in (ball_anatomy, empty):
        scene = build_scene(anatomy, cone, arm=None)
        data = scene.new_data()
        FreePositioner(scene, pose).place(data, 0, is_lifted=False)
        with SceneRenderer(scene) as renderer:
            found.append(renderer.render(data))
            if anatomy is ball_anatomy:
                overlay = Overlay(
                    sensed_m=pose.positions_m, cells_m=np.array([[0.5, 0.0, 0.08]]), cell_size_m=0.03
                )
                found.append(renderer.render(data, overlay))
                found.append(renderer.render(data))
    return found


def parts(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(picture[..., i].astype(int) for i in range(3))


def is_orange(picture: np.ndarray) -> np.ndarray:
    red, green, blue = parts(picture)
    return (red - green > 45) & (green - blue > 25)


def is_green(picture: np.ndarray) -> np.ndarray:
    red, green, blue = parts(picture)
    return (green - red > 60) & (green - blue > 15)


def is_organ(picture: np.ndarray) -> np.ndarray:
    """Where the picture is grey and brown, neither drape nor floor, which are bluer."""
    red, _, blue = parts(picture)
    return red - blue > -17


def test_the_size_is_the_one_asked_for(pictures) -> None:
    assert pictures[0].shape == (720, 960, 3)
    assert pictures[0].dtype == np.uint8


def test_tumours_shine_through_the_organ(pictures) -> None:
    full, _, _, empty = pictures
    assert is_orange(full).sum() > 300
    assert is_orange(empty).sum() == 0


def test_the_organ_takes_more_than_a_third_of_the_width(pictures) -> None:
    columns = np.flatnonzero(is_organ(pictures[3]).sum(axis=0) > 20)
    assert np.ptp(columns) > 960 / 3


def test_the_probe_and_its_cone_are_seen(pictures) -> None:
    green = is_green(pictures[3])
    assert green.sum() > 3000
    # The cone shows through the organ below the probe's tip.
    assert is_green(pictures[3])[:360].sum() > 300


def test_edges_are_smooth(pictures) -> None:
    """Between the organ and the drape lie pixels of a colour between theirs, as one sample a pixel never gives."""
    row = pictures[3][:, :, 0].astype(int)
    steps = np.abs(np.diff(row, axis=1))
    is_between = (steps[:, :-1] > 12) & (steps[:, 1:] > 12)
    assert is_between.sum() > 200


@pytest.mark.usefixtures("_gl")
def test_an_arm_is_shown_whole_and_the_organ_large(scene) -> None:
    data = scene.new_data()
    with SceneRenderer(scene) as renderer:
        picture = renderer.render(data)
        assert (np.abs(renderer.inset_viewpoint.in_window(arm_corners_m(scene, data))) <= 1.0).all()
        organ = renderer.viewpoint.in_window(organ_corners_m(scene))
        assert np.ptp(organ[:, 0]) / 2.0 > 1.0 / 3.0
        left, upper, width, height = renderer.inset_px
        # The arm's white shells fill a fair part of their picture, and none of the free edge beside it.
        inset = picture[upper : upper + height, left : left + width]
        assert (inset.min(axis=-1) > 190).mean() > 0.03
        # Nothing of the organ lies behind the picture of the arm.
        x_px = (organ[:, 0] + 1.0) / 2.0 * 960
        assert x_px.max() < left


@pytest.mark.usefixtures("_gl")
def test_the_camera_stands_still_until_the_arm_would_leave_the_picture(scene) -> None:
    with SceneRenderer(scene) as renderer:
        data = scene.new_data()
        before = renderer.inset_viewpoint
        renderer.render(data)
        assert renderer.inset_viewpoint is before
        data.qpos[1] -= 1.2
        mujoco.mj_forward(scene.model, data)
        renderer.render(data)
        assert renderer.inset_viewpoint is not before
        assert (np.abs(renderer.inset_viewpoint.in_window(arm_corners_m(scene, data))) <= 1.0).all()


def test_the_overlay_is_drawn_and_leaves_no_trace(pictures) -> None:
    plain, overlaid, plain_again, _ = pictures
    assert (plain != overlaid).any(axis=-1).sum() > 200
    assert np.array_equal(plain, plain_again)


def test_an_unknown_backend_is_refused(monkeypatch) -> None:
    monkeypatch.setenv("SOUNDING_GL", "vulkan")
    with pytest.raises(RenderingError, match="vulkan.*egl, osmesa, glfw"):
        install_backend()


def test_without_gl_libraries_the_remedy_is_named_and_the_rest_works() -> None:
    """A process in which no GL library can be loaded: MuJoCo imports, rendering says what to install."""
    script = """
import ctypes, ctypes.util, os, sys
os.environ["MUJOCO_GL"] = "egl"
ctypes.util.find_library = lambda name: None
real = ctypes.CDLL
def no_gl(name, *rest, **more):
    if name and any(part in str(name) for part in ("EGL", "OSMesa", "libGL", "OpenGL")):
        raise OSError(f"{name}: cannot open shared object file")
    return real(name, *rest, **more)
ctypes.CDLL = ctypes.cdll._dlltype = no_gl
from sim.world.camera.gl import adopt_mujoco_gl, install_backend, RenderingError
adopt_mujoco_gl()
import mujoco
mujoco.mj_forward(m := mujoco.MjModel.from_xml_string("<mujoco/>"), mujoco.MjData(m))
try:
    install_backend()
except RenderingError as error:
    print(error)
else:
    print('rendered by', __import__('mujoco').rendering.classic.gl_context.GLContext)
"""
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "SOUNDING_GL", "MUJOCO_GL")}
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=env, timeout=300)
    assert run.returncode == 0, run.stderr
    assert "apt-get install libegl1 libgl1" in run.stdout, run.stdout
