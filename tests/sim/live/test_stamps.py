"""Time stamps of a service's reports, and who learns whether a report was taken."""

from types import SimpleNamespace

import pytest

from sim.live.errors import RefusedError
from sim.live.reports import PoseDeclined
from sim.live.service import MOST_WAITING, Service


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
