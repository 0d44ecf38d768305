"""The belief over the weights with their covariance, whole or near its diagonal: the default form.

The paper gives Sigma_t the shape 1 x M, a variance per weight. Here it is M x M: neighbouring features overlap, and
without their covariance a point would count about nine times (`diagonal` has the paper's form).

With f = m + Phi (w - mu), Phi = T C and C Sigma C^T = R R^T, a reading's own coordinates are z = R^-1 C (w - mu). Their
posterior has mean z' and covariance D^-1 (`variational`), and goes back to the weights as

    mu' = mu + Y z',   Sigma' = Sigma - Y (I - D^-1) Y^T = Sigma - G G^T,   Y = Sigma C^T R^-T.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from ..kernel import HingeFeatures
from ..lattice import Lattice, MaskedLattice
from ..likelihood import Evidence, bound_curvature
from ..settings import MapSettings
from ..storage import checked_array
from .belief import Belief, LearningReport
from .carried_variance import CarriedVariance
from .coordinates import ReadingCoordinates, reading_coordinates
from .dense_covariance import DenseCovariance
from .held_readings import HeldReading, held_from, held_state
from .pair_features import PairFeatures, summed_features
from .reduction import Reduction, pivoted_cholesky, reduce_by_pivots, reduce_exactly
from .samples import WeightSamples
from .tiled_covariance import TiledCovariance
from .variational import fit_reading, refit_reading

# The seven constants below say what may be left out, as multiples of `MapSettings.tolerance`. Each was raised until it
# began to add to the error in probability after 50 readings (docs/map.md shows the table).
_PIVOT_TOLERANCE = 1.0
"""Share of |phi|^2 of a point's features that does not follow from the pivots."""
_ROOT_TOLERANCE = 10.0
"""Variance of the latent at a pivot that does not follow from the others."""
_ROW_TOLERANCE = 0.03
"""Fall of a weight's variance."""
_SHRINKAGE_TOLERANCE = 1000.0
"""Share of a direction's variance that the reading takes away."""
_FEATURE_CUTOFF = 10.0
"""Features of a reading."""
_QUERY_CUTOFF = 0.01
"""Terms of the variance at a query point."""
_MARGIN_CUTOFF = 1e4
"""Features beyond the touched weights, whose own fall is as small as `_ROW_TOLERANCE`."""
_SINGLE_FROM = 1e-6
"""Tolerance from which single precision is enough: alone it moves probabilities by some 1e-4."""


class FullBelief(Belief):
    """Gaussian belief over the weights: their mean and their covariance."""

    def __init__(
        self, features: HingeFeatures, settings: MapSettings, covariance: DenseCovariance | TiledCovariance
    ) -> None:
        """Starts at zero mean.

        Args:
            features: The features whose weights these are.
            settings: The map's.
            covariance: The prior covariance, as the form keeps it.
        """
        self._features = features
        self._settings = settings
        self.mean = np.zeros(features.n_weights)
        self.covariance = covariance
        self.held: list[HeldReading] = []
        self._samples: WeightSamples | None = None

    @classmethod
    def prior(
        cls,
        features: HingeFeatures,
        settings: MapSettings,
        query: MaskedLattice | None,
    ) -> FullBelief:
        """The prior belief of the form `full` or `local`.

        Args:
            features: The features whose weights these are.
            settings: The map's.
            query: The points at which the latent's variance is carried; None for none.
        """
        variance, carried = settings.weight_variance, None
        if query is not None:
            cutoff = min(_MARGIN_CUTOFF * settings.tolerance, 1.0)
            carried = CarriedVariance(
                features,
                query.lattice,
                variance,
                query_mask=query.mask,
                cutoff=cutoff,
                precision=_precision(settings),
            )
        if settings.form == "local":
            return cls(features, settings, TiledCovariance(features, variance, carried))
        kept = DenseCovariance(
            features,
            variance,
            carried,
            is_exact=settings.tolerance == 0,
            precision=_precision(settings),
        )
        return cls(features, settings, kept)

    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], evidence: Evidence
    ) -> LearningReport:
        """Takes in a reading; see `Belief.learn`, and the module for the formulas."""
        reduction = self._reduce(points_m)
        # A reading beyond all hinges touches no weight.
        if not reduction.hinges.size:
            return LearningReport(0, 0, bound_curvature(offset))
        coordinates = self._coordinates(reduction, offset)
        reading = fit_reading(
            coordinates.mean,
            coordinates.basis,
            evidence,
            self._settings.n_em_iterations,
            search_precision=_precision(self._settings),
        )
        moves = None if self._samples is None else self._samples.learn(coordinates, reading)
        Z = self._shrinkage_root(reading.cholesky)
        n_touched = self._write_back(coordinates, reading.mean, fall=Z, rise=Z[:, :0], moves=moves)
        # A copy, since the caller may use the array again.
        self.held.append(HeldReading(points_m.copy(), offset, evidence, reading.curvature, reading.labels))
        return LearningReport(Z.shape[1], n_touched, reading.curvature)

    def revise(self) -> float:
        """Fits every reading anew, oldest first, with xi from all that is known now; see `Belief.revise`."""
        largest, n_rounds = 0.0, self._settings.n_em_iterations
        for number, held in enumerate(self.held):
            now = self._coordinates(self._reduce(held.points_m), held.offset)
            change = refit_reading(now.mean, now.basis, held.evidence, held.curvature, held.labels, n_rounds)
            moves = None if self._samples is None else self._samples.revise(now, change)
            fall, rise = (change.root(sign, self._smallest_share()) for sign in (1.0, -1.0))
            self._write_back(now, change.mean, fall=fall, rise=rise, moves=moves)
            largest = max(largest, float(np.abs(now.basis @ change.mean).max()))
            self.held[number] = replace(held, curvature=change.curvature, labels=change.labels)
        return largest

    def lay(self, points_m: Sequence[NDArray[np.float64]], offsets: Sequence[NDArray[np.float64]]) -> bool:
        """Has the readings that it holds lie elsewhere; see `Belief.lay`.

        Sigma^-1 = I / s^2 + 2 sum Phi^T diag(w lambda) Phi,   Sigma^-1 mu = sum Phi^T w (y - 1/2 - 2 lambda b)
        """
        if not isinstance(self.covariance, DenseCovariance) or len(points_m) != len(self.held):
            return False
        told = zip(self.held, points_m, offsets, strict=True)
        self.held = [replace(held, points_m=at_m, offset=offset) for held, at_m, offset in told]
        information = np.zeros(self._features.hinges.shape)
        for held in self.held:
            slope = held.evidence.weight * (held.labels - 0.5 - 2.0 * held.curvature * held.offset)
            information += summed_features(self._features.along_axes(held.points_m), slope)
        pairs = PairFeatures(self._features)
        precision = pairs.precision(
            (held.points_m, 2.0 * held.evidence.weight * held.curvature) for held in self.held
        )
        precision[np.diag_indices_from(precision)] += 1.0 / self._settings.weight_variance
        is_kept = self._features.weight_of_hinge >= 0
        self.mean = self.covariance.become(precision, information.ravel()[is_kept], pairs)
        if self._samples is not None:
            self._samples = self._samples.drawn_anew(self.covariance)
        return True

    def settle(self) -> None:
        """Takes off the covariance what the last reading left for later; see `Belief.settle`."""
        self.covariance.settle()

    def carry_samples(self, n_samples: int, rng: np.random.Generator) -> None:
        """Draws weights from the belief and moves them with every later reading; see `Belief.carry_samples`."""
        self._samples = WeightSamples(self.covariance.draw(n_samples, rng), rng)

    @property
    def samples(self) -> NDArray[np.float64]:
        """The carried draws of the weights, shape (M, S); see `Belief.samples`."""
        if self._samples is None:
            raise ValueError("no samples are carried; call carry_samples(n_samples, rng=rng) first")
        return self.mean[:, None] + self._samples.deviations

    def state(self) -> dict[str, NDArray]:
        """The mean, the arrays of the covariance and those of the readings that are held."""
        return {"mean": self.mean, **self.covariance.state(), **held_state(self.held)}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over the arrays of another belief; see `Belief.restore`."""
        self.mean, self.held = checked_array(state, "mean", self.mean.shape), held_from(state)
        self.covariance.restore(state)

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """The variance at all points of a lattice; see `Belief.variance_on_lattice`."""
        return np.maximum(self.covariance.variance_on_lattice(query), 0)

    def variance_near(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The variance at points that lie close together; see `Belief.variance_near`."""
        return np.maximum(self.covariance.variance_at(points_m, _QUERY_CUTOFF * self._settings.tolerance), 0)

    def _reduce(self, points_m: NDArray[np.float64]) -> Reduction:
        tolerance = self._settings.tolerance
        box = self._features.box_around(points_m, _FEATURE_CUTOFF * tolerance)
        weights = self._features.weights_in(box)
        factors = self._features.along_axes(points_m, box)
        if tolerance > 0:
            local = reduce_by_pivots(
                factors,
                weights >= 0,
                tolerance=_PIVOT_TOLERANCE * tolerance,
                cutoff=_FEATURE_CUTOFF * tolerance,
            )
        else:
            local = reduce_exactly(factors, weights >= 0)
        return replace(local, hinges=weights[local.hinges])

    def _coordinates(self, reduction: Reduction, offset: NDArray[np.float64]) -> ReadingCoordinates:
        prior_mean = offset + reduction.at_points(reduction.directions @ self.mean[reduction.hinges])
        others, products = self.covariance.cross(reduction.directions, reduction.hinges)
        tolerance = _ROOT_TOLERANCE * self._settings.tolerance
        return reading_coordinates(reduction, prior_mean, others, products, tolerance=tolerance)

    def _write_back(
        self,
        coordinates: ReadingCoordinates,
        mean: NDArray[np.float64],
        *,
        fall: NDArray[np.float64],
        rise: NDArray[np.float64],
        moves: NDArray[np.float64] | None,
    ) -> int:
        """Takes a belief over z back to the weights: mu + Y z', Sigma - Y (Z Z^T) Y^T, and the draws' moves.

        Args:
            coordinates: The reading's coordinates.
            mean: z', shape (r,).
            fall: Z, shape (r, s).
            rise: What Z is for the part that is added to Sigma, shape (r, t).
            moves: Change of z of each draw, shape (r, S); None where no draws are carried.

        Returns:
            The number of weights whose variance changed.
        """
        parts = [mean[:, None], fall, rise, *([] if moves is None else [moves])]
        ends = np.cumsum([part.shape[1] for part in parts])
        weights, rows = coordinates.others, coordinates.rows(np.hstack(parts))
        self.mean[weights] += rows[0]
        if self._samples is not None:
            self._samples.deviations[weights] += rows[ends[2] :].T
        touched = [
            self._lower(weights, rows[start:end], sign=sign)
            for start, end, sign in ((ends[0], ends[1], 1.0), (ends[1], ends[2], -1.0))
        ]
        return max(touched)

    def _lower(self, weights: NDArray[np.intp], rows: NDArray[np.floating], *, sign: float) -> int:
        """Takes sign G G^T off the covariance, for G^T = rows, and returns the number of weights that it touches."""
        falls = np.einsum("sk,sk->k", rows, rows)
        touched = np.flatnonzero(falls > _ROW_TOLERANCE * self._settings.tolerance)
        if touched.size > 0:
            self.covariance.lower(weights[touched], rows[:, touched].T, sign=sign)
        return touched.size

    def _smallest_share(self) -> float:
        # Rounding makes about 1e-16 of a shrinkage of zero, far less than a variance could be.
        return max(_SHRINKAGE_TOLERANCE * self._settings.tolerance, 1e-15)

    def _shrinkage_root(self, factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Z with Z Z^T = I - D^-1 for D = Q Q^T, without the directions that the reading left as they were."""
        identity = np.eye(len(factor))
        shrinkage = identity - cho_solve((factor, True), identity, check_finite=False)
        return pivoted_cholesky(shrinkage, self._smallest_share())[0]


def _precision(settings: MapSettings) -> type[np.floating]:
    """The type in which the covariance of the full form is kept, and what a reading takes off is summed."""
    return np.float32 if settings.tolerance >= _SINGLE_FROM else np.float64
