"""Connected regions: which poses an arm reaches from each other without taking the probe off the organ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner import Workspace
from sim.world.ik.search import IkSearch
from sim.world.ik.slide_field import slide_field


def contact_regions(
    search: IkSearch,
    workspace: Workspace,
    q: NDArray[np.float64],
    is_reached: NDArray[np.bool_],
    score: NDArray[np.float64],
) -> NDArray[np.int64]:
    """The region of each reached pose, numbered by falling size from 0, and -1 where not reached, shape (N,).

    Args:
        search: Solves for the arm.
        workspace: The N poses.
        q: Joint positions of the chain at the poses, shape (N, n).
        is_reached: Which poses are reached, shape (N,).
        score: Score of each pose, shape (N,); regions start at the highest.
    """
    return slide_field(search, workspace, q, is_reached, score).region
