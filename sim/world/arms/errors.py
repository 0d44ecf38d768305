"""The error of arms."""

from sim.world.errors import WorldError


class ArmError(WorldError):
    """An arm's file that cannot be used as it is."""
