"""A path of two joints, and limits that it keeps."""

import numpy as np

from sim.live.arm.timed_path import ArmLimits, TimedPath

LIMITS = ArmLimits(low=np.array([-1.0, -np.inf]), high=np.array([1.0, np.inf]), speed=np.array([2.0, 1.0]))


def path(ends=(0.8, -0.5), duration_s=2.0, n=101):
    """Two joints from zero to two ends along a cosine, at rest at both ends."""
    time_s = np.linspace(0.0, duration_s, n)
    share = 0.5 * (1.0 - np.cos(np.pi * time_s / duration_s))
    rate = 0.5 * np.pi / duration_s * np.sin(np.pi * time_s / duration_s)
    rate[[0, -1]] = 0.0
    ends = np.array(ends)
    return TimedPath(names=("a", "b"), time_s=time_s, q=share[:, None] * ends, speed=rate[:, None] * ends)
