"""Actions that are spent on registering: the probe goes where a contact tells most of where the organ lies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .situation import Situation


def registering_first(ranking: Iterator[int], situation: Situation) -> Iterator[int]:
    """The poses of a ranking, or those where a contact tells most of the place as long as that is uncertain.

    Args:
        ranking: The poses of a planner, best first.
        situation: What is known so far.

    Yields:
        Indices of poses, best first, each at most once.
    """
    place = situation.place
    if place is None or place.deviation_m <= place.register_above_m:
        yield from ranking
        return
    is_open = situation.available(exclude_sensed=True)
    order = np.argsort(-place.contact_gains_m2(), kind="stable")
    yield from (int(pose) for pose in order[is_open[order]])
