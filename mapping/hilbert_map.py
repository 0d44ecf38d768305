"""The sequential Bayesian Hilbert map (section IV-B of the paper): readings in, probability of occupancy out.

    P(y = 1 | x, w) = sigma(f(x)),   f(x) = b(x) + phi(x) . w,   w ~ N(mu, Sigma)

The paper's likelihood is sigma(w Psi^T(x)), without the offset b(x). Here b(x) makes the prior expect
`prior_prevalence` at every point; with a prevalence of 1/2, which is what the paper's prior says, b is zero.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .belief.belief import Belief, UpdateReport
from .belief.diagonal import DiagonalBelief
from .belief.full import FullBelief
from .kernel import HingeFeatures
from .labelled_points import check_labels
from .lattice import Lattice, MaskedLattice, check_points, lattice_from, lattice_state
from .likelihood import evidence_of, prior_offset
from .prediction import Prediction
from .settings import MapSettings
from .storage import HILBERT_MAP, naming_the_file, read_arrays, write_arrays
from .threads import one_blas_thread


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
            query: Lattice on which `predict_lattice` answers; what that costs does not grow with the readings.
            query_mask: Which points of `query` it answers for, shape (query.n_points,); all if None.
            hinge_mask: Which hinges are kept, shape (hinges.n_points,); all if None. Keep every hinge
                within four spacings of the organ, since the prior counts on the others being there.

        Raises:
            ValueError: If a mask does not fit its lattice, keeps nothing, or masks a query that is not there.
        """
        _check_hinges(hinges)
        if query is None and query_mask is not None:
            raise ValueError("query_mask needs the query lattice that it masks; pass query=Lattice(...) too")
        self.hinges = hinges
        self.settings = settings if settings is not None else MapSettings()
        mask = None if query_mask is None else np.asarray(query_mask, dtype=bool)
        self._query = None if query is None else MaskedLattice(query, mask)
        hinge_mask = None if hinge_mask is None else np.asarray(hinge_mask, dtype=bool)
        self._features = HingeFeatures.build(hinges, self.settings.gamma_per_m2, hinge_mask)
        self._lattice_offset = np.zeros(0) if query is None else self._offset_on_lattice(query)
        self._belief = _make_belief(self._features, self.settings, self._query)

    @property
    def n_weights(self) -> int:
        """Number of hinges that are kept, M."""
        return self._features.n_weights

    @property
    def belief(self) -> Belief:
        """The belief over the weights."""
        return self._belief

    @property
    def query(self) -> MaskedLattice:
        """The lattice, with its mask, whose points `predict_lattice` answers for.

        Raises:
            ValueError: If the map was made without a query lattice.
        """
        if self._query is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        return self._query

    @one_blas_thread()
    def update(
        self,
        points_m: ArrayLike,
        is_occupied: ArrayLike,
        *,
        log_odds: ArrayLike | None = None,
        weight: ArrayLike | None = None,
    ) -> UpdateReport:
        """Takes in a reading: learns from labelled points (the paper's learn_parameters).

        Args:
            points_m: Sensed points [m], shape (n, 3); n may be 0.
            is_occupied: Their labels, shape (n,), True (1) for tumour.
            log_odds: How far each can be believed, log P(label | tumour) / P(label | free), shape (n,); if None, as the
                settings' rates of false labels say.
            weight: How many labels each counts for, shape (n,), above 0 and at most 1; if None, each counts in full.

        Raises:
            ValueError: If shapes differ, a point is not finite, a label is neither 0 nor 1, log odds are no number, or
                a weight is out of its range.
        """
        points = check_points(points_m)
        labels = check_labels(is_occupied, len(points))
        rates = self.settings.false_positive_rate, self.settings.false_negative_rate
        evidence = evidence_of(labels, rates, log_odds, weight)
        if len(points) == 0:
            return UpdateReport(n_points=0, n_occupied=0, rank=0, n_weights_touched=0, curvature=np.zeros(0))
        report = self._belief.learn(points, self._offset(points), evidence)
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
        readings. Sweeps move the map to the posterior of all readings at once, on which the order has no
        influence.

        Args:
            n_sweeps: How often all readings are gone through; each costs as much as an update per reading.

        Returns:
            The largest change of the latent's mean at a sensed point in the last sweep.

        Raises:
            ValueError: If the form is diagonal.
        """
        return [self._belief.revise() for _ in range(n_sweeps)][-1]

    @one_blas_thread()
    def lay(self, points_m: Sequence[NDArray[np.float64]]) -> bool:
        """Has the readings so far lie elsewhere, at the cost of some four of them however many they are.

        Each label keeps what it says, with the xi and the expected truth with which it was taken in.

        Args:
            points_m: Where the points of each reading now lie [m], shapes (n, 3), in their order.

        Returns:
            Whether it did. A map that is not of the form `full`, or of which a reading lay beyond all hinges, cannot
            and stays as it is.
        """
        some = [check_points(each) for each in points_m if len(each)]
        return self._belief.lay(some, [self._offset(each) for each in some])

    @one_blas_thread()
    def settle(self) -> None:
        """Does now what `update` has left for the next: a fifth to a third of it, on which no answer depends.

        Who never calls this gets the same maps. Who answers somebody after each reading calls it once that is done.
        """
        self._belief.settle()

    @one_blas_thread()
    def predict(self, points_m: ArrayLike) -> Prediction:
        """The belief at any points [m], shape (N, 3)."""
        points = check_points(points_m)
        if len(points) == 0:
            return Prediction(np.zeros(0), np.zeros(0))
        mean, variance = self._belief.moments(points)
        return Prediction(self._offset(points) + mean, variance)

    @one_blas_thread()
    def predict_lattice(self) -> Prediction:
        """The belief at the points of the query lattice that its mask keeps, in C order.

        Raises:
            ValueError: If the map was made without a query lattice.
        """
        query = self.query
        mean, variance = self._belief.lattice_moments(query.lattice)
        return Prediction(query.kept(self._lattice_offset + mean), query.kept(variance))

    def carry_samples(self, n_samples: int, *, rng: np.random.Generator) -> None:
        """Draws whole maps from the belief and moves them with every later reading.

        Args:
            n_samples: Number of draws, S.
            rng: Source of the draws, now and at every later reading.

        Raises:
            ValueError: If n_samples is below 1, or the form is local and has taken in a reading.
        """
        if n_samples < 1:
            raise ValueError(f"n_samples must be at least 1, not {n_samples}")
        self._belief.carry_samples(n_samples, rng)

    @one_blas_thread()
    def sample_lattice(self) -> NDArray[np.float64]:
        """The carried draws of the latent at the points that `predict_lattice` answers for, shape (S, N).

        A draw is a whole map: sigma(f) is its probability of occupancy at each point, f > 0 its outline.

        Raises:
            ValueError: If no samples are carried, or the map was made without a query lattice.
        """
        query = self.query
        draws = self._lattice_offset[:, None] + self._belief.lattice_samples(query.lattice)
        return query.kept(draws.T)

    def query_points_m(self) -> NDArray[np.float64]:
        """The points [m] that `predict_lattice` answers for, shape (N, 3).

        Raises:
            ValueError: If the map was made without a query lattice.
        """
        return self.query.points_m()

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the map to one npz file, whole or not at all; carried samples are not kept."""
        write_arrays(Path(path), HILBERT_MAP, self.state())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> HilbertMap:
        """The map that `save` wrote; given further readings it goes on as if it had never been saved.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If the file is damaged, foreign or of another version; the text names file and reason.
        """
        _, arrays = read_arrays(Path(path), HILBERT_MAP)
        with naming_the_file(Path(path)):
            return cls.from_state(arrays)

    def state(self) -> dict[str, NDArray]:
        """The arrays that make up the map, as a file holds them; carried samples are not among them."""
        lattices = lattice_state("hinges", self.hinges)
        if self._query is not None:
            lattices |= lattice_state("query", self._query.lattice)
            if self._query.mask is not None:
                lattices["query_mask"] = self._query.mask
        return {
            "settings": np.array(json.dumps(asdict(self.settings))),
            "hinge_mask": self._features.weight_of_hinge >= 0,
            **lattices,
            **self._belief.state(),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, NDArray]) -> HilbertMap:
        """The map whose arrays `state` gave.

        Raises:
            KeyError: If an array is missing.
            ValueError: If arrays do not fit together or a value is out of its range.
            TypeError: If the settings are not those of a map.
        """
        restored = cls(
            lattice_from(state, "hinges"),
            MapSettings(**json.loads(str(state["settings"]))),
            query=lattice_from(state, "query") if "query_x_m" in state else None,
            query_mask=state.get("query_mask"),
            hinge_mask=state["hinge_mask"],
        )
        restored._belief.restore(state)
        return restored

    def _offset(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The offset b at points [m], shape (N, 3): v_0(x) = s^2 |phi(x)|^2 is the prior variance there."""
        x, y, z = (np.einsum("ni,ni->n", factor, factor) for factor in self._features.along_axes(points_m))
        return prior_offset(self.settings.prior_prevalence, self.settings.weight_variance * x * y * z)

    def _offset_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        x, y, z = (np.einsum("ni,ni->n", factor, factor) for factor in self._features.on_lattice(query))
        variance = self.settings.weight_variance * (x[:, None, None] * y[:, None] * z).ravel()
        return prior_offset(self.settings.prior_prevalence, variance)


def _make_belief(features: HingeFeatures, settings: MapSettings, query: MaskedLattice | None) -> Belief:
    if settings.form == "diagonal":
        return DiagonalBelief(features, settings)
    return FullBelief.prior(features, settings, query)


def _check_hinges(hinges: Lattice) -> None:
    for name, axis in zip("xyz", hinges.axes_m, strict=True):
        # Coordinates of some decimetres carry rounding of 1e-16 m, a billionth of a spacing at most.
        if axis.size > 2 and np.ptp(np.diff(axis)) > 1e-6 * (axis[1] - axis[0]):
            raise ValueError(
                f"hinges must be evenly spaced along each axis, but {name} has steps {np.diff(axis)}"
            )
