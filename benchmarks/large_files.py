"""Large patient files: how long they take to load and how much memory, each in a process of its own.

    .venv/bin/python -m benchmarks.large_files --out /tmp/large

It makes label volumes of 512 x 512 x 900 voxels (0.7 x 0.7 x 0.8 mm: thorax to pelvis) as gzipped NIfTI of two types,
with a liver of two lobes and four tumours, and a mesh of 2 million triangles. Then it prints processor seconds and the
largest resident memory of `sounding inspect`, and of an episode of three actions with the arm.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import nibabel
import numpy as np
import trimesh
import tyro
from numpy.typing import NDArray

SHAPE = (512, 512, 900)
SPACING_MM = (0.7, 0.7, 0.8)
N_TRIANGLES = 2_000_000
VOLUMES = {"uint8.nii.gz": np.uint8, "int16.nii.gz": np.int16}
MESH = "mesh.stl"
LOBES_MM = (((-50.0, 0.0, 0.0), (90.0, 72.0, 78.0)), ((45.0, 25.0, 25.0), (75.0, 48.0, 42.0)))
"""Middle and half axes of the lobes, RAS about the middle of the scan."""
TUMOURS_MM = (((-80.0, 10.0, 10.0), 18.0), ((-30.0, -20.0, 25.0), 9.0), ((60.0, 30.0, 30.0), 12.0),
              ((-60.0, 30.0, -25.0), 6.0))  # fmt: skip
"""Middle and radius of the tumours, RAS about the middle of the scan."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make large files and measure what it takes to load them."""

    out: Path
    """Folder in which the files are made, which take some 100 MB and are kept."""
    shape: tuple[int, int, int] = SHAPE
    spacing_mm: tuple[float, float, float] = SPACING_MM
    triangles: int = N_TRIANGLES
    """Least number of triangles of the mesh."""
    steps: int = 3
    """Number of actions of the episode."""


def write_volume(path: Path, options: Options, dtype: type[np.integer]) -> None:
    """Write a label volume, 1 the organ and 2 its tumours (as LiTS has them), a slice at a time."""
    labels = np.zeros(options.shape, dtype=dtype, order="F")
    for k in range(options.shape[2]):
        labels[:, :, k] = _slice(options, k)
    middle_mm = [-0.5 * (n - 1) * step for n, step in zip(options.shape, options.spacing_mm, strict=True)]
    T = np.diag([*options.spacing_mm, 1.0])
    T[:3, 3] = middle_mm
    nibabel.openers.Opener.default_compresslevel = 1
    image = nibabel.Nifti1Image(labels, T, dtype=dtype)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)


def _slice(options: Options, k: int) -> NDArray[np.uint8]:
    """The labels of the voxels of one height, shape (I, J)."""
    x_mm, y_mm, z_mm = (
        (np.arange(n) - 0.5 * (n - 1)) * step
        for n, step in zip(options.shape, options.spacing_mm, strict=True)
    )
    x_mm, y_mm = x_mm[:, None], y_mm[None, :]
    found = np.zeros(options.shape[:2], dtype=np.uint8)
    for (a, b, c), (ra, rb, rc) in LOBES_MM:
        found[((x_mm - a) / ra) ** 2 + ((y_mm - b) / rb) ** 2 + ((z_mm[k] - c) / rc) ** 2 < 1.0] = 1
    for (a, b, c), radius in TUMOURS_MM:
        found[(x_mm - a) ** 2 + (y_mm - b) ** 2 + (z_mm[k] - c) ** 2 < radius**2] = 2
    return found


def write_mesh(path: Path, n_triangles: int) -> None:
    """Write a finely divided body with lobes and folds, in millimetres."""
    n = int(np.ceil(np.sqrt(n_triangles / 4.0))) + 1
    mesh = trimesh.creation.uv_sphere(radius=1.0, count=[n, n])
    unit = np.asarray(mesh.vertices)
    folds = (
        1.0 + 0.06 * np.sin(5.0 * unit[:, 0]) * np.cos(4.0 * unit[:, 1]) + 0.02 * np.sin(40.0 * unit[:, 2])
    )
    mesh.vertices = unit * folds[:, None] * [105.0, 75.0, 70.0]
    mesh.export(path)


def measured(arguments: list[str]) -> tuple[float, float, int]:
    """The seconds of processor time, the largest resident memory [MiB] and the exit code of a `sounding` command."""
    process = os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "sim.cli", *arguments],
        dict(os.environ),
        file_actions=[(os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_WRONLY, 0) for stream in (1, 2)],
    )
    _, status, usage = os.wait4(process, 0)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, os.waitstatus_to_exitcode(status)


def make_files(options: Options) -> None:
    """Make the files that are not there yet."""
    options.out.mkdir(parents=True, exist_ok=True)
    for name, dtype in VOLUMES.items():
        if not (options.out / name).exists():
            write_volume(options.out / name, options, dtype)
    if not (options.out / MESH).exists():
        write_mesh(options.out / MESH, options.triangles)


def main() -> None:
    """Make the files, and print a line per file and command."""
    options = tyro.cli(Options, description=__doc__)
    # The files are made in a process of its own, since memory that a parent once took counts for its children.
    making = multiprocessing.get_context("spawn").Process(target=make_files, args=(options,))
    making.start()
    making.join()
    files = [options.out / name for name in (*VOLUMES, MESH)]
    print(
        "| file | MB | inspect [s] | memory [MiB] | episode [s] | memory [MiB] |\n|---|---|---|---|---|---|"
    )
    for path in files:
        figures = []
        run = ["--steps", str(options.steps), "--no-report", "--overwrite", "--out", str(options.out / "run")]
        for command in (
            ["inspect", str(path), "--out", str(options.out / f"{path.name}.png")],
            ["episode", "--organ", str(path), *run],
        ):
            seconds, mebibytes, code = measured(command)
            figures.append(f"{seconds:.0f} | {mebibytes:.0f}" + (f" (exit code {code})" if code else ""))
        print(f"| {path.name} | {path.stat().st_size / 1e6:.0f} | {' | '.join(figures)} |", flush=True)


if __name__ == "__main__":
    main()
