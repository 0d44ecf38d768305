"""Settings of a Hilbert map and of its detail near sensed tumour: pure data, in SI units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

Form = Literal["full", "local", "diagonal"]


@dataclass(frozen=True, kw_only=True)
class MapSettings:
    """What a Hilbert map assumes before it has seen anything, and how exactly it computes."""

    hinge_spacing_m: float = 0.01125
    """Distance between neighbouring hinges [m]; the paper's 0.375 units of 30 mm."""
    gamma_per_m2: float = 4100.0
    """gamma of the kernel exp(-gamma |x - h|^2) (eq. 1) [1/m^2]. The default makes it 11 mm wide, 1 / sqrt(2 gamma), at
    which its probabilities mean what they say (docs/map.md); the paper's 5 per squared unit of 30 mm make it 9.5 mm.
    """
    prior_prevalence: float = 0.02
    """Share of the organ that is expected to be tumour before any reading; 0.5 is the paper's."""
    weight_variance: float = 10.0
    """Prior variance of each weight. The latent's standard deviation is then about 2.3 sqrt(weight_variance).
    Tumours have sharp edges, which a small variance blurs: docs/map.md shows how much.
    """
    false_positive_rate: float = 0.0
    """Share of free points that the sensor calls tumour."""
    false_negative_rate: float = 0.0
    """Share of tumour points that the sensor calls free."""
    n_em_iterations: int = 4
    """Rounds of EM within one reading."""
    form: Form = "full"
    """`full` keeps the whole covariance of the weights. `local` keeps it near its diagonal, for more than 5,000
    hinges. `diagonal` keeps only their variances, and so counts points many times.
    """
    tolerance: float = 3e-6
    """Size of what the computation may leave out: smaller is slower and closer, 0 is exact to rounding."""

    @classmethod
    def paper(cls) -> MapSettings:
        """The settings of the paper: no prior knowledge of how much is tumour, hinges 0.375 units apart, gamma = 5.

        The paper says of the prior variance only that it is high; 4 is our reading.
        """
        return cls(
            hinge_spacing_m=0.01125, gamma_per_m2=5 / 0.03**2, prior_prevalence=0.5, weight_variance=4.0
        )

    def __post_init__(self) -> None:
        """Checks the ranges."""
        _check_positive("hinge_spacing_m", self.hinge_spacing_m)
        _check_positive("gamma_per_m2", self.gamma_per_m2)
        _check_positive("weight_variance", self.weight_variance)
        if not 0 < self.prior_prevalence < 1:
            raise ValueError(
                f"`prior_prevalence` must lie between 0 and 1, both excluded, not {self.prior_prevalence}"
            )
        _check_rates(self.false_positive_rate, self.false_negative_rate)
        if not (isinstance(self.n_em_iterations, int) and self.n_em_iterations >= 1):
            raise ValueError(
                f"`n_em_iterations` must be a whole number of at least 1, not {self.n_em_iterations}"
            )
        if self.form not in ("full", "local", "diagonal"):
            raise ValueError(f"`form` must be 'full', 'local' or 'diagonal', not {self.form!r}")
        _check_tolerance(self.tolerance)


@dataclass(frozen=True, kw_only=True)
class DetailSettings:
    """How a `DetailedMap` answers near sensed tumour, and how it weighs what the coarse map says.

    All of it was chosen on readings of the seeds from 1000 on, the last six so that probabilities mean what they say
    (docs/map.md); the reported seeds took no part.
    """

    length_m: float = 0.011
    """Length l of the covariance s^2 exp(-r^2 / (2 l^2)) of the latent near tumour [m]."""
    variance: float = 1000.0
    """Prior variance s^2 of that latent: tumours have sharp edges."""
    prior_mean: float = -40.0
    """Prior mean of that latent."""
    n_neighbours: int = 24
    """Number of labels, the nearest ones, that answer for a place."""
    reach_m: float = 0.010
    """Places within this distance of a label of tumour are near tumour [m]."""
    cube_m: float = 0.0025
    """Of the labels of one kind in a cube of this side [m], the first is kept."""
    bias: float = -0.35
    """Added to the log-odds near tumour: a cone's labels reach deeper into a tumour than its edge lies."""
    sharpness: float = 4.4
    """Factor of the log-odds near tumour: Laplace's approximation is too timid."""
    fading: float = 0.2
    """Power of the share of the prior variance that is left, by which a place falls back to the coarse map."""
    credit: float = 0.8
    """How much of a suspicion of the coarse map counts: the share of its log-odds above those of the prevalence."""
    doubt: float = 0.06
    """Largest share of its prior prevalence that a place keeps however sure the coarse map is of it from afar."""
    doubt_m: float = 0.0075
    """Distance from the nearest label [m] over which this share grows, as 1 - exp(-(d / doubt_m)^2)."""

    stray_m: float = 0.0
    """How far the outline that a view draws strays from the true one [m], a standard deviation; of readings only whose
    labels err together."""
    cell_m: float = 0.0
    """Places in one cube of this side [m] are answered for by the labels nearest to its centre; 0 for each its own."""

    @classmethod
    def of_many_labels(cls) -> DetailSettings:
        """The settings for labels that may be wrong: more of them answer for a place, and fewer are thinned out.

        Both numbers for outlines were chosen on seeds from 1000 on (docs/map.md): rims that views draw apart are less
        sure than a classifier takes them for that believes the labels of different views to err independently.
        """
        return cls(n_neighbours=48, cube_m=_FINE_CUBE_M, stray_m=0.001, sharpness=3.5, cell_m=_CELL_M)

    def at_uncertain_places(self, deviation_m: float) -> DetailSettings:
        """The settings for labels that lie off by a Gaussian shift along the surface.

        Between a place and one that is off by it, the latent f of the covariance s^2 exp(-r^2 / (2 l^2)) differs by

            D = E (f(x + e) - f(x))^2 = 2 s^2 (1 - 1 / (1 + sigma^2 / l^2)),

        for a shift e of the deviation sigma along each of two directions. A label there then tells of f as one of the
        latent f / kappa would that lies where it is said to, kappa^2 = 1 + pi D / 8 (MacKay, Neural Computation 4(5),
        1992, on moderated outputs; McHutchon and Rasmussen, NIPS 2011, on inputs with noise). Such labels are thinned
        out less, and places of one cube share them. To ask more of them changes no map and takes four times as long.

        Args:
            deviation_m: The standard deviation sigma [m], at least 0.
        """
        kappa2 = self._moderation2(deviation_m)
        return replace(
            self,
            variance=self.variance / kappa2,
            prior_mean=self.prior_mean / float(np.sqrt(kappa2)),
            cube_m=_FINE_CUBE_M,
            cell_m=_CELL_M,
        )

    def where_views_are_off(
        self, deviation_m: float, force_n: float = 0.0, *, counts_views: bool = False
    ) -> DetailSettings:
        """The settings where the labels of a view are off together.

        Log odds near tumour are too sure then. Causes add up: with the kappa of `at_uncertain_places` and a force F
        sharpness is divided by

            sqrt(1 + c (2.1 (1 - 1 / kappa^2) + 0.9 (F / 1 N)^2)),

        where c is 1, or a quarter if labels of one view count for one already.

        Args:
            deviation_m: By how much places are off along the surface, a standard deviation [m], at least 0.
            force_n: The force [N] of the press that a model of tissue takes readings back from; 0 on a rigid organ.
            counts_views: Whether labels of one view count for one, as they do with a reader that errs.
        """
        of_place = _DOUBT_AT_UNCERTAIN_PLACES * (1.0 - 1.0 / self._moderation2(deviation_m))
        share = _SHARE_WHERE_VIEWS_COUNT if counts_views else 1.0
        doubt = share * (of_place + _DOUBT_UNDER_LOAD * force_n**2)
        return replace(self, sharpness=self.sharpness / float(np.sqrt(1.0 + doubt)))

    def _moderation2(self, deviation_m: float) -> float:
        """kappa^2 of `at_uncertain_places`."""
        difference = 2.0 * self.variance * (1.0 - 1.0 / (1.0 + (deviation_m / self.length_m) ** 2))
        return 1.0 + float(np.pi) / 8.0 * difference

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name in ("length_m", "variance", "reach_m", "cube_m", "sharpness", "fading", "credit", "doubt_m"):
            _check_positive(name, getattr(self, name))
        for name in ("prior_mean", "bias"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"`{name}` must be finite, not {getattr(self, name)}")
        for name in ("stray_m", "cell_m"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"`{name}` must be 0 or more and finite, not {getattr(self, name)}")
        if not (isinstance(self.n_neighbours, int) and 1 <= self.n_neighbours <= 200):
            raise ValueError(f"`n_neighbours` must be a whole number from 1 to 200, not {self.n_neighbours}")
        if not 0.0 <= self.doubt < 1.0:
            raise ValueError(f"`doubt` must lie in 0 .. 1, 1 excluded, not {self.doubt}")


_FINE_CUBE_M = 0.001
"""Side of the cubes by which labels are thinned out that may be wrong, or lie elsewhere [m]."""
_CELL_M = 0.0045
"""Side of the cubes whose places share their neighbours [m], where an action would otherwise take too long."""
_DOUBT_AT_UNCERTAIN_PLACES, _DOUBT_UNDER_LOAD = 2.1, 0.9
"""How much less sure log odds near tumour are, the latter at 1 N."""
_SHARE_WHERE_VIEWS_COUNT = 0.25
"""The share of it that is left where labels of one view count for one.

All three were chosen on seeds from 1000 on, so that probabilities mean what they say (docs/body.md)."""


def _check_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"`{name}` must be positive and finite, not {value}")


def _check_tolerance(tolerance: float) -> None:
    if not 0.0 <= tolerance <= 0.1:
        raise ValueError(f"`tolerance` must lie between 0 (exact) and 0.1, not {tolerance}")


def _check_rates(false_positive_rate: float, false_negative_rate: float) -> None:
    if not (
        false_positive_rate >= 0
        and false_negative_rate >= 0
        and false_positive_rate + false_negative_rate < 1
    ):
        raise ValueError(
            "`false_positive_rate` and `false_negative_rate` must be at least 0 and add up to less than 1 "
            f"(at 1 a label says nothing), not {false_positive_rate} and {false_negative_rate}"
        )
