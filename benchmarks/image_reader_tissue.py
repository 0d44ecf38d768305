"""The tissue that pictures for training are drawn of: lesions with looks of their own, and what is no lesion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.episode.truth import Truth
from sim.world.sensing.ultrasound.label_grid import LEAST_MARGIN, LabelGrid, cut_grid
from sim.world.sensing.ultrasound.tissues import TISSUES, Tissue

SPACING_M = 0.001
LOOKS = (("hypoechoic", 0.50, 2.5), ("hyperechoic", 0.25, 2.0), ("isoechoic", 0.15, 0.8), ("any", 0.10, 0.0))
"""Looks of lesions, with their shares and the deviation of the backscatter about that of the table [dB]."""


@dataclass(frozen=True, eq=False)
class PaintedTissue:
    """The tissue of one liver, and where in it lesions are."""

    grid: LabelGrid
    is_lesion: NDArray[np.float32]
    """How far each node lies inside lesions, above 0, or outside, below, in shares of a cell, shape (X, Y, Z)."""


def painted_tissue(truth: Truth, rng: np.random.Generator) -> PaintedTissue:
    anatomy = truth.anatomy
    lesions = [(solid, _look(rng, f"lesion {n}")) for n, solid in enumerate(anatomy.tumours)]
    organ = replace(
        TISSUES["liver"],
        attenuation_db_cm_mhz=rng.uniform(0.42, 0.62),
        backscatter_db=rng.normal(0.0, 1.5),
    )
    about = TISSUES[str(rng.choice(["fat", "fat", "fat", "muscle", "soft-tissue"]))]
    shift = organ.backscatter_db
    lesions = [(solid, replace(look, backscatter_db=look.backscatter_db + shift)) for solid, look in lesions]
    grid = cut_grid(
        anatomy,
        surroundings=about,
        organ=organ,
        lesions=lesions,
        target=TISSUES["hyperechoic"],
        structures=[],
        spacing_m=SPACING_M,
    )
    is_lesion = grid.labels >= 2
    field = np.where(is_lesion, grid.margins, -grid.margins).astype(np.float32)
    return PaintedTissue(_with_structures(grid, rng), field)


def _look(rng: np.random.Generator, name: str) -> Tissue:
    """How one lesion sounds."""
    look = LOOKS[int(rng.choice(len(LOOKS), p=[share for _, share, _ in LOOKS]))]
    if look[0] == "any":
        backscatter_db = rng.uniform(-14.0, 12.0)
    else:
        backscatter_db = TISSUES[look[0]].backscatter_db + rng.normal(0.0, look[2])
    attenuation = rng.uniform(0.5, 0.7) if look[0] == "isoechoic" else rng.uniform(0.5, 1.1)
    return Tissue(
        name=name,
        impedance_mrayl=rng.uniform(1.65, 1.69),
        attenuation_db_cm_mhz=attenuation,
        backscatter_db=backscatter_db,
    )


def _with_structures(grid: LabelGrid, rng: np.random.Generator) -> LabelGrid:
    """The grid with vessels, cysts and calcifications in what is organ."""
    organ_nodes = np.argwhere(grid.labels == 1)
    bodies: list[tuple[str, NDArray[np.float64]]] = []
    for _ in range(rng.integers(0, 4)):
        start = organ_nodes[rng.integers(len(organ_nodes))].astype(float)
        bodies.append(("blood", np.concatenate(_tree(start, rng.uniform(2.0, 10.0), rng))))
    for name, most, radii in (("fluid", 4, (2.0, 16.0)), ("calcification", 3, (1.0, 3.0))):
        for _ in range(rng.integers(0, most) * rng.integers(0, 2)):
            centre = organ_nodes[rng.integers(len(organ_nodes))]
            bodies.append((name, np.append(centre, rng.uniform(*radii))[None]))
    labels, margins, tissues = grid.labels.copy(), grid.margins.copy(), list(grid.tissues)
    for name, balls in bodies:
        if TISSUES[name] not in tissues:
            tissues.append(TISSUES[name])
        _paint(balls, tissues.index(TISSUES[name]), labels, margins)
    return LabelGrid.from_labels(tissues, labels, margins, origin_m=grid.origin_m, spacing_m=grid.spacing_m)


def _tree(start: NDArray[np.float64], radius: float, rng: np.random.Generator) -> list[NDArray[np.float64]]:
    """Balls along a vessel that wanders and branches: their centres and radii in nodes, shape (n, 4)."""
    direction = rng.standard_normal(3)
    at, balls, branches = start.copy(), [], []
    for _ in range(int(rng.integers(30, 120))):
        direction = direction / np.linalg.norm(direction) + 0.12 * rng.standard_normal(3)
        at = at + direction * max(0.5 * radius, 0.5) / np.linalg.norm(direction)
        radius *= 0.993
        balls.append([*at, radius])
        if rng.random() < 0.04 and radius > 1.5:
            branches += _tree(at, radius * rng.uniform(0.5, 0.8), rng)
        if radius < 0.8:
            break
    return [np.array(balls), *branches]


def _paint(
    balls: NDArray[np.float64],
    label: int,
    labels: NDArray[np.uint8],
    margins: NDArray[np.float32],
) -> None:
    """Lay balls over what is organ; lesions stay whole."""
    for *centre, radius in balls:
        low = np.maximum(np.floor(np.array(centre) - radius - 1.5), 0).astype(int)
        high = np.minimum(np.ceil(np.array(centre) + radius + 2.5), labels.shape).astype(int)
        if (low >= high).any():
            continue
        box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        offsets = np.ogrid[box]
        squares = sum((each - c) ** 2 for each, c in zip(offsets, centre, strict=True))
        inside = radius - np.sqrt(squares)
        own, own_margins = labels[box], margins[box]
        is_ours, is_organ = own == label, own == 1
        new = np.clip(np.abs(inside), LEAST_MARGIN, 0.5).astype(np.float32)
        deeper = is_ours & (inside > 0)
        own_margins[deeper] = np.maximum(own_margins, new)[deeper]
        nearer = is_organ & (inside <= 0)
        own_margins[nearer] = np.minimum(own_margins, new)[nearer]
        taken = is_organ & (inside > 0)
        own[taken] = label
        own_margins[taken] = new[taken]
