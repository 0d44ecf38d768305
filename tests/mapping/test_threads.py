"""A reading uses one BLAS thread and leaves the caller's setting as it was."""

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((0.0, 0.0, 0.0), (0.04, 0.04, 0.04))


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_a_reading_runs_on_one_thread_and_gives_the_others_back(monkeypatch):
    seen = []
    tumour_map = HilbertMap(Lattice.from_box(*BOX_M, spacing_m=0.01125), MapSettings())
    learn = tumour_map.belief.learn
    monkeypatch.setattr(
        tumour_map.belief, "learn", lambda *reading: seen.append(blas_threads()) or learn(*reading)
    )
    with threadpool_limits(2, user_api="blas"):
        tumour_map.update(np.full((3, 3), 0.02), [True, False, True])
        assert blas_threads() == {2}
    assert seen == [{1}]
