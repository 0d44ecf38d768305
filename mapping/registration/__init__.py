"""Where the organ is believed to lie, learnt from where the probe met its surface."""

from .rigid_belief import Contact, RigidBelief, RigidPrior

__all__ = ["Contact", "RigidBelief", "RigidPrior"]
