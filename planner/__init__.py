"""Where to sense next: the workspace of poses, what a planner may know, acquisition functions, and the planners.

A planner ranks the workspace's poses, given a `Situation`; `Planner` is what one of one's own derives from.
"""

from .acquisition import (
    expected_improvement,
    log_expected_improvement,
    log_probability_of_improvement,
    mutual_information,
    probability_variance,
    upper_confidence_bound,
)
from .baselines import (
    ExpectedVolume,
    GreedyCoverage,
    MutualInformation,
    ProbabilityOfImprovement,
    ThompsonSampling,
    UpperConfidenceBound,
)
from .cone import Cone
from .errors import PlannerError
from .expected_improvement import ExpectedImprovement
from .find_and_outline.planner import FindAndOutline
from .multi_resolution import MultiResolution
from .planner import Planner
from .random_order import RandomOrder
from .registering import registering_first
from .registry import (
    confident_planner_names,
    make_planner,
    planner_class,
    planner_names,
    weighing_planner_names,
)
from .situation import PlaceBelief, Situation
from .stopping.lesion_prior import LesionPrior
from .stopping.what_is_left import WhatIsLeft
from .trained import Trained
from .visibility import scattered_poses, visibility, visible_points
from .workspace import Workspace

__all__ = [
    "Cone",
    "ExpectedImprovement",
    "ExpectedVolume",
    "FindAndOutline",
    "GreedyCoverage",
    "LesionPrior",
    "MultiResolution",
    "MutualInformation",
    "PlaceBelief",
    "Planner",
    "PlannerError",
    "ProbabilityOfImprovement",
    "RandomOrder",
    "Situation",
    "ThompsonSampling",
    "Trained",
    "UpperConfidenceBound",
    "WhatIsLeft",
    "Workspace",
    "confident_planner_names",
    "expected_improvement",
    "log_expected_improvement",
    "log_probability_of_improvement",
    "make_planner",
    "mutual_information",
    "planner_class",
    "planner_names",
    "probability_variance",
    "registering_first",
    "scattered_poses",
    "upper_confidence_bound",
    "visibility",
    "visible_points",
    "weighing_planner_names",
]
