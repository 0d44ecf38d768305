"""Spheres hidden in the paper's box, and cones that sense them: the truth of every study of the map.

It stands in for the simulator and needs only NumPy: the organ is the box under a flat surface, a pose is a point of the
surface and a slightly tilted axis, and a reading is points even in volume in the cone with their true labels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((-0.09, -0.09, -0.10125), (0.09, 0.09, 0.0))
HALF_ANGLE_RAD = np.deg2rad(11.5)
DEPTH_M = 0.102
RADIUS_M = 0.012


@dataclass(frozen=True, eq=False)
class Spheres:
    """A truth: balls of one radius."""

    centres_m: NDArray[np.float64]

    @classmethod
    def planted(cls, rng: np.random.Generator, n_spheres: int = 3) -> Spheres:
        """Spheres at the paper's depths of 1.2 to 2.8 units that do not touch."""
        while True:
            centres_m = rng.uniform((-0.066, -0.066, -0.084), (0.066, 0.066, -0.036), (n_spheres, 3))
            gaps_m = np.linalg.norm(centres_m[:, None] - centres_m, axis=2) + np.eye(n_spheres)
            if gaps_m.min() > 2 * RADIUS_M:
                return cls(centres_m)

    def contain(self, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return (np.linalg.norm(points_m[:, None] - self.centres_m, axis=2) < RADIUS_M).any(axis=1)


@dataclass(frozen=True, eq=False)
class Pose:
    apex_m: NDArray[np.float64]
    axis: NDArray[np.float64]


def candidate_poses(rng: np.random.Generator, n_poses: int) -> list[Pose]:
    """Poses spread evenly over the surface, tilted by about 9 degrees as on the paper's bumpy surface."""
    apexes_m = np.column_stack([rng.uniform(-0.09, 0.09, (n_poses, 2)), np.zeros(n_poses)])
    axes = np.column_stack([rng.normal(0, 0.15, (n_poses, 2)), -np.ones(n_poses)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return [Pose(apex_m, axis) for apex_m, axis in zip(apexes_m, axes, strict=True)]


def cone_points(
    pose: Pose, rng: np.random.Generator, n_points: int = 1000, box_m: ArrayLike = BOX_M
) -> NDArray[np.float64]:
    """Points even in volume within the cone and the box."""
    depth_m = DEPTH_M * rng.random(n_points) ** (1 / 3)
    radius_m = depth_m * np.tan(HALF_ANGLE_RAD) * np.sqrt(rng.random(n_points))
    angle_rad = rng.uniform(0, 2 * np.pi, n_points)
    first = np.cross(pose.axis, (1.0, 0.0, 0.0))
    first /= np.linalg.norm(first)
    second = np.cross(pose.axis, first)
    points_m = (
        pose.apex_m
        + depth_m[:, None] * pose.axis
        + (radius_m * np.cos(angle_rad))[:, None] * first
        + (radius_m * np.sin(angle_rad))[:, None] * second
    )
    low_m, high_m = np.asarray(box_m)
    return points_m[np.all((points_m >= low_m) & (points_m <= high_m), axis=1)]


def make_map(settings: MapSettings, query_counts: tuple[int, int, int] = (22, 22, 13)) -> HilbertMap:
    """The prior map of the box, queried on the paper's lattice of 6,292 points."""
    return HilbertMap(
        Lattice.from_box(*BOX_M, spacing_m=settings.hinge_spacing_m),
        settings,
        query=Lattice.from_counts(*BOX_M, counts=query_counts),
    )


def random_readings(
    seed: int, n_readings: int, n_points: int = 1000
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
    """The readings of a random planner on the truth of a seed, one after the other."""
    truth_rng, pose_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
    truth = Spheres.planted(truth_rng)
    for pose in candidate_poses(pose_rng, n_readings):
        points_m = cone_points(pose, sensor_rng, n_points)
        yield points_m, truth.contain(points_m)


def map_by_random(seed: int, n_readings: int, settings: MapSettings) -> HilbertMap:
    """The map after random readings."""
    belief = make_map(settings)
    for points_m, is_occupied in random_readings(seed, n_readings):
        belief.update(points_m, is_occupied)
    return belief


def truth_of(seed: int, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The truth of a seed at points."""
    return Spheres.planted(np.random.default_rng(seed).spawn(3)[0]).contain(points_m)
