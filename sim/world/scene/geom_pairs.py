"""Pairs of geoms that must not touch, and the true distance of the closest of them.

MuJoCo's contacts say whether a pair touches, but not always how far it is apart: with a margin, boxes are told up to
17 mm too near or too far and one pair in ten not at all, and a capsule beside a cylinder or a mesh up to 35 mm too
far. `mj_geomDistance` is within a micrometre of coal on all shapes.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

SAME_M, N_CONFIGURATIONS = 1e-6, 32
"""Distances that differ by less than this in so many configurations [m] are one that no joint changes."""
ENDLESS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
"""Shapes without a sphere around them."""


class GeomPairs:
    """The pairs of geoms of a model between which MuJoCo looks for contacts."""

    def __init__(self, model: mujoco.MjModel, without: frozenset[tuple[int, int]] = frozenset()) -> None:
        """Find the pairs, by MuJoCo's own rules; those of `without` count only where they overlap."""
        self._pairs = _colliding_pairs(model)
        self._is_standing = np.array([tuple(pair) in without for pair in self._pairs.tolist()], dtype=bool)
        reach_m = model.geom_rbound.copy()
        reach_m[np.isin(model.geom_type, ENDLESS)] = np.inf
        self._reach_m = reach_m[self._pairs].sum(axis=1)

    def least_distance(
        self, model: mujoco.MjModel, data: mujoco.MjData, most_m: float
    ) -> tuple[float, tuple[int, int]]:
        """The least distance of all pairs [m] and its two geoms; infinite, and -1 twice, from `most_m` on.

        Args:
            model: The model, or a copy of it in which the arm stands elsewhere.
            data: A state whose kinematics are up to date.
            most_m: How far is looked [m].
        """
        first, second = data.geom_xpos[self._pairs[:, 0]], data.geom_xpos[self._pairs[:, 1]]
        at_least_m = np.linalg.norm(first - second, axis=1) - self._reach_m
        least_m, closest = np.inf, (-1, -1)
        for row in np.argsort(at_least_m, kind="stable"):
            bound_m = min(least_m, most_m)
            if at_least_m[row] >= bound_m:
                break
            geoms = int(self._pairs[row, 0]), int(self._pairs[row, 1])
            distance_m = float(mujoco.mj_geomDistance(model, data, *geoms, bound_m, None))
            if distance_m < bound_m and not (self._is_standing[row] and distance_m >= 0.0):
                least_m, closest = distance_m, geoms
        return least_m, closest


def standing_pairs(model: mujoco.MjModel) -> frozenset[tuple[int, int]]:
    """Pairs whose distance no joint changes, such as the table and a round first link that turns above it.

    How near they are says nothing about a configuration, so they count only where they overlap.
    """
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    weld = model.body_weldid[model.geom_bodyid]
    is_still = weld == 0
    is_first = ~is_still & (model.body_weldid[model.body_parentid[weld]] == 0)
    pairs = [
        (first, second)
        for first, second in _colliding_pairs(model).tolist()
        if (is_still[first] and is_first[second]) or (is_still[second] and is_first[first])
    ]
    distances_m = np.empty((N_CONFIGURATIONS, len(pairs)))
    for row in range(N_CONFIGURATIONS):
        data.qpos[:] = rng.uniform(-1.0, 1.0, model.nq)
        mujoco.mj_kinematics(model, data)
        distances_m[row] = [mujoco.mj_geomDistance(model, data, *pair, 1.0, None) for pair in pairs]
    is_same = np.ptp(distances_m, axis=0) < SAME_M
    return frozenset(pair for pair, same in zip(pairs, is_same.tolist(), strict=True) if same)


def _colliding_pairs(model: mujoco.MjModel) -> NDArray[np.int64]:
    """The pairs that MuJoCo checks, shape (P, 2): those that are named, and those that it does not leave out."""
    found = {
        tuple(sorted(pair)) for pair in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    }
    excluded = set(model.exclude_signature.tolist())
    for first in range(model.ngeom):
        for second in range(first + 1, model.ngeom):
            if _meets(model, first, second) and not _is_left_out(model, first, second, excluded):
                found.add((first, second))
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 2)


def _meets(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether the masks of two geoms let them touch."""
    return bool(
        (model.geom_contype[first] & model.geom_conaffinity[second])
        or (model.geom_contype[second] & model.geom_conaffinity[first])
    )


def _is_left_out(model: mujoco.MjModel, first: int, second: int, excluded: set[int]) -> bool:
    """Whether two geoms are of one body, of two that a joint links, or of two that are excluded by name."""
    bodies = sorted((int(model.geom_bodyid[first]), int(model.geom_bodyid[second])))
    if (bodies[0] << 16) + bodies[1] in excluded:
        return True
    welds = [int(model.body_weldid[body]) for body in bodies]
    if welds[0] == welds[1]:
        return True
    parents = [int(model.body_weldid[model.body_parentid[weld]]) for weld in welds]
    keeps_parents = bool(model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT))
    return not keeps_parents and 0 not in welds and (welds[0] == parents[1] or welds[1] == parents[0])
