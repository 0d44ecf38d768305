"""How far each reading was most likely taken beside where its tip was measured: its labels against those of the others.

A tip that is measured some millimetres off moves all points of its reading alike. Contacts tell the part along the
surface's normal. The shift t along the surface shows where readings of one tumour do not fit each other: given the
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
"""Labels within this distance of a label of tumour tell where its rim is, and such readings see one tumour [m]."""
STEP_M, N_DEVIATIONS = 0.0015, 2.7
"""Spacing of the grid of shifts [m], and how many standard deviations it reaches."""
PRIOR_LABELS, PREVALENCE = 1.0, 0.2
"""The a labels that each place has from the start, and the share p_0 of tumour among them."""
TEMPER = 0.5
"""The exponent w of the likelihood: q is an estimate from few labels and not the truth."""
ALONG_M = 0.001
"""Standard deviation s of what is left of an error along the beam, where contacts tell [m]."""
CUBE_M = 0.005
"""One label of tumour in each cube of this side tells which readings see the same tumour [m]."""
N_AGAIN = 10
"""Earlier readings that are gone through again after each new one."""


class ReadingShifts:
    """The shifts of an episode's readings along the surface, as they are believed."""

    def __init__(self, deviation_m: float) -> None:
        """Begin without a reading.

        Args:
            deviation_m: Standard deviation sigma of a shift along each direction of the surface, before any label [m].
        """
        self._deviation_m = deviation_m
        self._shifts_m, self._variances_m2 = np.zeros((0, 3)), np.zeros(0)
        self._turn = 0
        n = int(N_DEVIATIONS * deviation_m / STEP_M)
        steps_m = STEP_M * np.arange(-n, n + 1)
        both_m = np.stack(np.meshgrid(steps_m, steps_m, indexing="ij"), axis=-1).reshape(-1, 2)
        self._grid_m = both_m[np.linalg.norm(both_m, axis=1) <= N_DEVIATIONS * deviation_m]

    @property
    def shifts_m(self) -> Array:
        """What is to be added to the points of each reading [m], shape (N, 3)."""
        return self._shifts_m

    @property
    def deviation_m(self) -> float:
        """How far readings are still believed to be off along the surface, a root mean square [m]."""
        return float(np.sqrt(self._variances_m2.mean())) if len(self._variances_m2) else 0.0

    def observe(self, readings: Sequence[LabelledPoints], beams: Array) -> None:
        """Believe the shifts of new readings, and some of the earlier ones anew.

        Args:
            readings: All readings as their tips were measured, without a shift; the new ones are the last.
            beams: Direction of each reading's beam, a unit vector, shape (N, 3).
        """
        n_before, n_new = len(self._shifts_m), len(readings) - len(self._shifts_m)
        self._shifts_m = np.concatenate([self._shifts_m, np.zeros((n_new, 3))])
        self._variances_m2 = np.concatenate([self._variances_m2, np.full(n_new, 2.0 * self._deviation_m**2)])
        for i in (*range(n_before, len(readings)), *self._again(readings[:n_before])):
            self._believe(i, readings, beams[i])
        for group in _groups(readings, self._shifts_m):
            self._move_together(group, beams[group])

    def _again(self, readings: Sequence[LabelledPoints]) -> list[int]:
        """The earlier readings with a label of tumour whose turn it is."""
        told = [i for i, each in enumerate(readings) if each.is_occupied.any()]
        chosen = [told[(self._turn + k) % len(told)] for k in range(min(N_AGAIN, len(told)))]
        self._turn += len(chosen)
        return chosen

    def _believe(self, i: int, readings: Sequence[LabelledPoints], beam: Array) -> None:
        """The mean of one reading's shift along the surface, given all others where they lie."""
        along_m = (self._shifts_m[i] @ beam) * beam
        own_m, is_tumour = readings[i].points_m + along_m, readings[i].is_occupied
        others = [each for j, each in enumerate(readings) if j != i]
        shifts_m = np.delete(self._shifts_m, i, axis=0)
        points_m = np.concatenate(
            [each.points_m + t for each, t in zip(others, shifts_m, strict=True)] or [own_m[:0]]
        )
        labels = np.concatenate([each.is_occupied for each in others] or [is_tumour[:0]])
        if not labels.any():
            return
        rims_m = np.concatenate([points_m[labels], own_m[is_tumour]])
        is_near = KDTree(rims_m).query(own_m, distance_upper_bound=REACH_M)[0] < np.inf
        if not is_near.any():
            return
        counts = np.concatenate([_counts(each) for each in others])
        own_m, is_tumour, own_counts = own_m[is_near], is_tumour[is_near], _counts(readings[i])[is_near]
        margin_m = N_DEVIATIONS * self._deviation_m + 3.0 * WIDTH_M
        box = (own_m.min(axis=0) - margin_m, own_m.max(axis=0) + margin_m)
        log_shares = _log_shares(points_m, labels, counts, box)
        shifts_m = self._grid_m @ _across(beam)
        told = np.zeros(len(shifts_m))
        for log_share, is_own in zip(log_shares, (~is_tumour, is_tumour), strict=True):
            cells = ((own_m[is_own] + shifts_m[:, None] - box[0]) / SPACING_M).reshape(-1, 3).T
            told += map_coordinates(log_share, cells, order=1).reshape(len(shifts_m), -1) @ own_counts[is_own]
        log_p = TEMPER * told - (self._grid_m**2).sum(axis=1) / (2.0 * self._deviation_m**2)
        p = np.exp(log_p - log_p.max())
        p /= p.sum()
        mean_m = p @ shifts_m
        self._shifts_m[i] = mean_m + along_m
        self._variances_m2[i] = p @ ((shifts_m - mean_m) ** 2).sum(axis=1)

    def _move_together(self, group: NDArray[np.intp], beams: Array) -> None:
        """Move readings that fit each other to where they are likeliest together."""
        along = np.einsum("ni,nj->nij", beams, beams)
        precisions = (np.eye(3) - along) / self._deviation_m**2 + along / ALONG_M**2
        pull = np.einsum("nij,nj->i", precisions, self._shifts_m[group])
        self._shifts_m[group] -= np.linalg.solve(precisions.sum(axis=0), pull)


def _counts(reading: LabelledPoints) -> Array:
    """For how many labels that are surely right each counts, shape (K,)."""
    counts: Array = np.ones(len(reading.points_m)) if reading.weight is None else reading.weight
    if reading.log_odds is not None:
        # By how much the label that is told is the likelier one, of two that are as likely beforehand.
        counts = counts * np.tanh(np.abs(reading.log_odds) / 2.0, dtype=np.float64)
    return counts


def _across(beam: Array) -> Array:
    """Two unit vectors across a beam and each other, shape (2, 3)."""
    first = np.cross(beam, np.eye(3)[np.argmin(np.abs(beam))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(beam, first)], dtype=np.float64)


def _groups(readings: Sequence[LabelledPoints], shifts_m: Array) -> list[NDArray[np.intp]]:
    """The readings that see one tumour, or tumours that some of them see together, as groups of indices."""
    seen_m = [each.points_m[each.is_occupied] + t for each, t in zip(readings, shifts_m, strict=True)]
    seers = np.concatenate([np.full(len(points_m), i) for i, points_m in enumerate(seen_m)])
    points_m = np.concatenate(seen_m)
    cubes = np.column_stack([seers, np.floor(points_m / CUBE_M)]).astype(int)
    _, first = np.unique(cubes, axis=0, return_index=True)
    if not len(first):
        return []
    seers = seers[first]
    pairs = KDTree(points_m[first]).query_pairs(REACH_M, output_type="ndarray")
    links = (np.ones(len(pairs)), (seers[pairs[:, 0]], seers[pairs[:, 1]]))
    n = len(readings)
    _, group = connected_components(sparse.coo_array(links, shape=(n, n)), directed=False)
    groups = [np.flatnonzero(group == each) for each in np.unique(group[seers])]
    return [each for each in groups if len(each) > 1]


def _log_shares(
    points_m: Array, labels: NDArray[np.bool_], counts: Array, box: tuple[Array, Array]
) -> tuple[Array, Array]:
    """The logarithms of 1 - q and of q on a lattice that fills a box, shapes (A, B, C)."""
    shape = tuple(np.ceil((box[1] - box[0]) / SPACING_M).astype(int) + 1)
    cells = np.rint((points_m - box[0]) / SPACING_M).astype(int)
    is_inside = np.all((cells >= 0) & (cells < shape), axis=1)
    width = WIDTH_M / SPACING_M
    n = []
    for is_label in (~labels, labels):
        kept = is_inside & is_label
        place = np.ravel_multi_index(tuple(cells[kept].T), shape)
        n_at = np.bincount(place, weights=counts[kept], minlength=int(np.prod(shape))).reshape(shape)
        # The filter's weights add up to 1, and the kernel of a label is 1 at its middle.
        n_at = gaussian_filter(n_at.astype(np.float32), width, truncate=3.0, mode="constant")
        n.append((2.0 * np.pi) ** 1.5 * width**3 * n_at)
    whole = n[0] + n[1] + PRIOR_LABELS
    return (
        np.log((n[0] + PRIOR_LABELS * (1.0 - PREVALENCE)) / whole),
        np.log((n[1] + PRIOR_LABELS * PREVALENCE) / whole),
    )
