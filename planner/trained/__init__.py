"""A planner whose numbers were learned: what it looks at, what places are worth by them, and the numbers.

`benchmarks.train_baseline` learns them in the environment of Gymnasium and writes `weights.json`.
"""

from .features import N_OUTLINE, N_SEARCH
from .planner import Trained

__all__ = ["N_OUTLINE", "N_SEARCH", "Trained"]
