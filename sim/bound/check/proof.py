"""What every line of a certificate is held against: a claim, and what prices prove."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SLACK = 1e-6
"""What a bound may lack to a whole number, and sums may differ by, through rounding."""


class DoesNotHoldError(Exception):
    """A line of a certificate that does not hold; the text says which, and what holds in its place."""


def require(holds: bool, text: str) -> None:
    """Nothing, if a line of the certificate holds.

    Raises:
        DoesNotHoldError: It does not.
    """
    if not holds:
        raise DoesNotHoldError(text)


def proven_value(held: NDArray[np.bool_], need: int, prices: NDArray[np.float64], worth: float) -> float:
    """What prices prove about the number of cones that hold enough points.

    Every cone holds points worth at most 1, so n cones hold at most n; and whoever holds enough points holds at least
    worth * need, less what the points are cheaper than that.

    Raises:
        DoesNotHoldError: The prices are none, or a cone's points are worth more than 1.
    """
    is_price = prices.shape == held.shape[1:] and bool(np.isfinite(prices).all() and (prices >= 0.0).all())
    require(is_price, "its prices are not one number from 0 on for each point")
    require(math.isfinite(worth) and worth >= 0.0, f"the worth {worth} is not a number from 0 on")
    dearest = max((float(prices[cone].sum()) for cone in held), default=0.0)
    require(dearest <= 1.0 + SLACK, f"a cone holds points worth {dearest:.9g}, and 1 is the most")
    return worth * need - sum(max(0.0, worth - float(price)) for price in prices)
