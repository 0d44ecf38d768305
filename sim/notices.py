"""Notices: sentences about what a person should know while a program runs."""

from __future__ import annotations

import sys
from collections.abc import Callable

Notify = Callable[[str], None]
"""A function that tells a person a sentence."""


def print_notice(text: str) -> None:
    """Print a notice on stderr."""
    print(f"note: {text}", file=sys.stderr)
