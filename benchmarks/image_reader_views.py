"""What the reader of images makes of single sweeps: lesions found, outlines, false blobs, by the exact tissue.

All is counted over the cells of the frames that the network reads, those in the organ that the probe sees, each with
the volume that it stands for. A lesion is in a view where that holds at least 0.1 ml of it or a quarter of it, and is
found where a fifth of its volume in the view is called lesion. What is called lesion belongs to the nearest lesion that
its piece touches; a piece of 0.05 ml or more that touches none is a false blob. The boundary error is the mean distance
between the drawn and the true outline of a found lesion in the planes, both ways.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import KDTree

from benchmarks.image_reader_pictures import looked_up
from sim.episode.setup import Setup
from sim.episode.truth import Truth, make_truth
from sim.world.sensing.errors.echogenicity import echogenicity_of
from sim.world.sensing.image_reader.frames import N_COLUMNS, FrameGrid
from sim.world.sensing.image_reader.image_reader import ImageReader
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.ultrasound.imager import Imager
from sim.world.sensing.ultrasound.label_grid import LabelGrid, cut_grid
from sim.world.sensing.ultrasound.tissues import BY_LESION, TISSUES
from sim.world.sensing.ultrasound.ultrasound_sensor import TissueChoice, UltrasoundSensor

LEAST_M3, LEAST_SHARE = 0.1e-6, 0.25
"""A lesion is in a view that holds so much of it."""
FOUND_SHARE = 0.2
LEAST_BLOB_M3 = 0.05e-6


@dataclass(frozen=True, kw_only=True)
class LesionView:
    """A lesion in a view."""

    looks: str
    diameter_m: float
    is_found: bool
    dice: float
    boundary_m: float | None
    """None where it was not found."""


@dataclass(frozen=True, kw_only=True)
class View:
    """What the reader made of one sweep."""

    lesions: tuple[LesionView, ...]
    free_m3: float
    """Volume in the view that is free."""
    called_m3: float
    """Volume of it that is called lesion."""
    n_false: int
    """False blobs."""
    counts: NDArray[np.float64]
    """Cells, those of lesions, and the sum of their probabilities, by twenty classes of probability, shape (20, 3)."""


def views_of(setup: Setup, seed: int, tissue: str, n_views: int, reader: ImageReader) -> Iterator[View]:
    """Sweeps from random poses on an organ with the lesions of a seed.

    Args:
        setup: The organ.
        seed: Seed of the lesions and the poses.
        tissue: The lesions' tissue.
        n_views: Number of sweeps.
        reader: What reads them.
    """
    truth_rng, rng = np.random.default_rng(seed).spawn(2)
    truth = make_truth(setup, truth_rng)
    state = SceneState(truth.scene, truth.scene.new_data())
    sensor = UltrasoundSensor(tissues=TissueChoice(tumour=tissue))
    numbered = _numbered(truth)
    for pose in rng.integers(setup.workspace.n_poses, size=n_views):
        setup.positioner.place(state.data, int(pose), is_lifted=False)
        yield _view(truth, state, sensor, reader, numbered, rng)


def _numbered(truth: Truth) -> LabelGrid:
    """The tissue with a number for each lesion: label 1 is organ, lesion i has 2 + i."""
    lesions = [
        (solid, replace(TISSUES["hypoechoic"], name=f"lesion {n}"))
        for n, solid in enumerate(truth.anatomy.tumours)
    ]
    plain = replace(truth.anatomy, structures=(), target=None)
    return cut_grid(
        plain,
        surroundings=TISSUES["fat"],
        organ=TISSUES["liver"],
        lesions=lesions,
        target=TISSUES["hyperechoic"],
        structures=[],
    )


def _view(
    truth: Truth,
    state: SceneState,
    sensor: UltrasoundSensor,
    reader: ImageReader,
    numbered: LabelGrid,
    rng: np.random.Generator,
) -> View:
    array, T_world_planes = sensor.array_of(state.cone), sensor.plane_poses(state)
    reading = sensor.sense(state, rng)
    assert reading.images is not None
    seen = reader.read(reading.images, array)
    grid, is_called = seen.grid, seen.log_odds > 0.0
    rows, columns = np.arange(grid.n_rows, dtype=float), np.arange(N_COLUMNS, dtype=float)
    x_z_m = grid.points_m(*np.meshgrid(rows, columns, indexing="ij"))
    number = looked_up(x_z_m, T_world_planes, numbered, numbered.labels.astype(np.float32), order=0)
    number = number.astype(np.int64)
    is_counted = (number > 0) & _is_seen(sensor, state, grid)
    volume_m3 = np.broadcast_to(_cell_m3(sensor, state, grid)[:, None], number.shape)
    is_called = is_called & is_counted
    whose = _whose(number, is_called, T_world_planes, x_z_m)
    places_m = _places_m(T_world_planes, x_z_m)
    lesions = tuple(
        lesion
        for n, solid in enumerate(truth.anatomy.tumours)
        if (
            lesion := _lesion(
                number == n + 2, whose == n + 2, is_counted, volume_m3, places_m, solid, sensor.tissues.tumour
            )
        )
    )
    is_free = is_counted & (number == 1)
    return View(
        lesions=lesions,
        free_m3=float(volume_m3[is_free].sum()),
        called_m3=float(volume_m3[is_free & is_called].sum()),
        n_false=_n_false(is_called, whose, volume_m3),
        counts=_counts(seen.log_odds[is_counted], number[is_counted] > 1),
    )


def _is_seen(sensor: UltrasoundSensor, state: SceneState, grid: FrameGrid) -> NDArray[np.bool_]:
    """Which cells the sensor says it sees, shape (P, rows, columns)."""
    from sim.world.sensing.ultrasound.ultrasound_sensor import _grid, _imager

    array = sensor.array_of(state.cone)
    imager: Imager = _imager(array, sensor.settings)
    tissue = _grid(state.scene.anatomy, sensor.tissues, sensor.tissue_spacing_m)
    rows = ((np.arange(grid.n_rows) + 0.5) * array.n_samples / grid.n_rows).astype(int)
    columns = ((np.arange(N_COLUMNS) + 0.5) * array.n_lines / N_COLUMNS).astype(int)
    gains = imager.gains[rows][:, None]
    seen = []
    for T in sensor.plane_poses(state):
        left = imager.trace(tissue, T)[1][rows][:, columns]
        is_loud = left >= 10.0 ** (-sensor.seen_db / 20.0)
        seen.append(is_loud & (left * gains >= 10.0 ** (-sensor.shadow_db / 20.0)))
    return np.stack(seen)


def _cell_m3(sensor: UltrasoundSensor, state: SceneState, grid: FrameGrid) -> NDArray[np.float64]:
    """The volume for which a cell of each row stands, shape (rows,)."""
    depth_m = (np.arange(grid.n_rows) + 0.5) * grid.row_m
    plane_rad = 2.0 * state.cone.half_angle_rad / (sensor.n_planes - 1)
    return grid.row_m * (grid.array.radius_m + depth_m) * grid.column_rad * (depth_m + 0.01) * plane_rad


def _places_m(T_world_planes: NDArray[np.float64], x_z_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the cells lie in the world [m], shape (P, rows, columns, 3)."""
    along = np.einsum("pi,rc->prci", T_world_planes[:, :3, 0], x_z_m[..., 0])
    down = np.einsum("pi,rc->prci", T_world_planes[:, :3, 2], x_z_m[..., 1])
    return along + down + T_world_planes[:, None, None, :3, 3]


def _whose(
    number: NDArray[np.int64],
    is_called: NDArray[np.bool_],
    T_world_planes: NDArray[np.float64],
    x_z_m: NDArray[np.float64],
) -> NDArray[np.int64]:
    """The lesion to which each called cell belongs, 0 where its piece touches none, in the shape of `number`."""
    found: Any = label(is_called, structure=np.ones((3, 3, 3)))
    pieces = np.asarray(found[0])
    touching = np.unique(pieces[(number > 1) & is_called])
    nearest: Any = distance_transform_edt(
        number <= 1, sampling=(2.3, 1.0, 1.0), return_distances=False, return_indices=True
    )
    lesion = number[tuple(nearest)] if (number > 1).any() else np.zeros_like(number)
    return np.where(is_called & np.isin(pieces, touching), lesion, 0)


def _n_false(is_called: NDArray[np.bool_], whose: NDArray[np.int64], volume_m3: NDArray[np.float64]) -> int:
    found: Any = label(is_called & (whose == 0), structure=np.ones((3, 3, 3)))
    pieces = np.asarray(found[0])
    return int((np.bincount(pieces.ravel(), volume_m3.ravel())[1:] >= LEAST_BLOB_M3).sum())


def _lesion(
    is_lesion: NDArray[np.bool_],
    is_drawn: NDArray[np.bool_],
    is_counted: NDArray[np.bool_],
    volume_m3: NDArray[np.float64],
    places_m: NDArray[np.float64],
    solid: Any,
    tissue: str,
) -> LesionView | None:
    """A lesion as the view has it; None where it is not in the view."""
    is_lesion = is_lesion & is_counted
    own_m3 = float(volume_m3[is_lesion].sum())
    if own_m3 < min(LEAST_M3, LEAST_SHARE * solid.volume_m3) or not is_lesion.any():
        return None
    both_m3, drawn_m3 = float(volume_m3[is_lesion & is_drawn].sum()), float(volume_m3[is_drawn].sum())
    is_found = both_m3 >= FOUND_SHARE * own_m3
    return LesionView(
        looks=echogenicity_of(solid).name if tissue == BY_LESION else tissue,
        diameter_m=float(np.cbrt(6.0 * solid.volume_m3 / np.pi)),
        is_found=is_found,
        dice=2.0 * both_m3 / (own_m3 + drawn_m3),
        boundary_m=_gap_m(is_lesion, is_drawn, is_counted, places_m) if is_found else None,
    )


def _gap_m(
    one: NDArray[np.bool_],
    other: NDArray[np.bool_],
    is_counted: NDArray[np.bool_],
    places_m: NDArray[np.float64],
) -> float | None:
    """The mean distance between two outlines in the planes, both ways [m]."""
    edges_m = [_edge_m(each, is_counted, places_m) for each in (one, other)]
    if not all(len(each) for each in edges_m):
        return None
    ways = [KDTree(a).query(b)[0] for a, b in (edges_m, edges_m[::-1])]
    return float(np.concatenate(ways).mean())


def _edge_m(
    mask: NDArray[np.bool_], is_counted: NDArray[np.bool_], places_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Places between a cell of a mask and a neighbour in its plane that counts and is not of it [m], shape (N, 3)."""
    edges = []
    for axis in (1, 2):
        low, high = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
        is_edge = (mask[low] != mask[high]) & is_counted[low] & is_counted[high]
        edges.append(0.5 * (places_m[low][is_edge] + places_m[high][is_edge]))
    return np.concatenate(edges)


def _counts(log_odds: NDArray[np.float32], is_lesion: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Cells, those of lesions, and the sum of their probabilities, by classes of probability, shape (20, 3)."""
    chance = 1.0 / (1.0 + np.exp(-log_odds.astype(np.float64)))
    which = np.minimum((chance * 20).astype(int), 19)
    return np.stack(
        [np.bincount(which, weight, 20) for weight in (np.ones(len(chance)), is_lesion, chance)], 1
    )
