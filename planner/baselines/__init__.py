"""The baselines that a reviewer asks for, each as short as its formula: by points, and by what a cone holds."""

from .cones import ExpectedVolume, GreedyCoverage, MutualInformation
from .points import ProbabilityOfImprovement, ThompsonSampling, UpperConfidenceBound

__all__ = [
    "ExpectedVolume",
    "GreedyCoverage",
    "MutualInformation",
    "ProbabilityOfImprovement",
    "ThompsonSampling",
    "UpperConfidenceBound",
]
