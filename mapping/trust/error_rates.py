"""How often a sensor errs, as a map is told of it."""

from __future__ import annotations

import math
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

    @property
    def correlation(self) -> float:
        """How much labels of one view that lie together err together, from 0 (each by itself) to 1.

        With the chance c that the view errs about a place and the chance q that a label errs by itself, a label is
        wrong with the chance e = c + (1 - c) q, and the errors of two have the correlation

            rho = c (1 - c) (1 - q)^2 / (e (1 - e))

        The mean of both kinds of labels holds for both, the geometric one: if the labels of one kind counted for more
        than those of the other, outlines would move to the other's side.
        """
        both = (self.invented, self.false_positive), (self.missed, self.false_negative)
        return math.sqrt(math.prod(_correlation(together, alone) for together, alone in both))


def _correlation(together: float, alone: float) -> float:
    """The correlation of errors that come together by one chance, and alone by another; 0 without errors."""
    wrong = together + (1.0 - together) * alone
    return together * (1.0 - together) * (1.0 - alone) ** 2 / (wrong * (1.0 - wrong)) if wrong > 0.0 else 0.0


PRIOR = ErrorRates(false_positive=0.002, false_negative=0.002, missed=0.08, invented=0.002)
"""What is expected of a sensor of which nobody tells more: slips are rare, and views of lesions err as those of readers
of ultrasound do (docs/readers.md)."""
