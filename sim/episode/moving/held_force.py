"""How well a force was held while the probe slid, and how well the arm kept to the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BAND = 0.2
"""A force is held where it is within this share of the wanted one."""
HELD_CELLS = ("force_in_band", "slide_force_error_n", "slide_slip_m", "slide_lag_m")
"""Figures of an action under servos that tables have."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldForce:
    """The force of the slides of one action, or of several."""

    wanted_n: float
    """The force that was wanted [N]."""
    force_n: NDArray[np.float64]
    """The force on the tip in every step of the dynamics while it slid [N], shape (S,)."""
    slip_m: NDArray[np.float64]
    """How far the tip was beside the way, across its direction and the beam, in each recorded state [m], shape (R,)."""
    lag_m: NDArray[np.float64]
    """How far it was behind, or ahead of, where it was sent along the way [m], shape (R,)."""

    @property
    def force_in_band(self) -> float | None:
        """Share of the time for which the force was within `BAND` of the wanted one; None where nothing slid."""
        if not len(self.force_n):
            return None
        return float((np.abs(self.force_n - self.wanted_n) <= BAND * self.wanted_n).mean())

    @property
    def slide_force_error_n(self) -> float | None:
        """Root of the mean squared error of the force [N]; None where nothing slid."""
        return float(np.sqrt(((self.force_n - self.wanted_n) ** 2).mean())) if len(self.force_n) else None

    @property
    def slide_slip_m(self) -> float | None:
        """The largest distance beside the way [m]; None where nothing slid."""
        return float(self.slip_m.max()) if len(self.slip_m) else None

    @property
    def slide_lag_m(self) -> float | None:
        """The largest distance along the way [m]; None where nothing slid."""
        return float(self.lag_m.max()) if len(self.lag_m) else None

    @classmethod
    def nothing(cls, wanted_n: float) -> HeldForce:
        """That of an action in which nothing slid."""
        return cls(wanted_n=wanted_n, force_n=np.empty(0), slip_m=np.empty(0), lag_m=np.empty(0))


def held_together(parts: Sequence[HeldForce]) -> HeldForce | None:
    """The force of several slides as one; None for none."""
    if not parts:
        return None
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("force_n", "slip_m", "lag_m")
    }
    return HeldForce(wanted_n=parts[-1].wanted_n, **arrays)
