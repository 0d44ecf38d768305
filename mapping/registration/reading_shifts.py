"""How far each reading was most likely taken beside where its tip was measured: its labels against those of the others.

A tip that is measured some millimetres off moves all points of its reading alike. Contacts tell the part along the
surface's normal. The shift t across the beam shows where readings of one tumour do not fit each other: given the
others, a place x is tumour with the probability

    q(x) = (n_1(x) + a p_0) / (n_1(x) + n_0(x) + a),   n_y(x) = sum_k c_k exp(-|x - x_k|^2 / (2 h^2)) over labels y,

the mean of a Beta distribution under labels that count by a kernel (Vega-Brown, Doniec and Roy, NIPS 2014; Doherty,
Shan, Wang and Englot, IEEE Transactions on Robotics 35(4), 2019). With y_k the reading's own labels t has the
posterior

    log p(t) = w sum_k c_k log q_{y_k}(x_k + t) - |t|^2 / (2 sigma^2) + const,

of which the mean over a grid is taken. Readings are gone through in turn, each against the others where they now lie.

Going in turn cannot move what fits already: each reading is held where it is by all others, wherever they lie together.
So the readings of one place are then moved together by the c for which they are likeliest,

    sum_i P_i (t_i + c) = 0,   P_i = (I - b_i b_i^T) / sigma^2 + b_i b_i^T / s^2,

with b_i the beam and s what is left of an error along it: that changes no fit among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ..labelled_points import LabelledPoints

Array = NDArray[np.float64]

SPACING_M = 0.002
"""Spacing of the lattice that holds q [m]."""
WIDTH_M = 0.003
"""Width h of the kernel [m]. Wider ones, first or again and again, lead to worse fits."""
REACH_M = 0.012
"""Labels within this distance of a believed label of tumour tell where its rim is [m]."""
STEP_M, N_DEVIATIONS, FARTHEST_M = 0.0015, 2.7, 0.015
"""Largest spacing of the grid of shifts [m], how many standard deviations it reaches, and how far at most [m]."""
PRIOR_LABELS, PREVALENCE = 1.0, 0.2
"""The a labels that each place has from the start, and the share p_0 of tumour among them."""
TEMPER = 0.5
"""The exponent w of the likelihood: q is an estimate from few labels and not the truth."""
ALONG_M = 0.001
"""Standard deviation s of what is left of an error along the beam, where contacts tell, at most [m]."""
CUBE_M = 0.006
"""Readings see one tumour where believed labels of tumour lie in one cube of this side, or in two that touch [m]."""
N_AGAIN = 10
"""Earlier readings that are gone through again after each new one."""


@dataclass(frozen=True, eq=False)
class _Labels:
    """What a reading says, wherever it lies."""

    is_tumour: NDArray[np.bool_]
    counts: Array
    """For how many labels that are surely right each counts."""
    is_believed: NDArray[np.bool_]
    """Which labels of tumour are believed."""


class ReadingShifts:
    """The shifts of an episode's readings across their beams, as they are believed."""

    def __init__(self, deviation_m: float) -> None:
        """Begin without a reading.

        Args:
            deviation_m: Standard deviation sigma of a shift along each direction across the beam, before any label [m].
        """
        self._deviation_m = deviation_m
        self._labels: list[_Labels] = []
        self._shifts_m, self._variances_m2 = np.zeros((0, 3)), np.zeros(0)
        self._turn = 0
        reach_m, step_m = min(N_DEVIATIONS * deviation_m, FARTHEST_M), min(STEP_M, 0.5 * deviation_m)
        n = int(reach_m / step_m)
        steps_m = step_m * np.arange(-n, n + 1)
        both_m = np.stack(np.meshgrid(steps_m, steps_m, indexing="ij"), axis=-1).reshape(-1, 2)
        self._grid_m = both_m[np.linalg.norm(both_m, axis=1) <= reach_m]
        self._margin_m = reach_m + 3.0 * WIDTH_M

    @property
    def shifts_m(self) -> Array:
        """What is to be added to the points of each reading [m], shape (N, 3)."""
        return self._shifts_m

    @property
    def deviation_m(self) -> float:
        """How far readings that were fitted are believed to lie off the others, a root mean square [m]; 0 of none."""
        told_m2 = self._variances_m2[self._variances_m2 > 0.0]
        return float(np.sqrt(told_m2.mean())) if len(told_m2) else 0.0

    def observe(self, readings: Sequence[LabelledPoints], beams: Array) -> None:
        """Believe the shifts of new readings, and some of the earlier ones anew.

        Args:
            readings: All readings as their tips were measured, without a shift; the new ones are the last.
            beams: Direction of each reading's beam, a unit vector, shape (N, 3).
        """
        n_before = len(self._labels)
        self._labels += map(_labels_of, readings[n_before:])
        n_new = len(readings) - n_before
        self._shifts_m = np.concatenate([self._shifts_m, np.zeros((n_new, 3))])
        self._variances_m2 = np.concatenate([self._variances_m2, np.zeros(n_new)])
        points_m = [each.points_m for each in readings]
        for i in (*range(n_before, len(readings)), *self._again(n_before)):
            self._believe(i, points_m, beams[i])
        for group in self._groups(points_m):
            self._move_together(group, beams[group])

    def _again(self, n_before: int) -> list[int]:
        """The earlier readings with a believed label of tumour whose turn it is."""
        told = [i for i, each in enumerate(self._labels[:n_before]) if each.is_believed.any()]
        chosen = [told[(self._turn + k) % len(told)] for k in range(min(N_AGAIN, len(told)))]
        self._turn += len(chosen)
        return chosen

    def _believe(self, i: int, points_m: Sequence[Array], beam: Array) -> None:
        """The mean of one reading's shift across its beam, given all others where they lie."""
        along_m = (self._shifts_m[i] @ beam) * beam
        own_m, own = points_m[i] + along_m, self._labels[i]
        if not len(own_m):
            return
        box = (own_m.min(axis=0) - self._margin_m, own_m.max(axis=0) + self._margin_m)
        others_m, others = self._within(box, points_m, but=i)
        if not others.is_believed.any():
            return
        rims_m = np.concatenate([others_m[others.is_believed], own_m[own.is_believed]])
        is_near = KDTree(rims_m).query(own_m, distance_upper_bound=REACH_M)[0] < np.inf
        if not is_near.any():
            return
        own_m, is_tumour, counts = own_m[is_near], own.is_tumour[is_near], own.counts[is_near]
        box = (own_m.min(axis=0) - self._margin_m, own_m.max(axis=0) + self._margin_m)
        shifts_m = self._grid_m @ _across(beam)
        told = np.zeros(len(shifts_m))
        for log_share, is_own in zip(
            _log_shares(others_m, others, box), (~is_tumour, is_tumour), strict=True
        ):
            cells = ((own_m[is_own] + shifts_m[:, None] - box[0]) / SPACING_M).reshape(-1, 3).T
            told += map_coordinates(log_share, cells, order=1).reshape(len(shifts_m), -1) @ counts[is_own]
        log_p = TEMPER * told - (self._grid_m**2).sum(axis=1) / (2.0 * self._deviation_m**2)
        p = np.exp(log_p - log_p.max())
        p /= p.sum()
        mean_m = p @ shifts_m
        self._shifts_m[i] = mean_m + along_m
        self._variances_m2[i] = p @ ((shifts_m - mean_m) ** 2).sum(axis=1)

    def _within(
        self, box: tuple[Array, Array], points_m: Sequence[Array], *, but: int
    ) -> tuple[Array, _Labels]:
        """The points of all readings but one that lie in a box, and their labels."""
        placed_m = [own_m + t for own_m, t in zip(points_m, self._shifts_m, strict=True)]
        kept = [np.all((own_m >= box[0]) & (own_m <= box[1]), axis=1) for own_m in placed_m]
        kept[but][:] = False
        told = list(zip(self._labels, kept, strict=True))
        return np.concatenate([own_m[is_in] for own_m, is_in in zip(placed_m, kept, strict=True)]), _Labels(
            is_tumour=np.concatenate([each.is_tumour[is_in] for each, is_in in told]),
            counts=np.concatenate([each.counts[is_in] for each, is_in in told]),
            is_believed=np.concatenate([each.is_believed[is_in] for each, is_in in told]),
        )

    def _groups(self, points_m: Sequence[Array]) -> list[NDArray[np.intp]]:
        """The readings that see one tumour, or tumours that some of them see together, as groups of indices."""
        told = zip(points_m, self._shifts_m, self._labels, strict=True)
        seen = [
            np.unique(np.floor((own_m[each.is_believed] + t) / CUBE_M), axis=0) for own_m, t, each in told
        ]
        seers = np.concatenate([np.full(len(cubes), i) for i, cubes in enumerate(seen)])
        cubes, cube = np.unique(np.concatenate(seen), axis=0, return_inverse=True)
        if not len(cubes):
            return []
        touching = KDTree(cubes).query_pairs(1.8, output_type="ndarray")
        n = len(points_m)
        first, second = (
            np.concatenate([seers, n + touching[:, 0]]),
            np.concatenate([n + cube, n + touching[:, 1]]),
        )
        links = sparse.coo_array(
            (np.ones(len(first)), (first, second)), shape=(n + len(cubes), n + len(cubes))
        )
        _, group = connected_components(links, directed=False)
        groups = [np.flatnonzero(group[:n] == each) for each in np.unique(group[seers])]
        return [each for each in groups if len(each) > 1]

    def _move_together(self, group: NDArray[np.intp], beams: Array) -> None:
        """Move readings that fit each other to where they are likeliest together."""
        along = np.einsum("ni,nj->nij", beams, beams)
        along_m = min(ALONG_M, self._deviation_m)
        precisions = (np.eye(3) - along) / self._deviation_m**2 + along / along_m**2
        pull = np.einsum("nij,nj->i", precisions, self._shifts_m[group])
        self._shifts_m[group] -= np.linalg.solve(precisions.sum(axis=0), pull)


def _labels_of(reading: LabelledPoints) -> _Labels:
    """What a reading says."""
    counts: Array = np.ones(len(reading.points_m)) if reading.weight is None else reading.weight
    if reading.log_odds is not None:
        # By how much the label that is told is the likelier one, of two that are as likely beforehand.
        told = np.where(reading.is_occupied, reading.log_odds, -reading.log_odds)
        counts = counts * np.tanh(np.maximum(told, 0.0) / 2.0)
    return _Labels(reading.is_occupied, counts, reading.is_believed_tumour(0.0))


def _across(beam: Array) -> Array:
    """Two unit vectors across a beam and each other, shape (2, 3)."""
    first = np.cross(beam, np.eye(3)[np.argmin(np.abs(beam))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(beam, first)], dtype=np.float64)


def _log_shares(points_m: Array, labels: _Labels, box: tuple[Array, Array]) -> tuple[Array, Array]:
    """The logarithms of 1 - q and of q on a lattice that fills a box, shapes (A, B, C)."""
    shape = tuple(np.ceil((box[1] - box[0]) / SPACING_M).astype(int) + 1)
    cells = np.rint((points_m - box[0]) / SPACING_M).astype(int)
    is_inside = np.all((cells >= 0) & (cells < shape), axis=1)
    width = WIDTH_M / SPACING_M
    n = []
    for is_label in (~labels.is_tumour, labels.is_tumour):
        kept = is_inside & is_label
        place = np.ravel_multi_index(tuple(cells[kept].T), shape)
        n_at = np.bincount(place, weights=labels.counts[kept], minlength=int(np.prod(shape))).reshape(shape)
        # The filter's weights add up to 1, and the kernel of a label is 1 at its middle.
        n_at = gaussian_filter(n_at.astype(np.float32), width, truncate=3.0, mode="constant")
        n.append((2.0 * np.pi) ** 1.5 * width**3 * n_at)
    whole = n[0] + n[1] + PRIOR_LABELS
    return (
        np.log((n[0] + PRIOR_LABELS * (1.0 - PREVALENCE)) / whole),
        np.log((n[1] + PRIOR_LABELS * PREVALENCE) / whole),
    )
