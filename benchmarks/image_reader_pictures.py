"""Pictures with exact masks by which the reader of images is trained: generated livers with varied looks.

Each liver is a generated one of its own seed with the scenario's clinical load of lesions. Beyond the scenario, every
lesion has a look of its own, drawn wider than the table of tissues; trees of vessels, cysts and calcifications are put
into the tissue, which are no lesions; and every sweep has settings of the machine of its own. Half of the sweeps look
at a lesion, the others from any pose. A training example is a plane with its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from benchmarks.image_reader_tissue import PaintedTissue, painted_tissue
from mapping.storage import replacing
from sim.episode.positioner import Positioner
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.episode.truth import Truth, make_truth
from sim.world.sensing.image_reader.frames import N_COLUMNS, FrameGrid, frames_of
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.sweep import Sweep
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.imager import Imager
from sim.world.sensing.ultrasound.label_grid import LabelGrid
from sim.world.sensing.ultrasound.settings import Settings

N_PLANES = 6
"""Neighbouring planes that are drawn at once."""
SEEN, UNSHADOWED = 1e-3, 0.1
"""Shares of the pulse, before and after compensation, from which on a place counts: the sensor's -60 and -20 dB."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Planes of one sweep with what lies in them."""

    grid: FrameGrid
    brightness: NDArray[np.uint8]
    """Mean brightness of the cells, shape (P, rows, columns)."""
    masks: NDArray[np.uint8]
    """Quarters of each cell that are lesion, shape (P, rows, columns)."""
    counts: NDArray[np.bool_]
    """Whether a cell lies in the organ and is seen, shape (P, rows, columns)."""
    plane_rad: float
    """Angle from plane to plane [rad]."""

    @property
    def frames(self) -> NDArray[np.float32]:
        """What the network reads, shape (P, channels, rows, columns)."""
        return frames_of(self.grid, self.brightness.astype(np.float32), self.plane_rad)

    def frames_of_plane(self, plane: int) -> NDArray[np.float32]:
        """What the network reads of one plane, shape (channels, rows, columns)."""
        near = np.clip(np.arange(plane - 1, plane + 2), 0, len(self.brightness) - 1)
        return frames_of(self.grid, self.brightness[near].astype(np.float32), self.plane_rad)[1]


def pictures_of(seed: int, folder: Path, n_loads: int = 3, n_sweeps: int = 20) -> list[Examples]:
    """Sweeps of a generated liver, taken from a folder where they are there, and put there where they are not.

    Args:
        seed: The liver's seed.
        folder: Where the pictures are kept.
        n_loads: How often lesions are planted in it.
        n_sweeps: Sweeps of each.
    """
    file = folder / f"{seed}-{n_loads}x{n_sweeps}.npz"
    if not file.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        arrays = {}
        for n, each in enumerate(examples_of(seed, n_loads, n_sweeps)):
            arrays[f"brightness{n}"], arrays[f"masks{n}"] = each.brightness, each.masks
            arrays[f"counts{n}"] = np.packbits(each.counts)
            arrays[f"depth_rad{n}"] = np.array([each.grid.array.depth_m, each.plane_rad])
        with replacing(file) as into:
            np.savez_compressed(into, **arrays)
    with np.load(file) as arrays:
        return [_loaded(arrays, n) for n in range(n_loads * n_sweeps)]


def _loaded(arrays: Any, n: int) -> Examples:
    depth_m, plane_rad = arrays[f"depth_rad{n}"].tolist()
    masks = arrays[f"masks{n}"]
    counts = np.unpackbits(arrays[f"counts{n}"], count=masks.size).reshape(masks.shape).astype(bool)
    grid = FrameGrid.of(ConvexArray(depth_m=depth_m))
    return Examples(grid, arrays[f"brightness{n}"], masks, counts, plane_rad)


def examples_of(seed: int, n_loads: int, n_sweeps: int) -> Iterator[Examples]:
    """Sweeps of a generated liver.

    Args:
        seed: The liver's seed.
        n_loads: How often lesions are planted in it.
        n_sweeps: Sweeps of each.
    """
    setup = build_setup(replace(load_scenario("generated-liver"), organ_seed=seed))
    for rng in np.random.default_rng((seed, 7)).spawn(n_loads):
        truth = make_truth(setup, rng)
        tissue = painted_tissue(truth, rng)
        state = SceneState(truth.scene, truth.scene.new_data())
        for _ in range(n_sweeps):
            yield _sweep(setup, truth, state, tissue, rng)


def _sweep(
    setup: Setup, truth: Truth, state: SceneState, tissue: PaintedTissue, rng: np.random.Generator
) -> Examples:
    """One sweep with settings of its own."""
    frequency_hz = rng.uniform(2.8e6, 4.5e6)
    array = ConvexArray(
        depth_m=float(rng.choice([0.13, 0.13, 0.13, rng.uniform(0.09, 0.15)])), frequency_hz=frequency_hz
    )
    settings = Settings(
        gain_db=rng.normal(0.0, 4.0),
        tgc_db_cm_mhz=rng.uniform(0.42, 0.60),
        range_db=rng.uniform(52.0, 68.0),
        noise_db=rng.uniform(-70.0, -60.0),
        tissue_seed=int(rng.integers(1 << 20)),
    )
    plane_rad = float(rng.uniform(0.017, 0.05))
    T_world_planes = _planes(setup, truth, state, plane_rad, rng)
    imager, grid = Imager(array, settings), FrameGrid.of(array)
    drawn = [imager.plane(tissue.grid, T, int(rng.integers(1 << 31))) for T in T_world_planes]
    fan = imager.fan
    images = np.stack([each.image for each in drawn])
    sweep = Sweep(images, T_world_planes, fan.pixel_m, fan.left_m, fan.top_m, np.zeros(0, np.int64))
    brightness = grid.brightness(sweep).round().astype(np.uint8)
    masks, is_organ = cells_of(grid, T_world_planes, tissue.grid, tissue.is_lesion)
    left = np.stack([each.left for each in drawn])
    rows = (np.arange(grid.n_rows) + 0.5) * array.n_samples / grid.n_rows
    columns = (np.arange(N_COLUMNS) + 0.5) * (array.n_lines - 1) / N_COLUMNS
    left = left[:, rows.astype(int)][:, :, columns.astype(int)]
    is_seen = (left >= SEEN) & (left * imager.gains[rows.astype(int)][:, None] >= UNSHADOWED)
    return Examples(grid, brightness, masks, is_organ & is_seen, plane_rad)


def _planes(
    setup: Setup, truth: Truth, state: SceneState, plane_rad: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Neighbouring planes somewhere in a sweep, shape (N_PLANES, 4, 4); mostly one of them meets a lesion."""
    positioner: Positioner = setup.positioner
    solid = truth.anatomy.tumours[int(rng.integers(len(truth.anatomy.tumours)))]
    centre_m = solid.vertices_m.mean(axis=0)
    rock_rad = rng.uniform(-0.26, 0.26)
    for attempt in range(40):
        pose = int(rng.integers(setup.workspace.n_poses))
        positioner.place(state.data, pose, is_lifted=False)
        T = state.T_world_probe
        at_m = (centre_m - T[:3, 3]) @ T[:3, :3]
        if attempt == 0 and rng.random() < 0.35:
            break
        is_in_plane = abs(np.arctan2(at_m[0], at_m[2] + 0.025)) < 0.5
        if 0.0 < at_m[2] < 0.12 and is_in_plane and abs(np.arctan2(at_m[1], at_m[2])) < 0.3:
            rock_rad = -np.arctan2(at_m[1], at_m[2])
            break
    rocks_rad = rock_rad + plane_rad * (np.arange(N_PLANES) - rng.integers(N_PLANES))
    rocked = np.tile(np.eye(4), (N_PLANES, 1, 1))
    rocked[:, 1, 1] = rocked[:, 2, 2] = np.cos(rocks_rad)
    rocked[:, 1, 2], rocked[:, 2, 1] = -np.sin(rocks_rad), np.sin(rocks_rad)
    return state.T_world_probe @ rocked


def cells_of(
    grid: FrameGrid,
    T_world_planes: NDArray[np.float64],
    tissue: LabelGrid,
    is_lesion: NDArray[np.float32],
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The quarters of each cell that are lesion, and whether its middle lies in the organ, shape (P, rows, columns)."""
    offsets = (-0.25, 0.25)
    rows, columns = np.arange(grid.n_rows, dtype=float), np.arange(N_COLUMNS, dtype=float)
    masks = np.zeros((len(T_world_planes), grid.n_rows, N_COLUMNS), np.uint8)
    for down in offsets:
        for across in offsets:
            x_z_m = grid.points_m(*np.meshgrid(rows + down, columns + across, indexing="ij"))
            masks += looked_up(x_z_m, T_world_planes, tissue, is_lesion, order=1) > 0.0
    x_z_m = grid.points_m(*np.meshgrid(rows, columns, indexing="ij"))
    label = looked_up(x_z_m, T_world_planes, tissue, tissue.labels.astype(np.float32), order=0)
    return masks, label > 0.5


def looked_up(
    x_z_m: NDArray[np.float64],
    T_world_planes: NDArray[np.float64],
    tissue: LabelGrid,
    values: NDArray[np.float32],
    *,
    order: int,
) -> NDArray[np.float32]:
    """Values of the nodes at places of all planes, shape (P, rows, columns)."""
    x_m, z_m = x_z_m[..., 0], x_z_m[..., 1]
    in_plane_m = np.stack([x_m, np.zeros_like(x_m), z_m], axis=-1)
    points_m = np.einsum("pij,rcj->iprc", T_world_planes[:, :3, :3], in_plane_m)
    points_m += T_world_planes[:, :3, 3].T[:, :, None, None]
    at = (points_m - tissue.origin_m[:, None, None, None]) / tissue.spacing_m
    return map_coordinates(values, at, order=order, mode="constant", cval=-0.5 if order else 0.0)
