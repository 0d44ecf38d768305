"""Pictures of the scene: arm, probe, organ, tumours, cone, past poses and the map's likely tumour cells."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray

from .gl import REMEDY, RenderingError, install_backend
from .scene import Group, Scene

SENSED_RGBA = (0.06, 0.18, 0.42, 1.0)
CURRENT_RGBA = (0.95, 0.95, 1.0, 1.0)
CELL_RGBA = (0.00, 0.60, 0.78, 0.55)
PATH_RGBA = (0.30, 0.34, 0.40, 0.9)
DOT_RADIUS_M = 0.0028
PATH_RADIUS_M = 0.0009
HORIZON_MARGIN_DEG = 2.0
"""The endless floor fills pictures whose upper edge looks at least this far below the horizon."""
MAX_CELLS = 400
"""Most cells drawn; of more, an even choice is shown."""


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """Size and viewpoint of the pictures."""

    width_px: int = 960
    """Width [pixels]."""
    height_px: int = 720
    """Height [pixels]."""
    azimuth_deg: float = 128.0
    """Direction of view about z, as MuJoCo counts it [degrees]: 90 looks along +y, 180 along -x."""
    elevation_deg: float = -27.0
    """Direction of view above the horizon [degrees]; negative looks down."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Overlay:
    """What a picture shows beside the bodies."""

    sensed_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    """Positions sensed so far, the current one last, shape (N, 3) [m]."""
    cells_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    """Centres of the cells that the map believes occupied, shape (K, 3) [m]."""
    cell_size_m: float = 0.003
    """Edge of a cell [m]."""
    path_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    """The tip's path since the last action, shape (P, 3) [m]."""


class SceneRenderer:
    """Draws states of one scene offscreen; a context manager, since it holds an OpenGL context."""

    def __init__(self, scene: Scene, settings: RenderSettings | None = None) -> None:
        """Open an offscreen context.

        Raises:
            RenderingError: No OpenGL backend works here.
        """
        self.settings = settings or RenderSettings()
        self.backend = install_backend()
        try:
            self._renderer = mujoco.Renderer(
                scene.model, height=self.settings.height_px, width=self.settings.width_px, max_geom=4000
            )
        except Exception as error:
            raise RenderingError(f"MuJoCo's renderer failed on {self.backend}: {error}. {REMEDY}") from error
        self._camera = _camera(scene, self.settings)
        self._option = _options()
        top_deg = self.settings.elevation_deg + scene.model.vis.global_.fovy / 2.0
        self._sees_sky = int(top_deg > -HORIZON_MARGIN_DEG)

    def render(self, data: mujoco.MjData, overlay: Overlay | None = None) -> NDArray[np.uint8]:
        """The picture of a state, shape (height, width, 3)."""
        self._renderer.update_scene(data, self._camera, self._option)
        scene = self._renderer.scene
        # Shadows take half of the time and draw ugly edges on a translucent organ.
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        # The sky takes as long as arm and organ together.
        scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = self._sees_sky
        if overlay is not None:
            _draw(scene, overlay)
        return self._renderer.render()

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()

    def __enter__(self) -> SceneRenderer:
        """The renderer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the context."""
        self.close()


def _options() -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    for group in (Group.SCENERY, Group.TARGET, Group.ARM, Group.ORGAN, Group.TUMOUR):
        option.geomgroup[int(group)] = 1
    option.sitegroup[:] = 0
    option.sitegroup[0] = 1
    return option


def _camera(scene: Scene, settings: RenderSettings) -> mujoco.MjvCamera:
    """A view of the organ with the arm behind it, at a distance that fits both."""
    low_m, high_m = scene.anatomy.organ.bounds_m
    size_m = float(np.linalg.norm(high_m - low_m))
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = (low_m + high_m) / 2.0 + np.array([-0.16, 0.0, 0.24]) * size_m
    camera.distance = 2.3 * size_m
    camera.azimuth, camera.elevation = settings.azimuth_deg, settings.elevation_deg
    return camera


def _draw(scene: mujoco.MjvScene, overlay: Overlay) -> None:
    sphere, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    cells_m = overlay.cells_m
    if len(cells_m) > MAX_CELLS:
        cells_m = cells_m[np.linspace(0, len(cells_m) - 1, MAX_CELLS).astype(int)]
    for cell_m in cells_m:
        _add_geom(scene, box, np.full(3, 0.45 * overlay.cell_size_m), cell_m, CELL_RGBA)
    for i, dot_m in enumerate(overlay.sensed_m):
        is_current = i == len(overlay.sensed_m) - 1
        radius_m = DOT_RADIUS_M * (1.4 if is_current else 1.0)
        _add_geom(scene, sphere, np.full(3, radius_m), dot_m, CURRENT_RGBA if is_current else SENSED_RGBA)
    for start_m, end_m in zip(overlay.path_m[:-1], overlay.path_m[1:], strict=True):
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), start_m, PATH_RGBA)
        if geom is not None:
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, PATH_RADIUS_M, start_m, end_m)


def _add_geom(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size_m: NDArray[np.float64],
    position_m: NDArray[np.float64],
    rgba: tuple[float, float, float, float],
) -> mujoco.MjvGeom | None:
    """The geom that is added to the picture, or None when the picture is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size_m, position_m, np.eye(3).ravel(), np.array(rgba, dtype=np.float32))
    scene.ngeom += 1
    return geom
