"""Where the organ is believed to lie, learnt from where the probe met its surface."""

from .moves import most_moved_m, moved_m
from .rigid_belief import Contact, RigidBelief, RigidPrior

__all__ = ["Contact", "RigidBelief", "RigidPrior", "most_moved_m", "moved_m"]
