"""`sphere` with fewer poses, for tests of motions that need no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.episode.positioner import ArmPositioner, FreePositioner
from sim.episode.setup import Setup


def nearest(setup: Setup, x_m: float, y_m: float) -> int:
    """The pose above a place, told from the organ's middle."""
    place_m = setup.organ.bounds_m.mean(axis=0)[:2] + np.array([x_m, y_m])
    return int(np.argmin(np.linalg.norm(setup.workspace.positions_m[:, :2] - place_m, axis=1)))


def sparse(setup: Setup, poses: np.ndarray | None = None) -> Setup:
    """A setup of fewer poses: by default of every third row and column of the grid of `sphere`, 4.5 mm apart."""
    if poses is None:
        poses = np.arange(setup.workspace.n_poses).reshape(120, 120)[::3, ::3].ravel()
    workspace = setup.workspace.part(poses)
    if isinstance(setup.positioner, ArmPositioner):
        distance = setup.positioner.search.clearance.organ_distance
        return replace(setup, workspace=workspace, positioner=ArmPositioner(setup.scene, workspace, distance))
    return replace(setup, workspace=workspace, positioner=FreePositioner(setup.scene, workspace))
