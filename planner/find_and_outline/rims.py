"""Rims: places in doubt at the edge of what was found, where another view would move the outline towards the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..situation import Situation
from ..visibility import visibility
from .fine_lattice import FineLattice
from .frontier import seen_weight

_IN_DOUBT = 0.05
"""Places of a probability between this and one minus this are in doubt."""


def rim_score(
    situation: Situation, lattice: FineLattice, probability: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The volume that each pose is expected to put right at rims that views draw apart [m^3], shape (N,).

        rim = v sum over places x in doubt in the pose's cone of  min(p, 1 - p) (1 - sqrt(n / (n + 1)))

    v is the volume of a cell, and n the number of cones that x lay in. Where each view's outline strays by itself, the
    error of their mean falls as 1 / sqrt(n), and with it the volume on the wrong side, min(p, 1 - p) of the cell.
    Places that no view saw yet are none of this. Zero where views miss nothing, and so draw no outline either.

    Args:
        situation: What is known so far.
        lattice: The fine points.
        probability: The probability of tumour at them, shape (F,).
    """
    workspace, cone = situation.workspace, situation.cone
    in_doubt = np.flatnonzero((probability > _IN_DOUBT) & (probability < 1.0 - _IN_DOUBT))
    if situation.missed_rate == 0.0 or not in_doubt.size or not situation.sensed:
        return np.zeros(workspace.n_poses)
    points_m, chance = lattice.points_m[in_doubt], probability[in_doubt]
    n_views = visibility(workspace.part(situation.sensed), cone, points_m).sum(axis=1)
    put_right = np.where(n_views > 0, 1.0 - np.sqrt(n_views / (n_views + 1.0)), 0.0)
    weights = np.minimum(chance, 1.0 - chance) * put_right
    return lattice.cell_m3 * seen_weight(workspace, cone, points_m, weights)
