"""The error of plugs."""

from sim.errors import UsageError


class PlugError(UsageError):
    """A plug that cannot be loaded or made; the text names it, what went wrong and the remedy."""
