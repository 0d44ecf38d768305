"""Time stamps of a service's reports, and who learns whether a report was taken."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.live.errors import RefusedError
from sim.live.reports import PointsSensed, PoseDeclined, TipMoved
from sim.live.service import MOST_TIPS, MOST_WAITING, Service, ServiceSettings


def declined(stamp_s):
    return PoseDeclined(pose_index=0, reason="", stamp_s=stamp_s)


def served():
    return Service(SimpleNamespace(organ=None), lambda snapshot: None, clock=lambda: 100.0)


def test_a_report_without_a_stamp_is_taken_whatever_clock_the_outside_has() -> None:
    service = served()
    service.take(declined(101.0))
    service.take(declined(None))
    # Nor does it make a clock that is late old.
    with pytest.raises(RefusedError, match="older than one that came before"):
        service.take(declined(100.5))
    late = served()
    late.take(declined(None))
    late.take(declined(99.0))
    assert not service.refused
    assert not late.refused


def test_who_asks_learns_that_too_many_wait() -> None:
    service = served()
    for _ in range(MOST_WAITING):
        service.take(declined(None))
    with pytest.raises(RefusedError, match="waiting already"):
        service.take(declined(None))
    assert not service.refused
    service.submit(declined(None))
    assert service.refused == {"too many": 1}


class Session:
    """A session that keeps where each reading was taken."""

    def __init__(self) -> None:
        bounds_m = (np.full(3, -0.1), np.full(3, 0.1))
        solid = SimpleNamespace(
            bounds_m=bounds_m, contains=lambda points_m: np.ones(len(points_m), dtype=bool)
        )
        self.organ, self.xs_m = SimpleNamespace(organ=solid), []

    def observe(self, reading) -> None:
        self.xs_m.append(reading.T_world_probe[0, 3])


def tip(x_m, stamp_s):
    T = np.eye(4)
    T[0, 3] = x_m
    return TipMoved(T_world_probe=T, stamp_s=stamp_s)


def points(stamp_s):
    return PointsSensed(points_m=np.zeros((1, 3)), is_occupied=np.zeros(1, dtype=bool), stamp_s=stamp_s)


@pytest.mark.parametrize(("stale_s", "step_s"), [(60.0, 0.03), (2.0, 0.0005), (600.0, 0.01)])
def test_a_reading_that_comes_late_is_of_the_tip_of_its_time(stale_s, step_s) -> None:
    """The tip moves on by a millimetre a second, and the reading comes when it is almost stale."""
    now_s, session = [1000.0], Session()
    service = Service(
        session, lambda snapshot: None, ServiceSettings(stale_s=stale_s), clock=lambda: now_s[0]
    )
    stamps_s = 1000.0 + step_s * np.arange(int(0.9 * stale_s / step_s))
    for stamp_s in stamps_s:
        now_s[0] = stamp_s
        service.take(tip(1e-3 * (stamp_s - 1000.0), stamp_s))
    service.take(points(1000.0 + 0.1 * stale_s))
    service._work_off(*service._waiting.get())
    apart_s = max(step_s, 2.0 * stale_s / MOST_TIPS)
    assert session.xs_m == pytest.approx([1e-4 * stale_s], abs=1e-3 * apart_s)
    assert service.tip()[0, 3] == pytest.approx(1e-3 * (stamps_s[-1] - 1000.0))
