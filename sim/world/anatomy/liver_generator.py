"""Livers by seed: an implicit shape, its surface by marching cubes, simplified to fewer triangles.

    .venv/bin/python -m sim.world.anatomy.liver_generator --seed 3 --out liver.stl

The volume follows what was published for the LiTS training set, 1,586 +- 447 ml, and shapes differ
about as much as those of its livers.
"""

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

import fast_simplification
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label
from skimage import measure

from sim.world.errors import GeneratorError
from sim.world.meshes.decimation import HASTE
from sim.world.solids.solid import Solid

from .implicit import Field
from .liver_shape import LiverShape, liver_field

VOLUME_MEAN_M3 = 1.586e-3
"""Mean liver volume of the LiTS training set [m^3]."""

VOLUME_SPREAD_M3 = 0.447e-3
"""Its standard deviation [m^3]."""

VOLUME_RANGE_M3 = (0.75e-3, 3.2e-3)
"""Range of the volumes drawn [m^3]: adult livers that are not grossly enlarged, 99 % of the published spread."""

BOX_MM = np.array([[-145.0, 165.0], [-125.0, 130.0], [-160.0, 135.0]])
"""The lattice's extent in x, y and z [mm]: shapes near the template with their warp, and a margin."""

NEAR_TEMPLATE = 2.5
"""Shapes that deviate further in anything take a wider lattice."""

WIDER_MM = 20.0
"""The lattice is then longer by this at each of its ends [mm]."""

SPACING_MM = 2.2
"""Lattice spacing [mm]: fine enough for the fissures."""

SMOOTHING = 0.9
"""Standard deviation of the blur of the field in lattice steps: it keeps sharp margins from becoming saws."""

N_TRIANGLES = 8000
"""Triangles kept by default: the surface then moves by about 0.1 mm."""

N_SPARE_TRIANGLES = 8
"""The simplification aims at so many triangles below the limit, as it may end a few above its aim."""

MAX_ATTEMPTS = 10
"""Shapes drawn before giving up; about one in ten is pierced where it is thinnest."""


def make_liver(
    rng: np.random.Generator,
    *,
    volume_m3: float | None = None,
    shape: LiverShape | None = None,
    n_triangles: int = N_TRIANGLES,
) -> Solid:
    """A liver, closed and without holes, in patient axes (LPS) about the middle of its bounding box.

    Args:
        rng: Source of all that is drawn.
        volume_m3: Its volume [m^3]; drawn as in LiTS by default.
        shape: Its deviations from the template; drawn by default.
        n_triangles: Most triangles of its surface, at least 1,000.

    Returns:
        The liver.

    Raises:
        GeneratorError: No sound shape was found.
        ValueError: An argument out of range.
    """
    if n_triangles < 1000:
        raise ValueError(f"n_triangles={n_triangles} must be at least 1000")
    if volume_m3 is None:
        volume_m3 = draw_volume_m3(rng)
    if not VOLUME_RANGE_M3[0] <= volume_m3 <= VOLUME_RANGE_M3[1]:
        raise ValueError(f"volume_m3={volume_m3} must be within {VOLUME_RANGE_M3[0]}..{VOLUME_RANGE_M3[1]}")
    for _ in range(MAX_ATTEMPTS):
        drawn = shape or LiverShape.draw(rng)
        field = _sample_field(drawn, rng)
        mesh = _simplify(_surface(field, box_mm(drawn)[:, 0]), n_triangles)
        if mesh is not None:
            mesh.apply_translation(-mesh.bounds.mean(axis=0))
            mesh.apply_scale(np.cbrt(volume_m3 / mesh.volume))
            return Solid.from_trimesh(mesh)
    raise GeneratorError(f"no sound liver in {MAX_ATTEMPTS} attempts; use another seed or a milder shape")


def box_mm(shape: LiverShape) -> NDArray[np.float64]:
    """Extent of the lattice that holds a shape [mm], shape (3, 2)."""
    deviations = np.array([getattr(shape, each.name) for each in fields(shape)])
    is_near = np.abs(deviations).max() <= NEAR_TEMPLATE
    return BOX_MM if is_near else BOX_MM + np.array([-WIDER_MM, WIDER_MM])


def draw_volume_m3(rng: np.random.Generator) -> float:
    """A volume [m^3] of the published mean and spread: lognormal, as large livers are farther out than small ones."""
    variance = np.log1p((VOLUME_SPREAD_M3 / VOLUME_MEAN_M3) ** 2)
    drawn_m3 = VOLUME_MEAN_M3 * np.exp(np.sqrt(variance) * rng.standard_normal() - 0.5 * variance)
    return float(np.clip(drawn_m3, *VOLUME_RANGE_M3))


def _sample_field(shape: LiverShape, rng: np.random.Generator) -> Field:
    """The blurred field on the lattice, with everything but the largest piece filled in as outside."""
    axes = [np.arange(low, high, SPACING_MM, dtype=np.float32) for low, high in box_mm(shape)]
    x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
    field = gaussian_filter(liver_field(shape, (x, y, z), rng), SMOOTHING)
    pieces = np.zeros(field.shape, dtype=np.int32)
    label(field < 0.0, output=pieces)
    if pieces.max() > 1:
        largest = np.bincount(pieces.ravel())[1:].argmax() + 1
        field[(pieces > 0) & (pieces != largest)] = SPACING_MM
    return field


def _surface(field: Field, low_mm: NDArray[np.float64]) -> trimesh.Trimesh:
    """The zero level of the field [mm], outward; its lattice begins at `low_mm`."""
    vertices, faces, _, _ = measure.marching_cubes(field, 0.0, spacing=(SPACING_MM,) * 3)
    mesh = trimesh.Trimesh(vertices + low_mm, faces, process=True)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def _simplify(mesh: trimesh.Trimesh, n_triangles: int) -> trimesh.Trimesh | None:
    """The surface with few enough triangles, or None if it is not sound.

    Edges are collapsed where that moves the surface least (quadrics), more slowly if haste tore it.
    """
    if not _is_sound(mesh):
        return None
    if len(mesh.faces) <= n_triangles:
        return mesh
    # Releases of the package differ in whether they declare the types of this function.
    simplify: Any = fast_simplification.simplify
    for haste in HASTE:
        vertices, faces = simplify(
            np.asarray(mesh.vertices, dtype=np.float32),
            np.asarray(mesh.faces, dtype=np.int32),
            target_count=n_triangles - N_SPARE_TRIANGLES,
            agg=haste,
        )
        simple = trimesh.Trimesh(np.asarray(vertices, dtype=np.float64), faces, process=True)
        if _is_sound(simple) and len(simple.faces) <= n_triangles:
            return simple
    return None


def _is_sound(mesh: trimesh.Trimesh) -> bool:
    """True for one closed body without tunnels."""
    return bool(
        mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2 and mesh.volume > 0
    )


def main(arguments: list[str] | None = None) -> None:
    """Writes a liver in LPS millimetres to a file.

    Args:
        arguments: Command line; that of the process by default.
    """
    parser = argparse.ArgumentParser(description="Write a generated liver in LPS millimetres.")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same liver")
    parser.add_argument("--volume-ml", type=float, help="volume in millilitres; drawn by default")
    parser.add_argument("--triangles", type=int, default=N_TRIANGLES, help="most triangles")
    parser.add_argument(
        "--template", action="store_true", help="the template's proportions, not a drawn patient's"
    )
    parser.add_argument("--out", type=Path, required=True, help="STL, OBJ or PLY file to write")
    options = parser.parse_args(arguments)
    volume_m3 = None if options.volume_ml is None else options.volume_ml * 1e-6
    shape = LiverShape() if options.template else None
    rng = np.random.default_rng(options.seed)
    try:
        liver = make_liver(rng, volume_m3=volume_m3, shape=shape, n_triangles=options.triangles)
    except ValueError as error:
        parser.error(str(error))
    mesh = liver.to_trimesh()
    mesh.apply_scale(1e3)
    mesh.export(options.out)
    extents = " x ".join(f"{extent:.0f}" for extent in mesh.extents)
    print(f"{options.out}: {mesh.volume / 1e3:.0f} ml, {extents} mm, {len(mesh.faces)} triangles")


if __name__ == "__main__":
    main()
