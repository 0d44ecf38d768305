"""The error of probes."""

from sim.world.errors import WorldError


class ProbeError(WorldError):
    """A probe's file that cannot be used as it is."""
