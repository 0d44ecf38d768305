"""Situations of a search for hidden balls, and the poses that it goes through where nothing is found."""

import math
from dataclasses import replace

import numpy as np
from planner_situations import box_points, make_situation

from mapping import LabelledPoints
from planner import Cone, FindAndOutline
from planner.find_and_outline.hidden_balls import BallPrior

POINTS = box_points()
PRIOR_MEAN = np.full(len(POINTS), -4.0)
CONE = Cone(math.radians(11.5), 0.102)
FEW = BallPrior(n_balls=400, radius_range_m=(0.005, 0.025), overlap_share=0.5)
PLANNER = FindAndOutline(balls=FEW)


def situation(*, workspace=None, mean=PRIOR_MEAN, readings=(), rate=0.0, **more):
    made = make_situation(mean=mean, workspace=workspace, **more)
    return replace(made, readings=tuple(readings), false_positive_rate=rate)


def play(planner, n_steps, workspace, unreachable=frozenset()):
    """Poses that an episode would sense where there is no tumour, its arm never reaching some."""
    sensed, skipped = [], set()
    for _ in range(n_steps):
        for pose in planner.rank(situation(workspace=workspace, sensed=sensed, skipped=skipped)):
            if pose not in unreachable:
                sensed.append(pose)
                break
            assert pose not in skipped
            skipped.add(pose)
    return sensed, skipped


def blob(centre_m, radius_m):
    """A latent at `POINTS` that is high within a ball."""
    return np.where(np.linalg.norm(POINTS - centre_m, axis=1) < radius_m, 4.0, -6.0)


def seen_free(workspace, sensed, n_points=1000):
    """Readings of a sensor that finds nothing: points even in each cone, those outside the organ's box left out."""
    rng = np.random.default_rng(0)
    readings = []
    for pose in sensed:
        depth_m = CONE.depth_m * np.cbrt(rng.random(n_points))
        radius_m = depth_m * math.tan(CONE.half_angle_rad) * np.sqrt(rng.random(n_points))
        turn = rng.uniform(0.0, 2.0 * np.pi, n_points)
        offset_m = np.column_stack([radius_m * np.cos(turn), radius_m * np.sin(turn), -depth_m])
        readings.append(
            LabelledPoints(workspace.positions_m[pose] + offset_m, np.zeros(n_points, dtype=bool))
        )
    return tuple(readings)
