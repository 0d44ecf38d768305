"""Pictures whose pixels show what they must; and what is said where no picture can be drawn."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.scene.gl import RenderingError, install_backend
from sim.world.scene.rendering import Overlay, SceneRenderer
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


def is_yellow(picture: np.ndarray) -> np.ndarray:
    red, green, blue = (picture[..., i].astype(int) for i in range(3))
    return (red > 150) & (green > 90) & (blue < 90) & (red - blue > 90)


def test_the_size_is_the_one_asked_for(pictures) -> None:
    assert pictures[0].shape == (720, 960, 3)
    assert pictures[0].dtype == np.uint8


def test_tumours_shine_through_the_organ(pictures) -> None:
    full, _, _, empty = pictures
    assert is_yellow(full).sum() > 300
    assert is_yellow(empty).sum() == 0


def test_the_organ_fills_a_fair_part_of_the_middle(pictures) -> None:
    red, green = pictures[3][..., 0].astype(int), pictures[3][..., 1].astype(int)
    rows, columns = np.nonzero(red - green > 10)
    assert len(rows) > 0.02 * 720 * 960
    assert abs(columns.mean() - 480) < 200
    assert abs(rows.mean() - 360) < 200


def test_the_probe_and_its_cone_are_seen(pictures) -> None:
    picture = pictures[3].astype(int)
    blue_probe = (picture[..., 2] > 90) & (picture[..., 0] < 70) & (picture[..., 2] - picture[..., 0] > 50)
    violet_cone = (picture[..., 2] - picture[..., 1] > 25) & (picture[..., 0] - picture[..., 1] > 25)
    assert blue_probe.sum() > 300
    assert violet_cone.sum() > 300


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
from sim.world.scene.gl import adopt_mujoco_gl, install_backend, RenderingError
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
