"""The one error base of this package."""


class PlannerError(ValueError):
    """A planner was asked for something it cannot do; the text names the value and the remedy."""
