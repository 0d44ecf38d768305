"""Small worlds for the planners' tests: a flat grid of poses over a box of search points for beliefs."""

import math

import numpy as np

from mapping import Prediction
from planner import Cone, Situation, Workspace


def flat_workspace(n_side=20, width_m=0.18):
    axis = np.linspace(-width_m / 2, width_m / 2, n_side)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(n_side**2)])
    return Workspace(positions, np.tile([0.0, 0.0, -1.0], (n_side**2, 1)), grid_shape=(n_side, n_side))


def box_points(n_side=13, width_m=0.16, depth_m=0.08):
    axis = np.linspace(-width_m / 2, width_m / 2, n_side)
    grid = np.meshgrid(axis, axis, np.linspace(-depth_m, -0.01, 6), indexing="ij")
    return np.column_stack([part.ravel() for part in grid])


def make_situation(*, workspace=None, points=None, mean=None, variance=None, sensed=(), skipped=(), seed=0):
    points = box_points() if points is None else points
    prediction = None
    if mean is not None:
        prediction = Prediction(mean, np.ones(len(points)) if variance is None else variance)

    def draw_map(rng):
        return rng.normal(prediction.latent_mean, prediction.latent_std)

    return Situation(
        workspace=flat_workspace() if workspace is None else workspace,
        cone=Cone(math.radians(11.5), 0.102),
        search_points_m=points,
        prediction=prediction,
        sensed=tuple(sensed),
        skipped=frozenset(skipped),
        draw_map=None if prediction is None else draw_map,
        rng=np.random.default_rng(seed),
    )
