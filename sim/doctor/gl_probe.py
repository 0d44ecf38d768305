"""Which OpenGL renders here: each is tried in a process of its own, since a failing one can end the process.

With its library missing, MUJOCO_GL=egl makes even `import mujoco` fail. It runs by
`.venv/bin/python -m sim.doctor.gl_probe` to print what works; the exit code is 0 if frames can be rendered without a
display.
"""

import json
import os
import subprocess
import sys
import textwrap
from dataclasses import dataclass

GL_NAMES = ("egl", "osmesa", "glfw")
"""MuJoCo's renderers, the preferred first; glfw needs a display."""
HEADLESS_GL_NAMES = ("egl", "osmesa")
GL_REMEDY = "as root: apt-get install libegl1 libgl1 (or only libosmesa6)"
"""What to install on Debian and Ubuntu where nothing renders."""

_PROBE_TIMEOUT_S = 60.0
_MESSAGE_WIDTH = 80
_PROBE = """
import json, time, mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><visual><global offwidth='640' offheight='480'/></visual><worldbody>"
    "<light pos='0 0 3'/><geom type='plane' size='1 1 .1'/><geom type='sphere' size='.2' pos='0 0 .2'/>"
    "</worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 480, 640) as renderer:
    times = []
    for _ in range(6):
        start = time.perf_counter()
        renderer.update_scene(data)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        frame = renderer.render()
        times.append(time.perf_counter() - start)
print(json.dumps({"frame_s": sorted(times[1:])[2], "contrast": int(frame.max()) - int(frame.min())}))
"""
"""A lit ball on a plane, 640 x 480, no shadows; the time is the median of five frames after the first."""


@dataclass(frozen=True, kw_only=True)
class GlProbe:
    """What a try of one OpenGL showed."""

    name: str
    """The value of MUJOCO_GL."""
    is_working: bool
    """Whether it drew a picture with something on it."""
    frame_s: float | None
    """Time of a 640 x 480 frame [s]; None if it does not work."""
    message: str
    """Why it does not work; empty if it does."""


def probe_gl(name: str) -> GlProbe:
    """What one OpenGL does with a tiny scene, which a subprocess renders.

    Args:
        name: One of GL_NAMES.
    """
    command = [sys.executable, "-c", _PROBE]
    environment = {**os.environ, "MUJOCO_GL": name}
    # A renderer that was loaded earlier may have left it there; it would rule the others out.
    environment.pop("PYOPENGL_PLATFORM", None)
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=_PROBE_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return _failure(name, f"no picture within {_PROBE_TIMEOUT_S:.0f} s")
    if done.returncode != 0:
        lines = [line for line in done.stderr.strip().splitlines() if line.strip()]
        return _failure(
            name, lines[-1].strip() if lines else f"the process ended with code {done.returncode}"
        )
    result = json.loads(done.stdout.strip().splitlines()[-1])
    if result["contrast"] == 0:
        return _failure(name, "the picture is empty")
    return GlProbe(name=name, is_working=True, frame_s=result["frame_s"], message="")


def main() -> int:
    """Print the first OpenGL that renders without a display, and return 0 if there is one, 1 otherwise."""
    for name in HEADLESS_GL_NAMES:
        probe = probe_gl(name)
        if probe.is_working:
            print(f"renderer: {name} works")
            return 0
        print(f"renderer: {name} does not work ({probe.message})", file=sys.stderr)
    return 1


def _failure(name: str, message: str) -> GlProbe:
    # PyOpenGL says so when it found no library to load.
    if "NoneType" in message:
        message = "its library is missing"
    return GlProbe(
        name=name, is_working=False, frame_s=None, message=textwrap.shorten(message, _MESSAGE_WIDTH)
    )


if __name__ == "__main__":
    sys.exit(main())
