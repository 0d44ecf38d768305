"""A map that knows its answer beforehand, so that a whole campaign has a known outcome."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.special import expit

from mapping import Prediction

ORGAN_RADIUS_M, SPACING_M = 0.05, 0.003
SLOPE_PER_M = 400.0
LARGE, SMALL = ((0.515, 0.0, 0.05), 0.008), ((0.48, 0.0, 0.05), 0.004)
"""The true tumours, of 16 and of 8 mm: centre [m, world] and radius [m]."""
MAPPED = (2, (0.517, 0.0, 0.05), 0.008)
"""What the map calls tumour from its second reading on: the large tumour, 2 mm off."""
MADE_UP = (3, (0.5, 0.03, 0.05), 0.007)
"""What it makes up from its third reading on."""


class PlantedMap:
    """Calls balls tumour, each from one of its readings on."""

    def __init__(self, space) -> None:
        """Take the points to answer for."""
        self._points_m, self._n = space.points_m, 0

    def update(self, points_m, is_occupied) -> None:
        """Count a reading."""
        self._n += 1

    def predict_lattice(self) -> Prediction:
        """The balls whose reading has come."""
        log_odds = np.full(len(self._points_m), -6.0)
        for reading, centre_m, radius_m in (MAPPED, MADE_UP):
            if self._n >= reading:
                depth_m = radius_m - np.linalg.norm(self._points_m - centre_m, axis=1)
                log_odds = np.maximum(log_odds, np.clip(SLOPE_PER_M * depth_m, -6.0, 6.0))
        return Prediction.from_probability(expit(log_odds))

    def save(self, path) -> None:
        """Nothing is to be saved."""


def write_case(folder: Path) -> Path:
    """The scenario of the organ with the two tumours, in a folder of its own."""
    balls = {"organ": ((0.5, 0.0, 0.05), ORGAN_RADIUS_M), "large": LARGE, "small": SMALL}
    for name, ((x, y, z), radius_m) in balls.items():
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius_m)
        # World x is the patient's left, world y head, world z anterior; the file's axes are left, posterior, head.
        mesh.apply_translation((x - 0.5, -(z - 0.05), y))
        mesh.export(folder / f"{name}.stl")
    (folder / "case.toml").write_text(
        'organ = "organ.stl"\norgan_unit = "m"\ntumour_files = ["large.stl", "small.stl"]\n'
        f"n_poses = 60\nscore_spacing_m = {SPACING_M}\n"
    )
    return folder / "case.toml"
