"""Numbers and intervals as the cells of tables have them."""

from __future__ import annotations

import math

from .estimates import Interval


def number_text(value: float, form: str) -> str:
    """A number, with a dash where there is none, and `never` where it is infinite."""
    if math.isnan(value):
        return "–"
    return "never" if math.isinf(value) else form.format(value)


def interval_text(interval: Interval, form: str) -> str:
    """An interval in brackets, with a dash where there is none."""
    if math.isnan(interval[0]):
        return "[–]"
    return f"[{number_text(interval[0], form)}, {number_text(interval[1], form)}]"
