"""Phantoms for ultrasound: tissue laid out by formulas, and planes through it."""

import numpy as np

from sim.world.sensing.ultrasound.label_grid import LabelGrid
from sim.world.sensing.ultrasound.tissues import TISSUES, Tissue


def tissue(name="plain", *, impedance=1.65, attenuation=0.0, backscatter_db=0.0) -> Tissue:
    return Tissue(
        name=name,
        impedance_mrayl=impedance,
        attenuation_db_cm_mhz=attenuation,
        backscatter_db=backscatter_db,
    )


def uniform_phantom(of: Tissue) -> LabelGrid:
    """Tissue without end below z = 0 and beyond the face."""
    labels = np.ones((2, 2, 2), np.uint8)
    return LabelGrid.from_labels([TISSUES["gel"], of], labels, origin_m=np.full(3, -1.0), spacing_m=2.0)


def ball_phantom(of: Tissue, inside: Tissue, *, centre_m, radius_m: float, spacing_m=0.001) -> LabelGrid:
    """A ball in a block of 160 mm x 24 mm x 160 mm that begins 10 mm above the tip and is surrounded by itself."""
    low_m, high_m = np.array([-0.08, -0.02, -0.01]), np.array([0.08, 0.02, 0.15])
    shape = np.round((high_m - low_m) / spacing_m).astype(int) + 1
    axes = [low + spacing_m * np.arange(n) for low, n in zip(low_m, shape, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
    c = centre_m
    depth_m = radius_m - np.sqrt((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2)
    labels = np.where(depth_m > 0.0, 2, 1).astype(np.uint8)
    margins = np.clip(np.abs(depth_m) / spacing_m, 1e-3, 0.5).astype(np.float32)
    return LabelGrid.from_labels([of, of, inside], labels, margins, origin_m=low_m, spacing_m=spacing_m)
