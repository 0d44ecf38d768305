"""Checks of what an episode is made of, and of what planners and maps answer, which may be a user's own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mapping import Prediction, TumourMap, TumourMapFactory, read_only
from planner import Planner, Situation
from sim.world.sensing.reading import Reading

if TYPE_CHECKING:
    from sim.world.sensing.sensor import SceneState, Sensor

MOST_BEYOND_M = 0.05
"""Readings lie in the organ. Points farther than this outside its bounding box are in another frame or unit [m]; nearer
ones may be noise of a sensor that measures places."""
MAP_METHODS = ("update", "predict_lattice", "save")
"""What an episode calls of a map; see `TumourMap`."""


def map_fault(made: object) -> str | None:
    """What keeps something from being a map, to follow "returned"; None where nothing does.

    Args:
        made: What a map's class or a function that makes maps returned.
    """
    if made is None:
        return "None"
    missing = [name for name in MAP_METHODS if not callable(getattr(made, name, None))]
    return f"a {type(made).__name__} without {' and '.join(missing)}" if missing else None


def checked_map(made: TumourMap) -> TumourMap:
    """What a user's own code made as a map.

    Raises:
        ValueError: It is none.
    """
    if (fault := map_fault(made)) is not None:
        raise ValueError(
            f"`tumour_map` returned {fault}; a map has the methods {', '.join(MAP_METHODS)}. Give a class that has "
            "them, or a function that returns an object of one."
        )
    return made


def checked_prediction(tumour_map: TumourMap, n_points: int) -> Prediction:
    """What a map predicts on its lattice.

    Args:
        tumour_map: The map, which may be a user's own.
        n_points: How many points of the lattice lie in the organ.

    Raises:
        ValueError: It is no prediction, one of another number of points, or one whose values are none.
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
    mean, variance = read_only(prediction.latent_mean), read_only(prediction.latent_variance)
    is_finite = np.isfinite(mean).all() and np.isfinite(variance).all()
    if not is_finite or variance.min(initial=0.0) < 0.0:
        raise ValueError(
            f"{name}.predict_lattice returned latent means or variances that are no finite numbers, or variances below "
            "0; it must return a Prediction with finite means, and with finite variances of 0 or more."
        )
    return Prediction(mean, variance)


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


def checked_worth(planner: Planner, situation: Situation) -> bool:
    """Whether a planner finds more actions worth it.

    Raises:
        ValueError: It says neither yes nor no.
    """
    is_worth = planner.is_worth_going_on(situation)
    if not isinstance(is_worth, bool | np.bool_):
        raise ValueError(
            f"{_name_of(planner)}.is_worth_going_on returned {is_worth!r}; it must be True or False."
        )
    return bool(is_worth)


def checked_reading(sensor: Sensor, state: SceneState, rng: np.random.Generator) -> Reading:
    """What a sensor reads.

    Args:
        sensor: The sensor, which may be a user's own.
        state: What it may look at, in the frame in which the organ lies as it was planned.
        rng: Its stream.

    Raises:
        ValueError: It is no reading, holds values that are not finite or points far from the organ, or labels for a
            second class that the scene has not.
    """
    reading, name, anatomy = sensor.sense(state, rng), type(sensor).__name__, state.scene.anatomy
    if not isinstance(reading, Reading):
        raise ValueError(
            f"{name}.sense returned {_told(reading)}; it must return a Reading, for example by state.exact_reading."
        )
    for field in ("points_m", "T_world_probe"):
        if not np.isfinite(getattr(reading, field)).all():
            raise ValueError(
                f"{name}.sense returned a value in {field} that is no finite number; leave it out."
            )
    if reading.is_target is not None and anatomy.target is None:
        raise ValueError(
            f"{name}.sense returned labels in is_target, but the scene has no second class; is_target must be None."
        )
    if len(reading.points_m):
        low_m, high_m = anatomy.organ.bounds_m
        beyond_m = max(
            (low_m - reading.points_m.min(axis=0)).max(), (reading.points_m.max(axis=0) - high_m).max()
        )
        if beyond_m > MOST_BEYOND_M:
            raise ValueError(
                f"{name}.sense returned points {beyond_m * 1e3:.0f} mm outside the organ's bounding box, and at most "
                f"{MOST_BEYOND_M * 1e3:.0f} mm are taken; points_m are metres in the world frame, to which "
                "state.to_world_m takes points of the probe's frame."
            )
    return reading


def _told(value: object) -> str:
    """A value in an error: None by itself, anything else by its type, since arrays fill pages."""
    return "None" if value is None else f"a {type(value).__name__}"


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
