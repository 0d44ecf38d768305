"""The error that all of this package raises."""


class PlannerError(ValueError):
    """The error of a planner that cannot do what it should; the text names the value and the remedy."""
