"""A run whose map is planted: balls of known place and size, so that every finding has an exact answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.special import expit

from sim.record.map_field import MapField
from sim.record.run_record import RunRecord
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.solids.solid import Solid

SLOPE_PER_M = 400.0
"""Log-odds per metre towards a ball's centre, about those of a map with a kernel of 11 mm."""
SPACING_M = 0.003
ORGAN_RADIUS_M = 0.08
CONE = {"cone_half_angle_rad": 0.3, "cone_depth_m": 0.2}
Balls = list[tuple[tuple[float, float, float], float]]


def ball(centre_m: tuple[float, float, float], radius_m: float) -> Solid:
    """A ball of 1,280 triangles or more, its volume that of the true one."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_m)
    mesh.apply_scale((4 / 3 * np.pi * radius_m**3 / mesh.volume) ** (1 / 3))
    mesh.apply_translation(centre_m)
    return Solid.from_trimesh(mesh)


def field_of(mapped: Balls) -> MapField:
    """A map that calls exactly the points of some balls tumour."""
    organ = ball((0.0, 0.0, 0.0), ORGAN_RADIUS_M)
    axis = np.arange(-ORGAN_RADIUS_M, ORGAN_RADIUS_M + 1e-9, SPACING_M)
    points_m = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    depths_m = [radius_m - np.linalg.norm(points_m - centre_m, axis=1) for centre_m, radius_m in mapped]
    log_odds = np.clip(SLOPE_PER_M * np.max([*depths_m, np.full(len(points_m), -0.02)], axis=0), -6, 6)
    shape = (len(axis),) * 3
    is_inside = organ.contains(points_m).reshape(shape)
    probability = np.where(is_inside, expit(log_odds).reshape(shape), np.nan)
    return MapField.from_probability((axis, axis, axis), probability, is_inside, np.zeros(shape, dtype=bool))


def planted_run(
    folder: Path,
    *,
    true: Balls,
    mapped: Balls | None,
    T_world_probe: NDArray[np.float64] | None = None,
    prior: float = 0.02,
) -> RunRecord:
    """A record of a run with true balls, a map of mapped ones, and the probe where it is said."""
    solids = tuple(ball(centre_m, radius_m) for centre_m, radius_m in true)
    organ = ball((0.0, 0.0, 0.0), ORGAN_RADIUS_M)
    anatomy = build_anatomy(organ, solids, name="planted", rng=np.random.default_rng(0))
    field = None if mapped is None else field_of(mapped)
    poses = np.empty((0, 4, 4)) if T_world_probe is None else T_world_probe
    history = {}
    if field is not None:
        history = {len(poses): field.log_odds[field.is_inside].astype(np.float32)}
    T_world_organ = np.array([[0.0, -1, 0, 0.5], [1, 0, 0, 0.1], [0, 0, 1, 0.2], [0, 0, 0, 1]])
    return RunRecord(
        folder=folder,
        config={
            "options": {},
            "scenario": CONE,
            "map": {"prior_prevalence": prior},
            "T_world_organ": T_world_organ.tolist(),
        },
        manifest={},
        summary={},
        steps=[{"step": str(i + 1)} for i in range(len(poses))],
        skipped=[],
        T_world_probe=poses,
        anatomy=anatomy,
        detection_points_m=anatomy.detection_points_m,
        detection_tumours=anatomy.detection_tumours,
        field=field,
        history=history,
    )
