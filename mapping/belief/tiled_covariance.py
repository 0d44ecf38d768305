"""The covariance of very many weights, kept near its diagonal, so that a reading's cost depends on the cone it holds.

Hinges are grouped in tiles of 4 x 4 x 4. Sigma_ab is kept for tiles a and b that are at most two apart along each axis,
and taken as zero beyond: the posterior correlation halves with every hinge, so what is left out is below 1 % of a
variance. A tile that no reading has touched still holds the prior and takes no memory.

A reading gathers the covariances of its weights into dense blocks, one layer of tiles along x at a time, and scatters
what they fall by.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ..kernel import HingeFeatures
from ..storage import checked_array
from .carried_variance import CarriedVariance
from .kept_covariance import KeptCovariance

# Two tiles reach 8 to 11 hinges; larger tiles would keep more than is needed, smaller ones make more blocks.
_TILE = 4
_RANGE = 2
# Hinges beyond a reading's own, along each axis, that may covary with them: the correlation halves with each.
_MARGIN = 6

Tile = tuple[int, ...]


class TiledCovariance(KeptCovariance):
    """Sigma as panels: the covariances of each touched tile with the tiles around it, shape (64, 64 a b c)."""

    def __init__(
        self, features: HingeFeatures, weight_variance: float, carried: CarriedVariance | None = None
    ) -> None:
        """Starts with independent weights of one variance.

        Args:
            features: The features whose weights these are.
            weight_variance: Variance of each weight before any reading.
            carried: A variance that is to fall along with the covariance; None for none.
        """
        super().__init__(features, carried)
        shape = features.hinges.shape
        self._variance = weight_variance
        self._panels: dict[Tile, NDArray[np.float64]] = {}
        self._grid = tuple(-(-n // _TILE) for n in shape)
        self._is_touched = np.zeros(int(np.prod(self._grid)), dtype=bool)
        self._hinge_of_weight = np.flatnonzero(features.weight_of_hinge >= 0)
        index = np.column_stack(np.unravel_index(self._hinge_of_weight, shape))
        self._tile_of = index // _TILE
        self._tile_id = np.asarray(np.ravel_multi_index(tuple(self._tile_of.T), self._grid))
        self._place = np.asarray(np.ravel_multi_index(tuple((index % _TILE).T), (_TILE,) * 3))

    @property
    def n_bytes(self) -> int:
        """Memory that the panels take, in bytes."""
        return sum(panel.nbytes for panel in self._panels.values())

    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """See `KeptCovariance.among`."""
        return self._product(C, weights, weights)

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
        """See `KeptCovariance.cross`."""
        others = self._may_covary(weights)
        return others, self._product(C, weights, others)

    def settle(self) -> None:
        """See `KeptCovariance.settle`; its tiles are few, and fall at once."""

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.floating], *, sign: float = 1.0) -> None:
        """See `KeptCovariance.lower`."""
        for here, there in self._slabs(weights, weights):
            self._subtract(weights[here], weights[here], sign * (G[here] @ G[here].T))
            if there.stop > here.stop:
                beyond = slice(here.stop, there.stop)
                falls = (sign * G[here]) @ G[beyond].T
                self._subtract(weights[here], weights[beyond], falls)
                self._subtract(weights[beyond], weights[here], falls.T)
        if self._carried is not None:
            self._carried.lower(weights, G, sign=sign)

    def _product(
        self, C: NDArray[np.float64], weights: NDArray[np.intp], others: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """C Sigma, shape (r, m), for the covariances of some weights (k,) with others (m,), both ascending."""
        sums = np.zeros((len(C), len(others)))
        for here, there in self._slabs(weights, others):
            # Directions are local: most of them have nothing in a slab.
            rows = np.flatnonzero(C[:, here].any(axis=1))
            sums[rows, there] += C[rows, here] @ self._between(weights[here], others[there])
        return sums

    def _slabs(self, weights: NDArray[np.intp], others: NDArray[np.intp]) -> Iterator[tuple[slice, slice]]:
        """Yields the weights of each layer of tiles along x, which runs slowest, and the others within range."""
        layers, of_others = self._tile_of[weights, 0], self._tile_of[others, 0]
        for layer in np.unique(layers):
            here = np.searchsorted(layers, [layer, layer + 1])
            there = np.searchsorted(of_others, [layer - _RANGE, layer + _RANGE + 1])
            yield slice(*here.tolist()), slice(*there.tolist())

    def _may_covary(self, weights: NDArray[np.intp]) -> NDArray[np.intp]:
        """The weights themselves, and those near them that some reading has touched, ascending."""
        is_near = np.zeros(self._features.hinges.n_points, dtype=bool)
        is_near[self._hinge_of_weight[weights]] = True
        is_near = maximum_filter(is_near.reshape(self._features.hinges.shape), size=2 * _MARGIN + 1)
        is_wanted = is_near.ravel()[self._hinge_of_weight] & self._is_touched[self._tile_id]
        is_wanted[weights] = True
        return np.flatnonzero(is_wanted)

    def _between(self, weights: NDArray[np.intp], others: NDArray[np.intp]) -> NDArray[np.float64]:
        """The covariances of some weights (k,) with others (m,), shape (k, m); zero where none is kept."""
        block = np.zeros((len(weights), len(others)))
        for tile, rows in self._by_tile(weights):
            panel = self._panels.get(tile)
            if panel is None:
                _, at_row, at_column = np.intersect1d(weights[rows], others, return_indices=True)
                block[rows[at_row], at_column] = self._variance
                continue
            columns, entries = self._entries(tile, others)
            block[np.ix_(rows, columns)] = panel[np.ix_(self._place[weights[rows]], entries)]
        return block

    def _subtract(
        self, weights: NDArray[np.intp], others: NDArray[np.intp], falls: NDArray[np.float64]
    ) -> None:
        """Takes falls (k, m) off the covariances of some weights (k,) with others (m,), where they are kept."""
        for tile, rows in self._by_tile(weights):
            columns, entries = self._entries(tile, others)
            if tile not in self._panels:
                self._keep(tile, self._prior_panel(tile))
            self._panels[tile][np.ix_(self._place[weights[rows]], entries)] -= falls[np.ix_(rows, columns)]

    def _by_tile(self, weights: NDArray[np.intp]) -> Iterator[tuple[Tile, NDArray[np.intp]]]:
        """Yields each tile that holds some of the weights, and which of them it holds."""
        order = np.argsort(self._tile_id[weights], kind="stable")
        ends = np.flatnonzero(np.diff(self._tile_id[weights[order]])) + 1
        for rows in np.split(order, ends):
            yield tuple(self._tile_of[weights[rows[0]]].tolist()), rows

    def _entries(self, tile: Tile, others: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Which of the others lie within a tile's range, and their columns in its panel."""
        low, shape = self._box(tile)
        offsets = self._tile_of[others] - low
        within = np.flatnonzero(np.all((offsets >= 0) & (offsets < shape), axis=1))
        x, y, z = offsets[within].T
        return within, ((x * shape[1] + y) * shape[2] + z) * _TILE**3 + self._place[others[within]]

    def _box(self, tile: Tile) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The lowest of the tiles around a tile, and the number of these tiles along each axis."""
        low = np.maximum(np.array(tile) - _RANGE, 0)
        return low, np.minimum(np.array(tile) + _RANGE + 1, self._grid) - low

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draws of the prior, shape (M, n_samples).

        Raises:
            ValueError: If a reading has been taken in.
        """
        if self._panels:
            raise ValueError("the local form draws only before its first reading; call carry_samples earlier")
        return np.sqrt(self._variance) * rng.standard_normal((self._features.n_weights, n_samples))

    def state(self) -> dict[str, NDArray]:
        """The panels, one array each, and the variance that is carried."""
        panels = {f"panel_{x}_{y}_{z}": panel for (x, y, z), panel in self._panels.items()}
        return panels if self._carried is None else {"carried_variance": self._carried.values, **panels}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over saved panels.

        Raises:
            ValueError: If a panel has another shape or is not finite.
        """
        names = [name for name in state if name.startswith("panel_")]
        panels = {}
        for name in names:
            x, y, z = (int(part) for part in name.split("_")[1:])
            values = np.array(state[name], dtype=np.float64)
            if values.shape != self._prior_panel((x, y, z)).shape or not np.all(np.isfinite(values)):
                raise ValueError(f"its array '{name}' is not finite or has the wrong shape {values.shape}")
            panels[x, y, z] = values
        if self._carried is not None:
            self._carried.values = checked_array(state, "carried_variance", self._carried.values.shape)
        self._panels = {}
        self._is_touched[:] = False
        for tile, panel in panels.items():
            self._keep(tile, panel)

    def _keep(self, tile: Tile, panel: NDArray[np.float64]) -> None:
        self._panels[tile] = panel
        self._is_touched[np.ravel_multi_index(tile, self._grid)] = True

    def _prior_panel(self, tile: Tile) -> NDArray[np.float64]:
        """The prior covariances of a tile with the a x b x c tiles around it, shape (64, 64 a b c)."""
        panel = np.zeros((_TILE**3, int(np.prod(self._box(tile)[1])) * _TILE**3))
        weights = np.flatnonzero(self._tile_id == np.ravel_multi_index(tile, self._grid))
        panel[self._place[weights], self._entries(tile, weights)[1]] = self._variance
        return panel
