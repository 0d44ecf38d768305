"""The map as NIfTI volumes in the patient's own coordinates, to lie over the scan in 3D Slicer.

Values are those of the map's lattice, unchanged; the header's affine says where its points lie in the patient, however
the organ was laid before the arm. The volumes are

- `map_probability.nii.gz`: probability of tumour, 0 outside the organ;
- `map_standard_deviation.nii.gz`: standard deviation of the map's latent, 0 outside;
- `map_labels.nii.gz`: 0 outside, 1 organ, 2 where the probability is above a threshold, which is LiTS's coding, and 4
  where no pose's cone reaches, so that the map can tell of nothing there but what lies beside.

Where a second class was mapped, `map_target_probability.nii.gz` and so on hold its map, labelled 3.
"""

from __future__ import annotations

import gzip
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import UsageError

VISIBLE = "visible.npz"
"""Which points of the lattice some cone can see; folders of older runs have no such file."""
UNSEEABLE = 4
"""Label of what lies in no cone."""
THRESHOLD = 0.5
"""Probability above which a point is labelled tumour."""
RAS_MM_FROM_LPS_M = np.diag([-1e3, -1e3, 1e3, 1.0])
"""NIfTI's own coordinates are right, anterior, superior, in millimetres."""
EVEN = 1e-6
"""Share of a step by which the steps of a lattice may differ."""
COMPRESSION = 6


@dataclass(frozen=True, kw_only=True)
class Mapped:
    """A class of bodies that a map is of."""

    noun: str
    """What it is called."""
    file_stem: str
    """What its files' names begin with."""
    label: int
    """Its number in the volume of labels."""


TUMOUR = Mapped(noun="tumour", file_stem="map", label=2)


@dataclass(frozen=True, eq=False, kw_only=True)
class MapArrays:
    """A map on its lattice, as `map.npz` holds it."""

    axes_m: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    """Coordinates along x, y and z [m, world]."""
    probability: NDArray[np.float64]
    """Probability of what is mapped, shape (X, Y, Z), NaN outside the organ."""
    latent_variance: NDArray[np.float64]
    """Variance of the latent, shape (X, Y, Z), NaN outside."""
    is_inside: NDArray[np.bool_]
    """Which points lie in the organ, shape (X, Y, Z)."""
    of: Mapped = TUMOUR
    """What is mapped."""
    is_visible: NDArray[np.bool_] | None = None
    """Which points lie in the cone of some pose, shape (X, Y, Z); None where it is not known."""

    def labels(self, threshold: float) -> NDArray[np.uint8]:
        """The label of each point, shape (X, Y, Z)."""
        labels = np.where(self.is_inside, 1, 0).astype(np.uint8)
        if self.is_visible is not None:
            labels[self.is_inside & ~self.is_visible] = UNSEEABLE
        labels[self.is_inside & (self.probability > threshold)] = self.of.label
        return labels

    def label_text(self, threshold: float) -> str:
        """What the labels mean."""
        text = f"1 organ, {self.of.label} {self.of.noun}: probability > {threshold:g}"
        return text if self.is_visible is None else f"{text}, {UNSEEABLE} in no cone"


def maps_in(
    arrays: Mapping[str, NDArray[Any]],
    target_name: str | None,
    is_visible: NDArray[np.bool_] | None = None,
) -> list[MapArrays]:
    """The map of the tumours, and that of a second class where there is one.

    Args:
        arrays: As `map.npz` holds them.
        target_name: What the second class is called, None where there is none.
        is_visible: Which points lie in the cone of some pose, shape (X, Y, Z); None where it is not known.

    Raises:
        KeyError: An array is missing.
        ValueError: The arrays do not fit together.
    """
    kinds = {"": TUMOUR}
    if target_name is not None:
        kinds["target_"] = Mapped(noun=target_name, file_stem="map_target", label=3)
    axes_m = (arrays["x_m"], arrays["y_m"], arrays["z_m"])
    maps = [
        MapArrays(
            axes_m=axes_m,
            probability=arrays[f"{prefix}probability"],
            latent_variance=arrays[f"{prefix}latent_variance"],
            is_inside=arrays["is_inside"],
            of=kind,
            is_visible=is_visible,
        )
        for prefix, kind in kinds.items()
    ]
    shape = tuple(len(axis) for axis in axes_m)
    for each in maps:
        if {each.probability.shape, each.latent_variance.shape, each.is_inside.shape} != {shape}:
            raise ValueError("arrays of different shapes")
        if each.is_visible is not None and each.is_visible.shape != shape:
            raise ValueError(f"{VISIBLE} is of another lattice")
    return maps


def map_volumes(
    arrays: MapArrays, T_world_organ: ArrayLike, *, threshold: float = THRESHOLD
) -> dict[str, bytes]:
    """The files of a map by name, with their contents; the same map gives the same bytes.

    Args:
        arrays: The map.
        T_world_organ: Maps patient axes (LPS) [m] to the world, shape (4, 4).
        threshold: Probability above which a point gets the label of what is mapped.
    """
    inside, affine = arrays.is_inside, affine_ras_mm(arrays, T_world_organ)
    probability = np.where(inside, arrays.probability, 0.0)
    noun, stem = arrays.of.noun, arrays.of.file_stem
    deviation = np.sqrt(np.where(inside, arrays.latent_variance, 0.0))
    contents = {
        f"{stem}_probability.nii.gz": (probability.astype(np.float32), f"probability of {noun}"),
        f"{stem}_standard_deviation.nii.gz": (
            deviation.astype(np.float32),
            "standard deviation of the latent",
        ),
        f"{stem}_labels.nii.gz": (arrays.labels(threshold), arrays.label_text(threshold)),
    }
    return {name: _nifti(values, affine, text) for name, (values, text) in contents.items()}


def affine_ras_mm(arrays: MapArrays, T_world_organ: ArrayLike) -> NDArray[np.float64]:
    """The transform from the lattice's indices to NIfTI's coordinates, RAS [mm], shape (4, 4).

    Raises:
        ValueError: The lattice's steps are not even.
    """
    T_world_index = np.eye(4)
    for axis, ticks_m in enumerate(arrays.axes_m):
        steps_m = np.diff(ticks_m)
        if len(steps_m) and np.ptp(steps_m) > EVEN * steps_m.mean():
            raise ValueError(f"the lattice's steps along {'xyz'[axis]} are not even: {steps_m}")
        T_world_index[axis, axis] = steps_m.mean() if len(steps_m) else 1.0
        T_world_index[axis, 3] = ticks_m[0]
    return RAS_MM_FROM_LPS_M @ np.linalg.inv(np.asarray(T_world_organ, dtype=np.float64)) @ T_world_index


def read_maps(folder: Path) -> tuple[list[MapArrays], NDArray[np.float64]]:
    """The final maps of a run folder, the tumours' first, and the pose of the organ (patient axes to the world).

    Raises:
        UsageError: The folder holds no run with a map, or its files are broken.
    """
    if not (folder / "map.npz").is_file():
        raise UsageError(
            f"{folder}: holds no map.npz. Name the folder of a run of `sounding episode` with a map."
        )
    try:
        config: Mapping[str, Any] = json.loads((folder / "config.json").read_text(encoding="utf-8-sig"))
        T_world_organ = np.asarray(config["T_world_organ"], dtype=np.float64)
        with np.load(folder / "map.npz", allow_pickle=False) as file:
            name = str(config["scenario"]["target_name"]) if "target_probability" in file.files else None
            maps = maps_in(file, name, _visible(folder))
        if T_world_organ.shape != (4, 4):
            raise ValueError("a pose that is no 4 x 4 matrix")
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise UsageError(f"{folder}: its map cannot be read ({error}). Run the episode again.") from error
    return maps, T_world_organ


def _visible(folder: Path) -> NDArray[np.bool_] | None:
    """Which points some cone can see; None in folders of older runs, and of those that were killed."""
    if not (folder / VISIBLE).is_file():
        return None
    with np.load(folder / VISIBLE, allow_pickle=False) as file:
        return np.asarray(file["is_visible"], dtype=np.bool_)


def _nifti(values: NDArray[Any], affine: NDArray[np.float64], text: str) -> bytes:
    import nibabel

    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code=1)
    image.set_qform(affine, code=1)
    image.header["descrip"] = f"Sounding: {text}"[:79].encode("ascii", "replace")
    return gzip.compress(image.to_bytes(), COMPRESSION, mtime=0)
