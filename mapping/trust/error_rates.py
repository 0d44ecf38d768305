"""How often a sensor errs, as a map is told of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class ErrorRates:
    """How a sensor's labels err: single points, and whole lesions of a view.

    Without values the sensor never errs.
    """

    false_positive: float = 0.0
    """Share of free points that are called tumour, each by itself."""
    false_negative: float = 0.0
    """Share of tumour points that are called free, each by itself."""
    missed: float = 0.0
    """Chance that a view misses a lesion as a whole."""
    invented: float = 0.0
    """Chance that a view calls a free place tumour together with all about it."""
    together_m: float = 0.008
    """Labels of one view that lie within this distance err together where lesions are missed or invented [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: A value is out of its range; the text names it.
        """
        for name in ("false_positive", "false_negative", "missed", "invented"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"`{name}` must be 0 or more and below 1, not {getattr(self, name)}")
        for one, other in (("false_positive", "false_negative"), ("missed", "invented")):
            if getattr(self, one) + getattr(self, other) >= 1.0:
                raise ValueError(
                    f"`{one}` and `{other}` must add up to less than 1: at 1 a label says nothing"
                )
        if not 0.0 < self.together_m < np.inf:
            raise ValueError(f"`together_m` must be above 0 and finite, not {self.together_m}")

    @property
    def err_together(self) -> bool:
        """Whether labels of one view err together."""
        return self.missed > 0.0 or self.invented > 0.0


PRIOR = ErrorRates(false_positive=0.002, false_negative=0.002, missed=0.08, invented=0.002)
"""What is expected of a sensor of which nobody tells more: slips are rare, and views of lesions err as those of readers
of ultrasound do (docs/readers.md)."""
