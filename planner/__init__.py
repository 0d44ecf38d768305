"""Where to sense next: the workspace of poses, acquisition functions, planners."""

from .cone import Cone
from .errors import PlannerError
from .expected_improvement import ExpectedImprovement
from .find_and_outline.planner import FindAndOutline
from .multi_resolution import MultiResolution
from .planner import Planner
from .random_order import RandomOrder
from .registry import make_planner, planner_names
from .situation import Situation
from .visibility import scattered_poses, visibility, visible_points
from .workspace import Workspace

__all__ = [
    "Cone",
    "ExpectedImprovement",
    "FindAndOutline",
    "MultiResolution",
    "Planner",
    "PlannerError",
    "RandomOrder",
    "Situation",
    "Workspace",
    "make_planner",
    "planner_names",
    "scattered_poses",
    "visibility",
    "visible_points",
]
