"""The check of a bound on every policy: places, poses that meet them, and weights, without a solver."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.world.solids.solid import Solid

from ..folder import read_arrays
from ..places import MOST_FEWEST, Place
from ..policy_files import POLICY, block_file, read_block
from ..policy_study import policy_bound, policy_summary
from ..poses import StandingPoses
from ..stage import Stage
from .plain_cones import gap_to_cones_m, held_points
from .proof import SLACK, DoesNotHoldError, proven_value, require

SAME_M = 1e-9
"""Places that differ by less are the same [m]."""


class BlockCheck:
    """Checks one block of places after another."""

    def __init__(self, path: Path, stage: Stage, need: int) -> None:
        """Remember the folder and what the places share.

        Args:
            path: The folder.
            stage: Plants one tumour a seed.
            need: Points of the tumour that have to be sensed at least.
        """
        self._path, self._stage, self._need = path, stage, need

    def __call__(self, seeds: range) -> str | None:
        """What does not hold of a block; None where all does."""
        seed = seeds.start
        try:
            places = read_block(block_file(self._path, seeds))
            require(len(places) == len(seeds), f"its block holds {len(places)} places of {len(seeds)}")
            for seed, place in zip(seeds, places, strict=True):
                truth, poses = self._stage.truth(seed), self._stage.poses(seed)
                (tumour,), cone = truth.anatomy.tumours, self._stage.setup(seed).cone
                require(place.seed == seed, f"its place is that of seed {place.seed}")
                check_place(place, tumour, truth.anatomy.detection_points_m, poses, cone, self._need)
        except DoesNotHoldError as error:
            return f"place {seed}: {error}"
        return None


def check_place(
    place: Place,
    tumour: Solid,
    points_m: NDArray[np.float64],
    poses: StandingPoses,
    cone: Cone,
    need: int,
) -> None:
    """Nothing, if what is said of a place holds.

    Args:
        place: What is said.
        tumour: The tumour that is there.
        points_m: Its points [m], shape (D, 3).
        poses: The poses that are reached.
        cone: What one of them sees.
        need: Points that have to be sensed at least.

    Raises:
        DoesNotHoldError: Something does not hold.
    """
    middle_m = tumour.vertices_m.mean(axis=0)
    radius_m = math.sqrt(float(((tumour.vertices_m - middle_m) ** 2).sum(axis=1).max()))
    is_there = (
        bool((abs(place.middle_m - middle_m) <= SAME_M).all()) and abs(place.radius_m - radius_m) <= SAME_M
    )
    require(is_there, "the tumour is not where it is said to be")
    is_row = len(place.poses) == len(place.fewest) and bool(
        ((place.poses >= 0) & (place.poses < poses.n_poses)).all() and (np.diff(place.poses) > 0).all()
    )
    require(is_row, "its poses are not rows of those that are reached")
    is_left_out = np.ones(poses.n_poses, dtype=bool)
    is_left_out[place.poses] = False
    meeting = _meeting(tumour, middle_m, radius_m, poses, cone) & is_left_out
    require(not meeting.any(), f"row {int(meeting.argmax())} of the poses meets it, and is left out")
    part = poses.part(place.poses.astype(np.intp))
    held = held_points(part.apex_m, part.axis, cone.half_angle_rad, cone.depth_m, points_m)
    most = _fewest_proven(held, need, place)
    is_more = place.fewest > most
    first = int(is_more.argmax()) if len(is_more) else 0
    require(
        not is_more.any(),
        f"from row {place.poses[first] if len(is_more) else 0} on {place.fewest[first] if len(is_more) else 0} poses "
        f"are said to be needed, and {most[first] if len(is_more) else 0} is what is proven",
    )
    require(len(place.fewest) == 0 or int(place.fewest.min()) >= 1, "a pose is said to need none")


def _meeting(
    tumour: Solid, middle_m: NDArray[np.float64], radius_m: float, poses: StandingPoses, cone: Cone
) -> NDArray[np.bool_]:
    """Which cones may meet a tumour, shape (N,): they come near its middle and, if it is no ball, near its surface."""
    shape = (cone.half_angle_rad, cone.depth_m)
    may = gap_to_cones_m(poses.apex_m, poses.axis, *shape, middle_m) <= radius_m
    least_m = float(np.linalg.norm(tumour.vertices_m - middle_m, axis=1).min())
    corners_m = tumour.vertices_m[tumour.faces]
    edges_m = [np.linalg.norm(corners_m[:, i] - corners_m[:, i - 1], axis=1).max() for i in range(3)]
    near_m = float(max(edges_m)) / math.sqrt(3.0)
    if radius_m - least_m <= near_m:
        return may
    rows = np.flatnonzero(may)
    nearest_m = np.full(len(rows), np.inf)
    for vertex_m in tumour.vertices_m:
        gap_m = gap_to_cones_m(poses.apex_m[rows], poses.axis[rows], *shape, vertex_m)
        nearest_m = np.minimum(nearest_m, gap_m)
    may[rows] = nearest_m <= near_m
    return may


def _fewest_proven(held: NDArray[np.bool_], need: int, place: Place) -> NDArray[np.int64]:
    """The fewest poses from each one on that can be proven, shape (h,)."""
    table = held.astype(np.float32)
    alone = held.sum(axis=1)
    shared = np.rint(table @ table.T).astype(np.int64)
    with_other = (alone[:, None] + alone[None, :] - shared).max(axis=1, initial=0)
    proven = np.where(alone >= need, 1, np.where(with_other >= need, 2, 3))
    if int(held.any(axis=0).sum()) < need:
        # No poses are enough, so no number is too large.
        return np.full(len(held), MOST_FEWEST)
    if not len(place.prices):
        return proven
    prices = place.prices.astype(np.float64)
    dearest = max(1.0, max(float(prices[cone].sum()) for cone in held))
    value = proven_value(held, need, prices / dearest, place.worth / dearest)
    own = np.array([float(prices[cone].sum()) / dearest for cone in held])
    return np.maximum(proven, 1 + np.ceil(value - own - SLACK).astype(np.int64))


def check_policy(
    path: Path,
    content: Mapping[str, Any],
    stage: Stage,
    seed: int,
    places: Sequence[Place],
    fewest: list[int | None],
) -> str:
    """What was verified of the weights and of the numbers that follow from them.

    Args:
        path: The folder.
        content: What bound.json says.
        stage: The scenario.
        seed: A seed.
        places: The places, which have been checked.
        fewest: The hindsight optimum of each seed, which has been checked.

    Raises:
        DoesNotHoldError: A line does not hold.
    """
    weights = read_arrays(path / POLICY).get("weights", np.empty((0, 0))).astype(np.float64)
    n_poses, n = stage.poses(seed).n_poses, len(places)
    is_weight = (
        weights.ndim == 2 and weights.shape[1] == n and bool(((weights >= 0.0) & (weights <= 1.0)).all())
    )
    require(is_weight, f"{POLICY}: its weights are not a number from 0 to 1 for each of {n} places")
    row = np.repeat(np.arange(n), [len(place.poses) for place in places])
    poses = np.concatenate([place.poses for place in places])
    needed = np.concatenate([place.fewest for place in places])

    def worth(index: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sum of values over the places that each pose is early enough for, shape (N,)."""
        is_within = needed <= index + 1
        sums = np.bincount(poses[is_within], weights=values[row[is_within]], minlength=n_poses)
        return sums.astype(np.float64)

    bound = policy_bound(places, list(weights), worth, stage.scenario(seed), fewest)
    proven = policy_summary(bound)
    for name, value in proven.items():
        _check_same(name, content["policy"].get(name), value)
    return (
        f"{n} places: any policy takes {proven['generator']['least_mean']:.3f} actions or more in the mean, and "
        f"{proven['independent']['least_mean']:.3f} in independent places"
    )


def _check_same(name: str, claimed: Any, proven: Any) -> None:
    """Nothing, if a number, or each of several, is the one that is proven.

    Raises:
        DoesNotHoldError: It is another.
    """
    if isinstance(proven, dict):
        for key, value in proven.items():
            _check_same(f"{name} {key}", claimed.get(key) if isinstance(claimed, dict) else None, value)
        return
    if isinstance(proven, list):
        is_list = isinstance(claimed, list) and len(claimed) == len(proven)
        require(is_list, f"bound.json: policy {name} has not the {len(proven)} numbers that are proven")
        for index, value in enumerate(proven):
            _check_same(f"{name} {index + 1}", claimed[index], value)
        return
    is_number = isinstance(proven, float) and isinstance(claimed, int | float)
    is_same = abs(claimed - proven) <= SLACK if is_number else claimed == proven
    require(is_same, f"bound.json: policy {name} is {claimed}, and {proven} is what is proven")
