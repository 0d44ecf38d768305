"""Errors of the programs that people run."""


class UsageError(Exception):
    """Something asked for that cannot be done as asked; the text names the value and the remedy."""
