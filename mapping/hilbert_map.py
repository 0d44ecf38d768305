"""The sequential Bayesian Hilbert map (section IV-B of the paper): readings in, probability of occupancy out.

    P(y = 1 | x, w) = sigma(f(x)),   f(x) = b(x) + phi(x) . w,   w ~ N(mu, Sigma)

The offset b(x) makes the prior expect `prior_prevalence` at every point; with the paper's 1/2 it is zero.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .belief.base import Belief, UpdateReport
from .belief.diagonal import DiagonalBelief
from .belief.full import FullBelief
from .kernel import HingeFeatures
from .lattice import Lattice, check_points
from .likelihood import label_log_odds, prior_offset
from .prediction import Prediction
from .settings import MapSettings
from .storage import read_arrays, write_arrays
from .threads import one_blas_thread


class QueryBox(NamedTuple):
    """Part of a query lattice."""

    lattice: Lattice
    """Its points."""
    mask: NDArray[np.bool_]
    """Which of them are asked for, shape (lattice.n_points,)."""
    indices: NDArray[np.intp]
    """Where the answers for those stand among the whole lattice's."""


class HilbertMap:
    """Belief over where an organ is occupied by tumour; `update` changes it in place."""

    def __init__(
        self,
        hinges: Lattice,
        settings: MapSettings | None = None,
        *,
        query: Lattice | None = None,
        query_mask: ArrayLike | None = None,
        hinge_mask: ArrayLike | None = None,
    ) -> None:
        """Makes the prior belief.

        Args:
            hinges: Centres of the features, one weight each.
            settings: What the map assumes; the defaults if None.
            query: Lattice on which `predict_lattice` answers; what it costs does not grow with the readings.
            query_mask: Which points of `query` are asked for, shape (query.n_points,); all if None.
            hinge_mask: Which hinges are kept, shape (hinges.n_points,); all if None. Keep every hinge
                within four spacings of the organ, since the prior takes the others for present.

        Raises:
            ValueError: If a mask does not fit its lattice, keeps nothing, or masks a query that is not there.
        """
        _check_hinges(hinges)
        self.hinges = hinges
        self.settings = settings if settings is not None else MapSettings()
        self.query = query
        self._query_mask = _check_query_mask(query, query_mask)
        hinge_mask = None if hinge_mask is None else np.asarray(hinge_mask, dtype=bool)
        self._features = HingeFeatures.build(hinges, self.settings.gamma_per_m2, hinge_mask)
        self._lattice_offset = None if query is None else self._offset_on_lattice(query)
        self._belief = _make_belief(self._features, self.settings, query, self._query_mask)

    @property
    def n_weights(self) -> int:
        """Number of hinges that are kept, M."""
        return self._features.n_weights

    @property
    def belief(self) -> Belief:
        """The belief over the weights."""
        return self._belief

    @one_blas_thread()
    def update(self, points_m: ArrayLike, is_occupied: ArrayLike) -> UpdateReport:
        """Takes in a reading: learns from labelled points.

        Args:
            points_m: Sensed points [m], shape (n, 3); n may be 0.
            is_occupied: Their labels, shape (n,), True (1) for tumour.

        Raises:
            ValueError: If shapes differ, a point is not finite, or a label is neither 0 nor 1.
        """
        points = check_points(points_m)
        labels = _check_labels(is_occupied, len(points))
        if len(points) == 0:
            return UpdateReport(n_points=0, n_occupied=0, rank=0, n_weights_touched=0, curvature=np.zeros(0))
        settings = self.settings
        log_odds = label_log_odds(labels, settings.false_positive_rate, settings.false_negative_rate)
        report = self._belief.learn(points, self._offset(points), log_odds)
        return UpdateReport(
            n_points=len(points),
            n_occupied=int(labels.sum()),
            rank=report.rank,
            n_weights_touched=report.n_weights_touched,
            curvature=report.curvature,
        )

    @one_blas_thread()
    def revise(self, n_sweeps: int = 1) -> float:
        """Fits every reading again in the light of all the others.

        A reading is taken in with the xi of its moment, so what is learnt depends on the order of the
        readings. Sweeps move the map to the posterior of all readings at once, in which the order has no
        part.

        Args:
            n_sweeps: How often all readings are gone through; each costs as much as an update per reading.

        Returns:
            The largest change of the latent's mean at a sensed point in the last sweep.

        Raises:
            ValueError: If the form is diagonal.
        """
        return [self._belief.revise() for _ in range(n_sweeps)][-1]

    @one_blas_thread()
    def predict(self, points_m: ArrayLike) -> Prediction:
        """Returns the belief at any points [m], shape (N, 3)."""
        points = check_points(points_m)
        if len(points) == 0:
            return Prediction(np.zeros(0), np.zeros(0))
        mean, variance = self._belief.moments(points)
        return Prediction(self._offset(points) + mean, variance)

    @one_blas_thread()
    def predict_lattice(self) -> Prediction:
        """Returns the belief at the points of the query lattice that its mask keeps, in C order.

        Raises:
            ValueError: If the map was made without a query lattice.
        """
        if self.query is None or self._lattice_offset is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        mean, variance = self._belief.lattice_moments(self.query)
        mean = self._lattice_offset + mean
        if self._query_mask is None:
            return Prediction(mean, variance)
        return Prediction(mean[self._query_mask], variance[self._query_mask])

    def carry_samples(self, n_samples: int, *, rng: np.random.Generator) -> None:
        """Draws whole maps from the belief and keeps them up with every later reading.

        Args:
            n_samples: How many.
            rng: Source of the draws, now and at every later reading.
        """
        if n_samples < 1:
            raise ValueError(f"n_samples must be at least 1, not {n_samples}")
        self._belief.carry_samples(n_samples, rng)

    @one_blas_thread()
    def sample_lattice(self) -> NDArray[np.float64]:
        """Returns the carried draws of the latent at the points that `predict_lattice` answers for, shape
        (S, N).

        A draw is a whole map: sigma(f) is its probability of occupancy at each point, f > 0 its outline.

        Raises:
            ValueError: If no samples are carried, or the map was made without a query lattice.
        """
        if self.query is None or self._lattice_offset is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        draws = (self._lattice_offset[:, None] + self._belief.lattice_samples(self.query)).T
        return draws if self._query_mask is None else draws[:, self._query_mask]

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the map to one npz file, whole or not at all; carried samples are not kept."""
        lattices: dict[str, NDArray] = {
            f"hinges_{name}_m": axis for name, axis in zip("xyz", self.hinges.axes_m, strict=True)
        }
        if self.query is not None:
            lattices |= {f"query_{name}_m": axis for name, axis in zip("xyz", self.query.axes_m, strict=True)}
        if self._query_mask is not None:
            lattices["query_mask"] = self._query_mask
        write_arrays(
            Path(path),
            {
                "settings": np.array(json.dumps(asdict(self.settings))),
                "hinge_mask": self._features.weight_of_hinge >= 0,
                **lattices,
                **self._belief.state(),
            },
        )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> HilbertMap:
        """Returns a map that `save` wrote.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If the file is damaged, foreign or of another version; the text names file and reason.
        """
        arrays = read_arrays(Path(path))
        try:
            settings = MapSettings(**json.loads(str(arrays["settings"])))
            query = _read_lattice(arrays, "query") if "query_x_m" in arrays else None
            loaded = cls(
                _read_lattice(arrays, "hinges"),
                settings,
                query=query,
                query_mask=arrays.get("query_mask"),
                hinge_mask=arrays["hinge_mask"],
            )
            loaded._belief.restore(arrays)
        except KeyError as error:
            raise ValueError(f"{path} is no whole map: its array {error} is missing") from error
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path} is no whole map: {error}") from error
        return loaded

    def query_points_m(self) -> NDArray[np.float64]:
        """Returns the points [m] that `predict_lattice` answers for, shape (N, 3)."""
        if self.query is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        points = self.query.points_m()
        return points if self._query_mask is None else points[self._query_mask]

    def query_box(self, low_m: ArrayLike, high_m: ArrayLike) -> QueryBox | None:
        """Returns the part of the query lattice in a box, None where it holds no point that is asked for.

        Args:
            low_m: Lowest corner [m], shape (3,).
            high_m: Highest corner [m], shape (3,).

        Raises:
            ValueError: If the map was made without a query lattice.
        """
        if self.query is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        low, high = np.asarray(low_m), np.asarray(high_m)
        kept = [(a >= low[d]) & (a <= high[d]) for d, a in enumerate(self.query.axes_m)]
        is_asked = np.ones(self.query.n_points, bool) if self._query_mask is None else self._query_mask
        index = (
            np.where(is_asked, np.cumsum(is_asked) - 1, -1).reshape(self.query.shape)[np.ix_(*kept)].ravel()
        )
        if not (index >= 0).any():
            return None
        x, y, z = (axis[keep] for axis, keep in zip(self.query.axes_m, kept, strict=True))
        return QueryBox(Lattice((x, y, z)), index >= 0, index[index >= 0])

    def _offset(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = (np.einsum("ni,ni->n", factor, factor) for factor in self._features.along_axes(points_m))
        return prior_offset(self.settings.prior_prevalence, self.settings.weight_variance * x * y * z)

    def _offset_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        x, y, z = (np.einsum("ni,ni->n", factor, factor) for factor in self._features.on_lattice(query))
        variance = self.settings.weight_variance * (x[:, None, None] * y[:, None] * z).ravel()
        return prior_offset(self.settings.prior_prevalence, variance)


def _read_lattice(arrays: Mapping[str, NDArray], name: str) -> Lattice:
    return Lattice((arrays[f"{name}_x_m"], arrays[f"{name}_y_m"], arrays[f"{name}_z_m"]))


def _make_belief(
    features: HingeFeatures,
    settings: MapSettings,
    query: Lattice | None,
    query_mask: NDArray[np.bool_] | None,
) -> Belief:
    if settings.form == "diagonal":
        return DiagonalBelief(features, settings)
    return FullBelief.prior(features, settings, query, query_mask)


def _check_hinges(hinges: Lattice) -> None:
    for name, axis in zip("xyz", hinges.axes_m, strict=True):
        # Coordinates of some decimetres carry rounding of 1e-16 m, a billionth of a spacing at most.
        if axis.size > 2 and np.ptp(np.diff(axis)) > 1e-6 * (axis[1] - axis[0]):
            raise ValueError(
                f"hinges must be evenly spaced along each axis, but {name} has steps {np.diff(axis)}"
            )


def _check_query_mask(query: Lattice | None, mask: ArrayLike | None) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    if query is None:
        raise ValueError("query_mask needs the query lattice that it masks; pass query=Lattice(...) too")
    keep = np.array(mask, dtype=bool)
    if keep.shape != (query.n_points,) or not keep.any():
        raise ValueError(f"query_mask must keep some of {query.n_points} points; it has shape {keep.shape}")
    return keep


def _check_labels(is_occupied: ArrayLike, n_points: int) -> NDArray[np.float64]:
    labels = np.asarray(is_occupied, dtype=np.float64)
    if labels.shape != (n_points,):
        raise ValueError(
            f"is_occupied must hold one label for each of {n_points} points, not shape {labels.shape}"
        )
    if not np.all((labels == 0) | (labels == 1)):
        raise ValueError("is_occupied must hold only False and True (or 0 and 1)")
    return labels
