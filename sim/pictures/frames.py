"""Frames: a captioned picture per action, compressed on a thread of its own while the episode goes on."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from mapping.storage import replacing
from sim.closeable import Closeable
from sim.episode.episode import Episode
from sim.episode.step import Step
from sim.episode.sweeping.contact_trace import traces_of
from sim.world.anatomy.anatomy import Anatomy
from sim.world.camera.rendering import Overlay, SceneRenderer, averaged
from sim.world.sensing.sweep import Sweep

from .bmode import bmode_panel
from .captions import captioned, frame_settings
from .moved_anatomy import moved_anatomy
from .png import png_bytes

LIKELY = 0.7
"""Cells with a higher probability of tumour are drawn. It is well above the prior of 0.5, that of unsensed cells."""


N_FORESEEN = 9
"""Poses, spread over the workspace, for which the camera is placed before the first picture."""


def frame_renderer(episode: Episode) -> SceneRenderer:
    """A renderer of an episode's frames, whose camera has the arm whole at home and all over the workspace.

    Raises:
        RenderingError: No OpenGL works here.
    """
    scene, positioner = episode.truth.scene, episode.setup.positioner
    has_trace = episode.motion_model.senses_in_motion
    renderer = SceneRenderer(scene, frame_settings(episode.truth.anatomy, has_trace=has_trace))
    states = []
    for pose in _spread_poses(episode.setup.workspace.positions_m):
        if positioner.reach(pose).is_reached:
            states.append(scene.new_data())
            positioner.place(states[-1], pose, is_lifted=True)
    renderer.look_at(states)
    return renderer


def _spread_poses(positions_m: NDArray[np.float64]) -> list[int]:
    """The poses that lie farthest along eight directions across the table, and the highest."""
    turn_rad = np.linspace(0.0, 2.0 * np.pi, N_FORESEEN - 1, endpoint=False)
    directions = np.vstack([np.column_stack([np.cos(turn_rad), np.sin(turn_rad), 0.0 * turn_rad]), [0, 0, 1]])
    return np.unique((positions_m @ directions.T).argmax(axis=0)).tolist()


class EpisodeFrames(Closeable):
    """The frames of one episode, drawn into the folder `frames` of its run; none without a renderer."""

    def __init__(self, run_path: Path, episode: Episode, renderer: SceneRenderer | None) -> None:
        """Draw with `renderer`, which knows the scene of `episode`, below `run_path`."""
        self._folder, self._renderer, self._episode = run_path / "frames", renderer, episode
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._pending: list[Future[None]] = []
        self._cell_size_m = float(np.diff(episode.setup.query.axes_m[0]).min())
        self.draw_s = 0.0
        """Seconds for which drawing kept the episode waiting."""
        if renderer is not None:
            self._folder.mkdir(exist_ok=True)

    def draw(self, name: str, steps: Sequence[Step]) -> None:
        """Draw the episode's present state, at the pose of the last of its `steps` so far, to `name` in the folder."""
        if self._renderer is None:
            return
        start_s = perf_counter()
        step = steps[-1]
        samples = self._samples(self._renderer, self._overlay(steps))
        caption, anatomy = _caption(self._episode, step), self._episode.truth.anatomy
        self._pending = [job for job in self._pending if not job.done() or job.result()]
        has_trace = self._episode.motion_model.senses_in_motion
        job = self._pool.submit(
            _save,
            self._folder / name,
            samples,
            caption,
            anatomy,
            sweep=step.reading.images,
            has_trace=has_trace,
        )
        self._pending.append(job)
        self.draw_s += perf_counter() - start_s

    def _samples(self, renderer: SceneRenderer, overlay: Overlay) -> NDArray[np.uint8]:
        """The picture of the present state, with the organ where it is, and what is known where it is believed."""
        data, body = self._episode.data, self._episode.body
        if body is None:
            return renderer.render_samples(data, overlay)
        T = body.T_world_rest_believed(body.inhaled_share)
        sensed_m, cells_m = (each @ T[:3, :3].T + T[:3, 3] for each in (overlay.sensed_m, overlay.cells_m))
        with moved_anatomy(data, body.T_world_rest):
            return renderer.render_samples(data, replace(overlay, sensed_m=sensed_m, cells_m=cells_m))

    def _overlay(self, steps: Sequence[Step]) -> Overlay:
        episode = self._episode
        workspace = episode.setup.workspace
        sensed_m = workspace.positions_m[episode.sensed]
        prediction = episode.prediction
        cells_m = np.empty((0, 3))
        if prediction is not None:
            cells_m = episode.setup.search_points_m[self._is_rind(prediction.probability > LIKELY)]
        return Overlay(
            sensed_m=sensed_m,
            cells_m=cells_m,
            cell_size_m=self._cell_size_m,
            path_m=steps[-1].motion.tips_m,
            trace_m=np.concatenate([each.pieces_m for each in traces_of([step.motion for step in steps])]),
        )

    def _is_rind(self, is_likely: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which search points are likely and have a neighbour that is not: only these are seen of a heap of cells."""
        setup = self._episode.setup
        core = np.asarray(binary_erosion(setup.on_lattice(is_likely, outside=False)), dtype=np.bool_)
        return is_likely & ~core.ravel()[setup.is_inside]

    def close(self) -> None:
        """Wait until every picture is on the disk.

        Raises:
            OSError: A picture could not be written.
        """
        self._pool.shutdown(wait=True)
        for job in self._pending:
            job.result()
        self._pending.clear()


def _caption(episode: Episode, step: Step) -> str:
    """The scenario, and where the episode stands."""
    parts = [f"{episode.setup.scenario.name}", f"action {step.step}"]
    if step.sensed_fraction is not None:
        parts.append(f"tumour sensed {step.sensed_fraction:.0%}")
    if step.auprc is not None:
        parts.append(f"AUPRC {step.auprc:.2f}")
    if episode.target is not None and step.target is not None:
        parts.append(f"{episode.target.name} sensed {step.target.sensed_fraction:.0%}")
    return "   ·   ".join(parts)


def _save(
    path: Path,
    samples: NDArray[np.uint8],
    caption: str,
    anatomy: Anatomy,
    *,
    sweep: Sweep | None,
    has_trace: bool,
) -> None:
    """Write a frame, with the B-mode picture beside the scene where the sensor drew one."""
    pixels = captioned(averaged(samples), caption, anatomy, has_trace=has_trace)
    if sweep is not None:
        pixels = np.hstack([pixels, bmode_panel(sweep, len(pixels))])
    with replacing(path) as file:
        file.write(png_bytes(pixels))
