"""Checks of what an episode is made of, and of what planners and maps answer, which may be a user's own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from mapping import Prediction, TumourMap, TumourMapFactory, read_only
from planner import Planner, Situation


def checked_prediction(tumour_map: TumourMap, n_points: int) -> Prediction:
    """What a map predicts on its lattice.

    Args:
        tumour_map: The map, which may be a user's own.
        n_points: How many points of the lattice lie in the organ.

    Raises:
        ValueError: It is no prediction, or one of another number of points.
    """
    prediction, name = tumour_map.predict_lattice(), type(tumour_map).__name__
    if not isinstance(prediction, Prediction):
        raise ValueError(
            f"{name}.predict_lattice returned a {type(prediction).__name__}; it must return a Prediction, for example "
            "by Prediction.from_probability."
        )
    if len(prediction.latent_mean) != n_points:
        raise ValueError(
            f"{name}.predict_lattice returned {len(prediction.latent_mean)} values; it must return one for each of the "
            f"{n_points} points of MapSpace.points_m."
        )
    return Prediction(read_only(prediction.latent_mean), read_only(prediction.latent_variance))


def checked_poses(planner: Planner, ranking: Iterable[int], n_poses: int) -> Iterator[int]:
    """The poses of a planner's ranking, each looked at as it comes.

    Args:
        planner: The planner, which may be a user's own.
        ranking: What its `rank` returned, or the ends of its paths.
        n_poses: How many poses there are.

    Raises:
        ValueError: It is no iterable, or what comes is no index of a pose.
    """
    name = _name_of(planner)
    if not isinstance(ranking, Iterable):
        raise ValueError(f"{name}.rank returned {ranking!r}; it must yield or return indices of poses.")
    for pose in ranking:
        _check_pose(pose, n_poses, name)
        yield pose


def checked_paths(
    planner: Planner, paths: Iterable[Iterable[int]], n_poses: int
) -> Iterator[tuple[int, ...]]:
    """The paths of a planner, each looked at as it comes.

    Args:
        planner: The planner, which may be a user's own.
        paths: What its `paths` returned.
        n_poses: How many poses there are.

    Raises:
        ValueError: It is no iterable, or what comes is no path.
    """
    name = _name_of(planner)
    if not isinstance(paths, Iterable):
        raise ValueError(f"{name}.paths returned {paths!r}; it must yield or return paths.")
    for path in paths:
        poses = tuple(path) if isinstance(path, Iterable) else ()
        if not poses:
            raise ValueError(
                f"{name} named the path {path!r}; a path is a tuple of at least one index of a pose."
            )
        for pose in poses:
            _check_pose(pose, n_poses, name)
        yield tuple(map(int, poses))


def _check_pose(pose: int, n_poses: int, name: str) -> None:
    is_whole = isinstance(pose, int | np.integer) and not isinstance(pose, bool)
    if not is_whole or not 0 <= pose < n_poses:
        raise ValueError(f"{name} named the pose {pose!r}; poses are whole numbers from 0 to {n_poses - 1}.")


def checked_confidence(planner: Planner, situation: Situation) -> float:
    """How sure a planner is that nothing is left.

    Raises:
        ValueError: It is no probability.
    """
    confidence = planner.confidence(situation)
    if not isinstance(confidence, int | float | np.number) or not 0.0 <= confidence <= 1.0:
        raise ValueError(
            f"{_name_of(planner)}.confidence returned {confidence!r}; it must be a number from 0 to 1."
        )
    return confidence


def _name_of(planner: Planner) -> str:
    """The class of a planner, or of the one that it stands for."""
    return type(getattr(planner, "stands_for", planner)).__name__


def check_parts(
    planner: Planner, seed: int, tumour_map: TumourMapFactory | None, *, casts_rays: bool
) -> None:
    """Check that the parts of an episode go together."""
    if seed < 0:
        raise ValueError(f"seed={seed}: must be 0 or more.")
    if planner.needs_belief and tumour_map is None:
        raise ValueError(f"{type(planner).__name__} needs a belief: tumour_map must not be None.")
    # A planner of one's own may derive from no class of ours.
    if getattr(planner, "needs_readings", False) and not casts_rays:
        raise ValueError(f"{type(planner).__name__} needs readings: casts_rays must be True.")
    if tumour_map is not None and not casts_rays:
        raise ValueError("A map needs readings: casts_rays must be True.")
