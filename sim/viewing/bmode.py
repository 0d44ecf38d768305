"""One B-mode picture of a scenario at a pose, as a file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing
from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.episode.scenario import Scenario
from sim.episode.setup import build_setup
from sim.episode.truth import Truth, make_truth
from sim.errors import FieldError
from sim.pictures.bmode import bmode_panel
from sim.pictures.png import png_bytes
from sim.world.sensing.image_reader.image_reader import ImageReader
from sim.world.sensing.image_reader.reading_sensor import ReadingSensor
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.ultrasound.ultrasound_sensor import UltrasoundSensor

HEIGHT_PX = 720
"""Height of the picture, with its caption."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnPlane:
    """What a picture shows."""

    pose: int
    """The sensing pose."""
    position_m: NDArray[np.float64]
    """Where the probe touches [m], shape (3,)."""
    reading: Reading
    """The points of the plane, which tell what lies in it."""
    n_points: int
    """Points that were looked at, in the organ or out of it."""

    @property
    def text(self) -> str:
        """What the picture shows, in lines for the terminal."""
        x_mm, y_mm, z_mm = self.position_m * 1e3
        points_m, is_tumour = self.reading.points_m, self.reading.is_occupied
        depths_mm = np.linalg.norm(points_m[is_tumour] - self.position_m, axis=1) * 1e3
        lines = [
            f"pose             {self.pose}, at {x_mm:.1f} {y_mm:.1f} {z_mm:.1f} mm",
            f"seen of the fan  {len(points_m) / self.n_points:.0%} lies in the organ and is in no shadow",
        ]
        found = "none in this plane"
        if len(depths_mm):
            found = f"{is_tumour.mean():.0%} of that, {depths_mm.min():.0f} to {depths_mm.max():.0f} mm from the tip"
        lines.append(f"tumour           {found}")
        return "\n".join(lines)


def draw_plane(
    scenario: Scenario,
    sensor: UltrasoundSensor,
    *,
    seed: int,
    pose: tuple[float, ...] | None,
    rock_rad: float,
    out: Path,
    reader: ImageReader | None = None,
) -> DrawnPlane:
    """Draw the plane of a free probe at a sensing pose of a scenario.

    Args:
        scenario: Where.
        sensor: What draws; of its sweep a single plane.
        seed: Seed of the tumours, as that of an episode, and of the noise.
        pose: The number of a pose, or the place near which it is to be [m], shape (3,); None for the pose whose beam
            comes nearest to the middle of the largest tumour.
        rock_rad: Angle of the plane to the beam [rad].
        out: The PNG to write.
        reader: What reads the picture, with its neighbours of a sweep; None to label it exactly.

    Raises:
        FieldError: There is no such pose.
        WorldError: The scenario's files cannot be used.
    """
    setup = build_setup(scenario)
    truth_rng, sensor_rng, _ = np.random.default_rng(seed).spawn(3)
    truth = make_truth(setup, truth_rng)
    index = _pose_of(pose, setup.workspace, truth)
    data = truth.scene.new_data()
    FreePositioner(truth.scene, setup.workspace).place(data, index, is_lifted=False)
    single = replace(sensor, n_planes=1, middle_rock_rad=rock_rad)
    state = SceneState(truth.scene, data)
    reading = single.sense(state, sensor_rng) if reader is None else _read(single, reader, state, sensor_rng)
    assert reading.images is not None
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as file:
        file.write(png_bytes(bmode_panel(reading.images, HEIGHT_PX), compression=6))
    return DrawnPlane(
        pose=index,
        position_m=setup.workspace.positions_m[index],
        reading=reading,
        n_points=single.n_points,
    )


def _read(
    single: UltrasoundSensor, reader: ImageReader, state: SceneState, rng: np.random.Generator
) -> Reading:
    """The reading of a plane between its neighbours of a sweep, which a reader looks at too."""
    gap_rad = 2.0 * state.cone.half_angle_rad / (UltrasoundSensor.n_planes - 1)
    return ReadingSensor(ultrasound=replace(single, n_planes=3, half_sweep_rad=gap_rad), reader=reader).sense(
        state, rng
    )


def _pose_of(wanted: tuple[float, ...] | None, workspace: Workspace, truth: Truth) -> int:
    """The number of a pose.

    Raises:
        FieldError: There is no pose of that number.
    """
    positions_m, normals = workspace.positions_m, workspace.normals
    if wanted is None:
        return _pose_over_tumour(workspace, truth)
    if len(wanted) == 3:
        return int(np.argmin(np.linalg.norm(positions_m - np.array(wanted), axis=1)))
    number = wanted[0]
    if not (math.isfinite(number) and number == int(number) and 0 <= number < len(normals)):
        raise FieldError("pose", f"{number:.15g}", f"must be a whole number from 0 to {len(normals) - 1}.")
    return int(number)


def _pose_over_tumour(workspace: Workspace, truth: Truth) -> int:
    """The pose whose beam comes nearest to the middle of the largest tumour, the nearer one of equals."""
    anatomy = truth.anatomy
    if not anatomy.tumours:
        return len(workspace.normals) // 2
    middle_m = anatomy.tumours[int(np.argmax(anatomy.tumour_volumes_m3))].vertices_m.mean(axis=0)
    offset_m = middle_m - workspace.positions_m
    depth_m = np.einsum("ij,ij->i", offset_m, workspace.normals)
    beside_m = np.linalg.norm(offset_m - depth_m[:, None] * workspace.normals, axis=1)
    return int(np.argmin(np.where(depth_m > 0.0, beside_m + 0.1 * depth_m, np.inf)))
