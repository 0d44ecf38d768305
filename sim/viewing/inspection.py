"""What a patient's files hold, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import LoadedAnatomy, load_anatomy, reading_of
from sim.world.errors import WorldError
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance
from sim.world.volumes.files import is_volume, load_volume
from sim.world.volumes.masks import box_of, count_pieces
from sim.world.volumes.volume import Volume

from .inspection_figure import draw_inspection

MOST_LABELS = 30
"""Most labels that are listed, the largest first."""
N_DRAWS = 2000
"""Points drawn in a tumour for its middle and the share of it in the organ."""
NO_TUMOURS = "tumours: none; `n_tumours` generates some"
LEAST_INSIDE = 0.5
"""A tumour with less of it in the organ is refused by an episode."""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """What was found in a patient's files."""

    text: str
    """Lines for a terminal."""
    is_usable: bool
    """Whether an episode would take the file as its organ."""


def inspect(files: CaseFiles, picture: Path) -> Inspection:
    """What a patient's files hold and what is wrong with them; they are drawn as well.

    Args:
        files: The files; that of the organ is looked at most closely.
        picture: The PNG to draw.

    Raises:
        WorldError: The organ's file cannot be read at all.
    """
    organ = Path(str(files.organ))
    volume = load_volume(organ, **reading_of(files)) if is_volume(organ) else None
    lines = [f"{organ}"] + ([] if volume is None else _volume_lines(volume))
    try:
        loaded = load_anatomy(files, volume=volume)
    except WorldError as error:
        if volume is None:
            raise
        lines += [f"- {notice}" for notice in volume.notices]
        lines += ["", "Not usable as it is:", f"- {error}"]
        return Inspection(text="\n".join(lines), is_usable=False)
    problems = _tumour_problems(loaded)
    lines += _anatomy_lines(loaded)
    lines += ["", "What is remarkable:" if loaded.notices else "Nothing is remarkable."]
    lines += [f"- {notice}" for notice in loaded.notices]
    lines += ["", "Not usable as it is:", *(f"- {each}" for each in problems)] if problems else []
    picture.parent.mkdir(parents=True, exist_ok=True)
    draw_inspection(picture, loaded, title=organ.name, source=str(organ.absolute()))
    lines += ["", f"drawn to {picture}"]
    return Inspection(text="\n".join(lines), is_usable=not problems)


def _volume_lines(volume: Volume) -> list[str]:
    """A line about the grid, and a line per label."""
    shape, spacing_mm = volume.scan_shape, volume.spacing_m * 1e3
    oblique = f", oblique by {np.rad2deg(volume.obliquity_rad):.1f} degrees" if volume.is_oblique else ""
    lines = [
        f"label volume of {_by(shape)} voxels, {_by(spacing_mm, '.4g')} mm each, {_by(spacing_mm * shape, '.0f')} mm "
        f"in all; axes {volume.orientation}{oblique}",
        "",
        f"{'label':>6} {'ml':>9} {'voxels':>10} {'pieces':>7} {'largest':>8}  extent [mm]",
    ]
    by_size = sorted(volume.counts, key=lambda label: -volume.counts[label])
    for label in by_size[:MOST_LABELS]:
        n_pieces, share, extent_mm = _pieces(volume, label)
        n = volume.counts[label]
        name = f"  {volume.label_names[label]}" if label in volume.label_names else ""
        lines.append(
            f"{label:>6} {n * volume.voxel_volume_m3 * 1e6:>9.2f} {n:>10,} {n_pieces:>7,} {share:>8.0%}  "
            f"{_by(extent_mm, '.0f')}{name}"
        )
    if len(by_size) > MOST_LABELS:
        lines.append(f"   and {len(by_size) - MOST_LABELS} more labels")
    return lines


def _pieces(volume: Volume, label: int) -> tuple[int, float, NDArray[np.float64]]:
    """The number of connected pieces of a label, the share of its voxels in the largest, and its extent [mm]."""
    mask = np.isin(volume.labels, volume.numbers_of((label,)))
    part = mask[box_of(mask)]
    pieces = np.empty(part.shape, dtype=np.int32)
    n = count_pieces(part, pieces)
    share = np.bincount(pieces.ravel())[1:].max() / volume.counts[label]
    return n, float(share), np.array(part.shape) * volume.spacing_m * 1e3


def _anatomy_lines(loaded: LoadedAnatomy) -> list[str]:
    """Lines about organ, tumours and structures as Sounding takes them."""
    organ = loaded.organ
    lines = [
        "",
        f"organ: {organ.volume_m3 * 1e6:.1f} ml, {_by(organ.extents_m * 1e3, '.0f')} mm (left-right, front-back, "
        f"foot-head), {len(organ.faces):,} triangles, about {_place(organ.bounds_m.mean(axis=0))}",
    ]
    lines += _body_lines("tumours", loaded.tumours, organ) if loaded.tumours else [NO_TUMOURS]
    lines += _body_lines("targets", loaded.targets, organ) if loaded.targets else []
    for each in loaded.structures:
        kind = "must not be pressed" if each.is_keepout else "structure"
        away_mm = float(each.distance_m(organ.vertices_m).min()) * 1e3
        lines.append(
            f"{each.name}: {kind}, {each.solid.volume_m3 * 1e6:.1f} ml, {away_mm:.1f} mm off the surface"
        )
    return lines


def _body_lines(noun: str, bodies: tuple[Solid, ...], organ: Solid) -> list[str]:
    """A line about all tumours, or all targets, and a line for each."""
    total_ml, surface = sum(body.volume_m3 for body in bodies) * 1e6, SurfaceDistance(organ)
    share = total_ml * 1e-6 / organ.volume_m3
    return [
        f"{noun}: {len(bodies)}, {total_ml:.1f} ml in all, {share:.2%} of the organ",
        f"{'':>6} {'ml':>9} {'diameter':>10} {'depth':>9}  middle",
        *(_tumour_line(i, body, surface) for i, body in enumerate(bodies, start=1)),
    ]


def _tumour_line(number: int, tumour: Solid, surface: SurfaceDistance) -> str:
    """A line of volume, diameter of the ball of equal volume, least depth below the surface, and middle."""
    volume_m3 = tumour.volume_m3
    diameter_mm = np.cbrt(6.0 * volume_m3 / np.pi) * 1e3
    depth_mm = -float(surface.signed_distance_m(tumour.vertices_m).max()) * 1e3
    middle_m = tumour.sample_inside(N_DRAWS, np.random.default_rng(0)).mean(axis=0)
    return (
        f"{number:>6} {volume_m3 * 1e6:>9.2f} {diameter_mm:>7.1f} mm {depth_mm:>6.1f} mm  {_place(middle_m)}"
    )


def _tumour_problems(loaded: LoadedAnatomy) -> list[str]:
    """A text for each tumour or target that lies mostly outside the organ."""
    problems = []
    names = (*loaded.tumour_names, *loaded.target_names)
    for tumour, name in zip((*loaded.tumours, *loaded.targets), names, strict=True):
        share = loaded.organ.contains(tumour.sample_inside(N_DRAWS, np.random.default_rng(0))).mean()
        if share < LEAST_INSIDE:
            away_mm = float(SurfaceDistance(loaded.organ).distance_m(tumour.vertices_m).min()) * 1e3
            where = f", and it lies {away_mm:.0f} mm away" if share == 0.0 and away_mm >= 0.5 else ""
            problems.append(
                f"{name}: {share:.0%} of it lies in the organ{where}; check that the files share one frame and unit"
            )
    return problems


def _place(point_m: NDArray[np.float64]) -> str:
    return "LPS " + " ".join(f"{each:.0f}" for each in point_m * 1e3) + " mm"


def _by(values: object, form: str = "d") -> str:
    return " x ".join(format(each, form) for each in np.asarray(values).tolist())
