"""The lesions that an organ is expected to hold before anything is sensed: how many there are, and how large.

The number N is Poisson of a rate that differs from patient to patient as Gamma(a, b), so that N is negative binomial.
With k lesions found among the share C of what there could be, the rate is Gamma(a + k, b + C), since the k found are
Poisson of C times the rate, whose conjugate prior is the gamma distribution (Gelman et al., Bayesian Data Analysis, 3rd
ed., 2013, section 2.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..errors import PlannerError


@dataclass(frozen=True, kw_only=True)
class LesionPrior:
    """Number and diameters of lesions; the defaults are those of the patients of LiTS.

    LiTS publishes 3 tumours a scan in the median, with quartiles of 1 and 9 (Bilic et al., The Liver Tumor Segmentation
    Benchmark, Medical Image Analysis, 2023). The negative binomial of mean 6.5 and shape 0.55 has these three. The
    diameters are those by which tumours are planted in generated livers: 16 mm in the median, since 58 % of liver
    metastases are under 20 mm, and a spread of the logarithm of 0.69 (0.35 between patients and 0.60 within them).
    """

    mean_number: float = 6.5
    """Mean number of lesions, a / b."""
    number_shape: float = 0.55
    """Shape a of the gamma distribution: below 1 most patients have few lesions and some have many."""
    median_diameter_m: float = 0.016
    """Median diameter [m]."""
    diameter_spread: float = 0.69
    """Standard deviation of the logarithm of the diameter; 0 for one size."""
    diameter_range_m: tuple[float, float] = (0.005, 0.100)
    """Diameters are held within this [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        low_m, high_m = self.diameter_range_m
        if not 0.0 < low_m <= high_m < math.inf:
            raise PlannerError(f"`diameter_range_m` must rise from above 0, got {self.diameter_range_m}")
        for name in ("mean_number", "number_shape"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise PlannerError(f"`{name}` must be above 0 and finite, got {getattr(self, name)}")
        if not low_m <= self.median_diameter_m <= high_m:
            raise PlannerError(
                f"`median_diameter_m` must be from {low_m:g} to {high_m:g} m, got {self.median_diameter_m}"
            )
        if not 0.0 <= self.diameter_spread <= 3.0:
            raise PlannerError(f"`diameter_spread` must be from 0 to 3, got {self.diameter_spread}")

    def rate(self, n_found: int, share: float) -> tuple[float, float]:
        """Shape and rate of the gamma distribution of the number's mean, a + k and b + C.

        Args:
            n_found: The number k of lesions found.
            share: The share C of what there could be that would have been found.
        """
        return self.number_shape + n_found, self.number_shape / self.mean_number + share

    def diameters_m(self, n: int) -> NDArray[np.float64]:
        """Diameters that are equally likely [m], shape (n,), rising: the quantiles of the lognormal distribution."""
        quantile = (np.arange(n) + 0.5) / n
        diameter_m = self.median_diameter_m * np.exp(self.diameter_spread * ndtri(quantile))
        return np.clip(diameter_m, *self.diameter_range_m)
