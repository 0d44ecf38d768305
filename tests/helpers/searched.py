"""Situations of a search for hidden balls, and the poses that it goes through where nothing is found."""

import math
from dataclasses import replace

import numpy as np
from planner_situations import box_points, make_situation

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
