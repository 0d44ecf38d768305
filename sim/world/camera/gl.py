"""OpenGL without a display: finding a backend when the first picture is wanted, never before.

Physics, rays and IK need no OpenGL, so nothing here runs at import, and a missing library is an error that names the
package to install.
"""

from __future__ import annotations

import ctypes.util
import importlib
import os
import sys
from typing import Any

from sim.world.errors import WorldError

BACKENDS = ("egl", "osmesa", "glfw")
"""The order in which backends are tried when none is named: GPU or llvmpipe, software, a window system."""
LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
"""The system library that each windowless backend needs."""
GL_VARIABLE = "SOUNDING_GL"
"""Environment variable that names the one backend to use; MUJOCO_GL counts too."""
REMEDY = (
    "On Debian or Ubuntu: apt-get install libegl1 libgl1 (or libosmesa6, then SOUNDING_GL=osmesa). "
    "Without pictures everything else works: `frames` none."
)


class RenderingError(WorldError):
    """No picture can be drawn on this machine as it is."""


def adopt_mujoco_gl() -> None:
    """Move MUJOCO_GL to SOUNDING_GL. This is to be called before mujoco is imported.

    With MUJOCO_GL=egl and no EGL library, `import mujoco` itself would die.
    """
    named = os.environ.pop("MUJOCO_GL", "").strip().lower()
    if named in BACKENDS:
        os.environ.setdefault(GL_VARIABLE, named)


def install_backend() -> str:
    """The name of the first backend that works, which mujoco's renderer is given.

    Raises:
        RenderingError: None works; the text lists each failure and the packages to install.
    """
    from mujoco.rendering.classic import gl_context

    named = os.environ.get(GL_VARIABLE, os.environ.get("MUJOCO_GL", "")).strip().lower()
    if named and named not in BACKENDS:
        raise RenderingError(f"{GL_VARIABLE}={named}: choose one of {', '.join(BACKENDS)}.")
    failures: list[str] = []
    for backend in [named] if named else BACKENDS:
        try:
            context_class = _context_class(backend)
            _try_context(context_class)
        except Exception as error:
            failures.append(f"{backend}: {_reason(backend, error)}")
            _forget_opengl(backend)
            continue
        gl_context.GLContext = context_class
        return backend
    raise RenderingError(f"No OpenGL backend works ({'; '.join(failures)}). {REMEDY}")


def _try_context(context_class: Any) -> None:
    """Make a context and load a model into it; glfw without a display fails only at the second."""
    import mujoco

    context = context_class(8, 8)
    try:
        context.make_current()
        scale = mujoco.mjtFontScale.mjFONTSCALE_50.value
        mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), scale).free()
    finally:
        context.free()


def _reason(backend: str, error: Exception) -> str:
    library = LIBRARIES.get(backend)
    if library is not None and ctypes.util.find_library(library) is None:
        return f"lib{library} is not installed"
    return f"{type(error).__name__}: {str(error).strip()[:120]}"


def _forget_opengl(backend: str) -> None:
    """Unload the bindings that a failed backend has tied to itself, so that the next one can bind its own."""
    for name in list(sys.modules):
        if name == "OpenGL" or name.startswith(("OpenGL.", f"mujoco.{backend}")):
            del sys.modules[name]


def _context_class(backend: str) -> type:
    """MuJoCo's context class of a backend; a failed import leaves no half-loaded module behind."""
    variable, before = "PYOPENGL_PLATFORM", os.environ.get("PYOPENGL_PLATFORM")
    if backend in ("egl", "osmesa"):
        os.environ[variable] = backend
    try:
        return importlib.import_module(f"mujoco.{backend}").GLContext
    finally:
        if before is None:
            os.environ.pop(variable, None)
        else:
            os.environ[variable] = before
