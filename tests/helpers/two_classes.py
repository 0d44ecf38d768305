"""A ball with a tumour and two cysts in it, as meshes and as a label volume: a case of two classes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scanned_ball import CENTRE_MM, RADIUS_MM, TUMOUR_MM, TUMOUR_RADIUS_MM, ball_labels, grid, save_nifti

from sim.episode.episode import Episode
from sim.episode.setup import Setup, build_setup
from sim.running.config import EpisodeConfig
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode

CYSTS_MM = (
    (CENTRE_MM + np.array([-20.0, -10.0, -8.0]), 10.0),
    (CENTRE_MM + np.array([0.0, -12.0, 24.0]), 8.0),
)
"""Middle, LPS, and radius of each; the front, where the probe comes from, is at -y."""
CYST_LABEL = 3
N_ACTIONS = 4
"""Of an episode on it."""


def write_meshes(folder: Path) -> Path:
    """Write the case and its scenario, whose lattices are coarse; returns the scenario's file."""
    bodies = {"organ": (CENTRE_MM, RADIUS_MM), "tumour": (TUMOUR_MM, TUMOUR_RADIUS_MM)}
    bodies |= {f"cyst_{i + 1}": body for i, body in enumerate(CYSTS_MM)}
    for name, (centre_mm, radius_mm) in bodies.items():
        ball = trimesh.creation.icosphere(subdivisions=3, radius=radius_mm)
        ball.apply_translation(centre_mm)
        ball.export(folder / f"{name}.stl")
    scenario = folder / "two.toml"
    scenario.write_text(
        'organ = "organ.stl"\ntumour_files = ["tumour.stl"]\n'
        'target_files = ["cyst_1.stl", "cyst_2.stl"]\ntarget_name = "cysts"\n'
        "n_poses = 300\nscore_spacing_m = 0.005\ncone_depth_m = 0.11\ncone_half_angle_rad = 0.35\n"
    )
    return scenario


def write_labels(folder: Path) -> Path:
    """Write the case as a label volume: 1 organ, 2 tumour, 3 cysts."""
    T, shape = grid()
    labels = ball_labels(T, shape)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    for centre_mm, radius_mm in CYSTS_MM:
        labels[np.linalg.norm(points_mm - centre_mm, axis=-1) < radius_mm] = CYST_LABEL
    return save_nifti(folder / "case.nii.gz", labels, T)


def options(scenario: Path, **changes) -> EpisodeConfig:
    """Of a quick episode."""
    quick: dict = {"arm": "none", "motion": "none", "steps": N_ACTIONS, "seed": 2, "map_detail": "off"}
    return config_of(scenario=str(scenario), **(quick | changes))


def sensed(config: EpisodeConfig, setup: Setup) -> tuple[Episode, list]:
    """An episode after its steps, and these."""
    episode = make_episode(make_parts(config), setup)
    return episode, list(episode.steps(N_ACTIONS))


def setup_of(case: Path) -> Setup:
    """The case's setup, with a free probe."""
    parts = make_parts(options(case))
    return build_setup(parts.scenario, None, parts.map_settings)
