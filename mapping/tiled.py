"""The covariance of very many weights, kept near its diagonal: what a reading costs depends on the cone,
not the organ.

Hinges are grouped in tiles of 4 x 4 x 4. Sigma_ab is kept for tiles at most two apart along each axis, and
taken as zero
beyond: the posterior correlation halves with every hinge, so what is left out is below 1 % of a variance. A
tile that no reading has touched still holds the prior and takes no memory.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .carried_variance import CarriedVariance
from .kept_covariance import KeptCovariance
from .kernel import HingeFeatures
from .storage import checked_array

# 64 weights a tile are enough for matrix products to run at speed; two tiles reach 8 to 11 hinges.
_TILE = 4
_RANGE = 2

TileBox = tuple[slice, ...]


class TiledCovariance(KeptCovariance):
    """Sigma as panels: the covariances of each touched tile with the tiles around it."""

    def __init__(
        self, features: HingeFeatures, weight_variance: float, carried: CarriedVariance | None = None
    ) -> None:
        """Starts with independent weights of one variance."""
        super().__init__(features, carried)
        shape = features.hinges.shape
        self._n_weights = features.n_weights
        self._variance = weight_variance
        self._grid = tuple(-(-n // _TILE) for n in shape)
        self._panels: dict[tuple[int, ...], NDArray[np.float64]] = {}
        # Weight of each place in a tile, -1 where the lattice or its mask has none.
        padded = np.full([n * _TILE for n in self._grid], -1, dtype=np.intp)
        padded[: shape[0], : shape[1], : shape[2]] = features.weight_of_hinge.reshape(shape)
        gx, gy, gz = self._grid
        split = padded.reshape(gx, _TILE, gy, _TILE, gz, _TILE)
        self._weight_at = split.transpose(0, 2, 4, 1, 3, 5).reshape(gx, gy, gz, _TILE**3)
        self._place = np.empty(self._n_weights, dtype=np.intp)
        flat = self._weight_at.ravel()
        self._place[flat[flat >= 0]] = np.flatnonzero(flat >= 0)

    @property
    def n_bytes(self) -> int:
        """Memory that the panels take."""
        return sum(panel.nbytes for panel in self._panels.values())

    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """See `KeptCovariance.among`."""
        columns, cross = self._cross(C, weights, margin=0)
        return cross[:, np.searchsorted(columns, weights)]

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns the weights (m,) that may covary with some weights (k,), ascending, and C Sigma, shape
        (r, m).
        """
        return self._cross(C, weights, margin=1)

    def _cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp], *, margin: int
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        window, tiled = self._lay_out(C, weights, margin=margin)
        sums = np.zeros_like(tiled)
        low = [part.start for part in window]
        for tile in np.argwhere(np.any(tiled != 0, axis=(0, 4))):
            here = tuple(int(t + start) for t, start in zip(tile, low, strict=True))
            rows = tiled[:, tile[0], tile[1], tile[2]]
            panel = self._panels.get(here)
            if panel is None:
                sums[:, tile[0], tile[1], tile[2]] += self._variance * rows
                continue
            inside, within = self._overlap(here, window)
            block = panel[:, *within]
            sums[:, *inside] += (rows @ block.reshape(len(block), -1)).reshape(len(C), *block.shape[1:])
        return self._gather(sums, window)

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes sign G G^T off the covariance of some weights (k,), G of shape (k, s), as far as it is
        kept.
        """
        window, tiled = self._lay_out(G.T, weights, margin=0)
        low = [part.start for part in window]
        for tile in np.argwhere(np.any(tiled != 0, axis=(0, 4))):
            here = tuple(int(t + start) for t, start in zip(tile, low, strict=True))
            inside, within = self._overlap(here, window)
            others = tiled[:, *inside]
            falls = sign * tiled[:, tile[0], tile[1], tile[2]].T @ others.reshape(len(others), -1)
            self._panel(here)[:, *within] -= falls.reshape(-1, *others.shape[1:])
        if self._carried is not None:
            self._carried.lower(weights, G, sign=sign)

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Returns draws of the prior, shape (M, n_samples).

        Raises:
            ValueError: If a reading has been taken in.
        """
        if self._panels:
            raise ValueError("the local form draws only before its first reading; call carry_samples earlier")
        return np.sqrt(self._variance) * rng.standard_normal((self._n_weights, n_samples))

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Returns the panels, one array each, and the variance that is carried."""
        panels = {f"panel_{x}_{y}_{z}": panel for (x, y, z), panel in self._panels.items()}
        return panels if self._carried is None else {"carried_variance": self._carried.values, **panels}

    def restore(self, state: Mapping[str, NDArray[np.float64]]) -> None:
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
        self._panels = panels

    def _panel(self, tile: tuple[int, ...]) -> NDArray[np.float64]:
        if tile not in self._panels:
            self._panels[tile] = self._prior_panel(tile)
        return self._panels[tile]

    def _prior_panel(self, tile: tuple[int, ...]) -> NDArray[np.float64]:
        """Returns the prior covariances of a tile with those around it, shape (64, a, b, c, 64)."""
        low = [max(0, t - _RANGE) for t in tile]
        shape = [min(n, t + _RANGE + 1) - start for n, t, start in zip(self._grid, tile, low, strict=True)]
        panel = np.zeros((_TILE**3, *shape, _TILE**3))
        places = np.flatnonzero(self._weight_at[tile] >= 0)
        panel[places, tile[0] - low[0], tile[1] - low[1], tile[2] - low[2], places] = self._variance
        return panel

    def _overlap(self, tile: tuple[int, ...], window: TileBox) -> tuple[TileBox, TileBox]:
        """Returns where a tile's panel and a window of tiles meet, counted in the window and in the panel."""
        inside, within = [], []
        for n, t, part in zip(self._grid, tile, window, strict=True):
            first = max(0, t - _RANGE)
            low, high = max(first, part.start), min(n, t + _RANGE + 1, part.stop)
            inside.append(slice(low - part.start, high - part.start))
            within.append(slice(low - first, high - first))
        return tuple(inside), tuple(within)

    def _lay_out(
        self, columns: NDArray[np.float64], weights: NDArray[np.intp], *, margin: int
    ) -> tuple[TileBox, NDArray[np.float64]]:
        """Returns the box of tiles around some weights, and columns (r, k) laid out over it, (r, x, y, z,
        64).
        """
        places = self._place[weights]
        tiles = np.unravel_index(places // _TILE**3, self._grid)
        window = tuple(
            slice(max(0, int(index.min()) - margin), min(n, int(index.max()) + 1 + margin))
            for index, n in zip(tiles, self._grid, strict=True)
        )
        tiled = np.zeros((len(columns), *(part.stop - part.start for part in window), _TILE**3))
        x, y, z = (index - part.start for index, part in zip(tiles, window, strict=True))
        tiled[:, x, y, z, places % _TILE**3] = columns
        return window, tiled

    def _gather(
        self, tiled: NDArray[np.float64], window: TileBox
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns the weights of a window, ascending, and their columns."""
        weights = self._weight_at[window].ravel()
        columns = np.flatnonzero(weights >= 0)
        columns = columns[np.argsort(weights[columns])]
        return weights[columns], tiled.reshape(len(tiled), -1)[:, columns]
