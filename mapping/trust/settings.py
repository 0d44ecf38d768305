"""How an episode is to trust its sensor: pure data."""

from __future__ import annotations

from dataclasses import dataclass

from .error_rates import PRIOR, ErrorRates


@dataclass(frozen=True, kw_only=True)
class TrustSettings:
    """The rates at which labels are believed to err."""

    rates: ErrorRates = PRIOR
    """The rates that are told; or those that are expected, where they are to be learnt."""
    learns: bool = True
    """Whether the rates are learnt as readings come."""
