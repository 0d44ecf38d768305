"""The episode as an environment of Gymnasium; importing this package registers `Sounding/liver-v0` and the others.

An action is a pose, an observation is what a planner may know, and the reward is the share of the tumours newly sensed.
The package needs the extra `gym`.
"""

from .environment import SoundingEnv
from .registration import ENVIRONMENTS, register_environments

__all__ = ["ENVIRONMENTS", "SoundingEnv", "register_environments"]
