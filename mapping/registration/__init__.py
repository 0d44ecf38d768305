"""The belief about where a body lies, learnt from contacts with its surface and from how readings fit each other."""

from .laid_readings import Laid, LaidReadings
from .moves import most_moved_m, moved_m
from .reading_shifts import ReadingShifts
from .rigid_belief import Contact, RigidBelief, RigidPrior

__all__ = [
    "Contact",
    "Laid",
    "LaidReadings",
    "ReadingShifts",
    "RigidBelief",
    "RigidPrior",
    "most_moved_m",
    "moved_m",
]
