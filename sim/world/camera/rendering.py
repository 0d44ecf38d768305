"""Pictures of the scene: arm, probe, organ, tumours, cone, past poses and the map's likely tumour cells."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.colours import INK, MAP, PROBE, rgba, trace_rgb
from sim.world.scene.scene import Group, Scene

from .extent import arm_corners_m, organ_corners_m, probe_corners_m
from .gl import REMEDY, RenderingError, install_backend
from .viewpoint import Margins, Viewpoint, viewpoint_of

SENSED_RGBA = rgba(PROBE)
CURRENT_RGBA = (0.97, 0.98, 0.98, 1.0)
CELL_RGBA = rgba(MAP, 0.85)
PATH_RGBA = rgba(INK, 0.9)
DOT_SHARE, PATH_SHARE, TRACE_SHARE = 0.009, 0.003, 0.004
"""Radii of the dots and of the tip's way, as shares of the organ's size."""
SAMPLES = 2
"""Samples a pixel along each axis. On a software renderer the larger picture takes less time than MuJoCo's own samples,
and shows more: 28 ms in place of 43 to 83 ms for 960 x 720 pixels, where one sample takes 16 ms."""
INSET_SHARE, INSET_HEIGHT = 0.34, 0.56
"""Share of the width, and of the free height, of the picture of the whole arm that stands in a picture."""
INSET_GAP_PX, INSET_FRAME_PX, FRAME_RGB = 14, 2, (250, 251, 252)
"""Its distance to the edges, and the width and the colour of the line around it."""
LEAST_WITH_INSET_PX = 480
"""Narrower pictures show the organ alone."""
HORIZON_MARGIN = 0.035
"""The endless floor fills pictures whose upper edge looks at least this far below the horizon [rad]."""
MAX_CELLS = 400
"""Most cells drawn; of more, an even choice is shown."""


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """Size and viewpoint of the pictures."""

    width_px: int = 960
    """Width [pixels]."""
    height_px: int = 720
    """Height [pixels]."""
    above_px: int = 0
    """Height of the strip above that stays free for a caption [pixels]."""
    below_px: int = 0
    """Height of the strip below that stays free for a legend [pixels]."""

    @property
    def inset_px(self) -> tuple[int, int, int, int]:
        """Left, upper edge, width and height of the picture of the whole arm within a picture [pixels]."""
        free_px = self.height_px - self.above_px - self.below_px
        width_px, height_px = round(INSET_SHARE * self.width_px), round(INSET_HEIGHT * free_px)
        return self.width_px - width_px - INSET_GAP_PX, self.above_px + INSET_GAP_PX, width_px, height_px


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
    trace_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2, 3)))
    """Pieces of the tip's way on the organ so far, each from one place to another, the oldest first, (Q, 2, 3) [m]; the
    older, the darker."""


class SceneRenderer:
    """Draws states of one scene offscreen; a context manager, since it holds an OpenGL context."""

    def __init__(self, scene: Scene, settings: RenderSettings | None = None) -> None:
        """Open an offscreen context.

        Raises:
            RenderingError: No OpenGL backend works here.
        """
        self.settings = settings or RenderSettings()
        self.backend = install_backend()
        size, self.inset_px = self.settings, self.settings.inset_px
        has_inset = not scene.free_probe and size.width_px >= LEAST_WITH_INSET_PX
        self._renderer = self._new_renderer(scene, size.width_px, size.height_px)
        self._inset = self._new_renderer(scene, *self.inset_px[2:]) if has_inset else None
        self._option = _options()
        self._scene, self._camera = scene, mujoco.MjvCamera()
        self._organ_m = organ_corners_m(scene)
        self._size_m = float(np.linalg.norm(np.ptp(self._organ_m, axis=0)))
        self._arm_m = self._probe_m = np.empty((0, 3))
        self.look_at([scene.new_data()], is_at_home=True)

    def _new_renderer(self, scene: Scene, width_px: int, height_px: int) -> mujoco.Renderer:
        """MuJoCo's renderer of pictures with several samples a pixel."""
        # A context takes its size from the model, which others share.
        model = copy.copy(scene.model)
        width_px, height_px = SAMPLES * width_px, SAMPLES * height_px
        model.vis.global_.offwidth, model.vis.global_.offheight = width_px, height_px
        try:
            return mujoco.Renderer(model, height=height_px, width=width_px, max_geom=4000)
        except Exception as error:
            raise RenderingError(f"MuJoCo's renderer failed on {self.backend}: {error}. {REMEDY}") from error

    def look_at(self, states: Sequence[mujoco.MjData], *, is_at_home: bool = False) -> None:
        """Choose the viewpoints anew, so that they hold states of the arm beside those that were given before.

        Args:
            states: The states.
            is_at_home: Whether the probe is far from the organ: only the picture of the whole arm then holds it.
        """
        arm_m = [arm_corners_m(self._scene, data) for data in states]
        self._arm_m = _together([self._arm_m, *arm_m])
        if not is_at_home:
            self._probe_m = _together(
                [self._probe_m, *(probe_corners_m(self._scene, data) for data in states)]
            )
        size, base_m = self.settings, self._scene.T_world_base[:3, 3] - self._organ_m.mean(axis=0)
        base_rad = np.pi if self._scene.free_probe else float(np.arctan2(base_m[1], base_m[0]))
        inset_right = 1.0 - (self.inset_px[0] - INSET_GAP_PX) / size.width_px
        self.viewpoint = viewpoint_of(
            self._organ_m,
            self._probe_m,
            aspect=size.width_px / size.height_px,
            base_rad=base_rad,
            margins=Margins(
                above=size.above_px / size.height_px,
                below=size.below_px / size.height_px,
                right=0.0 if self._inset is None else inset_right,
            ),
        )
        self.inset_viewpoint = viewpoint_of(
            self._organ_m,
            self._arm_m,
            aspect=self.inset_px[2] / self.inset_px[3],
            base_rad=base_rad,
            margins=Margins(),
            least_share=0.0,
        )

    def render(self, data: mujoco.MjData, overlay: Overlay | None = None) -> NDArray[np.uint8]:
        """The picture of a state with smooth edges, shape (height, width, 3)."""
        return averaged(self.render_samples(data, overlay))

    def render_samples(self, data: mujoco.MjData, overlay: Overlay | None = None) -> NDArray[np.uint8]:
        """The picture of a state before its samples are averaged, `SAMPLES` times as high and as wide.

        Where the arm would leave the picture that has it whole, the viewpoints are chosen anew.
        """
        # A probe without an arm has no picture of the whole, and has to be in the large one.
        view = self.viewpoint if self._inset is None else self.inset_viewpoint
        if not (np.abs(view.in_window(arm_corners_m(self._scene, data))) <= 1.0).all():
            self.look_at([data])
        samples = self._drawn(self._renderer, self.viewpoint, data, overlay)
        if self._inset is None:
            return samples
        inset = self._drawn(self._inset, self.inset_viewpoint, data, overlay)
        x, y, width, height = (SAMPLES * each for each in self.inset_px)
        samples = samples.copy()
        frame = SAMPLES * INSET_FRAME_PX
        samples[y - frame : y + height + frame, x - frame : x + width + frame] = FRAME_RGB
        samples[y : y + height, x : x + width] = inset
        return samples

    def _drawn(
        self, renderer: mujoco.Renderer, view: Viewpoint, data: mujoco.MjData, overlay: Overlay | None
    ) -> NDArray[np.uint8]:
        """The picture from one viewpoint."""
        renderer.update_scene(data, self._camera, self._option)
        scene = renderer.scene
        _set_camera(scene, view)
        # Shadows take half of the time and draw ugly edges on a translucent organ.
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        # The sky takes as long as arm and organ together.
        scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = _sees_sky(view)
        if overlay is not None:
            _draw(scene, overlay, self._size_m)
        return renderer.render()

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()
        if self._inset is not None:
            self._inset.close()

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


def _together(points_m: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """All of several sets of points, to a millimetre, each once."""
    return np.unique(np.concatenate(points_m).round(3), axis=0)


def averaged(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture whose pixels are the means of `SAMPLES` x `SAMPLES` samples."""
    return np.asarray(Image.fromarray(samples).reduce(SAMPLES))


def _set_camera(scene: mujoco.MjvScene, view: Viewpoint) -> None:
    """Put the eyes of a picture where a viewpoint is; without stereo MuJoCo takes the mean of the two."""
    for eye in scene.camera:
        near_m = eye.frustum_near
        eye.pos, eye.forward, eye.up = view.eye_m, view.R_world_camera[:, 2], view.R_world_camera[:, 1]
        eye.frustum_center = view.centre[0] * near_m
        eye.frustum_bottom = (view.centre[1] - view.half_height) * near_m
        eye.frustum_top = (view.centre[1] + view.half_height) * near_m


def _sees_sky(view: Viewpoint) -> int:
    """1 where the upper edge of the picture is above the floor's horizon, or nearly, else 0."""
    # The upper corners look along right * x + up * y + forward; they are above the horizon where that rises.
    rise = view.R_world_camera[2, 1] * (view.centre[1] + view.half_height) + view.R_world_camera[2, 2]
    return int(rise > -HORIZON_MARGIN)


def _draw(scene: mujoco.MjvScene, overlay: Overlay, size_m: float) -> None:
    sphere, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    cells_m = overlay.cells_m
    if len(cells_m) > MAX_CELLS:
        cells_m = cells_m[np.linspace(0, len(cells_m) - 1, MAX_CELLS).astype(int)]
    for cell_m in cells_m:
        _add_geom(scene, box, np.full(3, 0.45 * overlay.cell_size_m), cell_m, CELL_RGBA)
    for i, dot_m in enumerate(overlay.sensed_m):
        is_current = i == len(overlay.sensed_m) - 1
        radius_m = DOT_SHARE * size_m * (1.4 if is_current else 1.0)
        _add_geom(scene, sphere, np.full(3, radius_m), dot_m, CURRENT_RGBA if is_current else SENSED_RGBA)
    for start_m, end_m in zip(overlay.path_m[:-1], overlay.path_m[1:], strict=True):
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), start_m, PATH_RGBA)
        if geom is not None:
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, PATH_SHARE * size_m, start_m, end_m)
    for age, (start_m, end_m) in zip(
        np.linspace(0.0, 1.0, len(overlay.trace_m)), overlay.trace_m, strict=True
    ):
        colour = (*trace_rgb(float(age)), 1.0)
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), start_m, colour)
        if geom is not None:
            width_m = TRACE_SHARE * size_m
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, width_m, start_m, end_m)


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
