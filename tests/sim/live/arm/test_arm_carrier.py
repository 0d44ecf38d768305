"""The carrier beside a service, with a motion in memory: what it tells, when it declines, and how it ends."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from sim.live.arm import arm_carrier
from sim.live.arm.arm_carrier import ArmCarrier
from sim.live.errors import RefusedError
from sim.live.reports import PointsSensed, PoseDeclined, TipMoved
from sim.world.errors import WorldError
from sim.world.sensing.reading import Reading

POSE = 7


class Motion:
    """An arm that stands where `place_m` says and reaches every pose."""

    def __init__(self, setup, controller, settings, watch, show):
        self.n_moves, self.strayed, self.place_m, self.error = 0, [], 0.0, None

    def begin(self, data):
        pass

    def move(self, data, pose):
        if self.error is not None:
            raise self.error
        self.n_moves += 1
        return SimpleNamespace(reason="")

    def look(self, data):
        data.site("tip").xpos[:] = self.place_m
        return self.strayed.pop(0) if self.strayed else ""


class Taker:
    """A service that proposes one pose, and refuses as many reports as it is told to."""

    def __init__(self, n_refused=0):
        proposal = SimpleNamespace(advice="sense", pose_index=POSE)
        self.published = SimpleNamespace(n_sensed=0, proposal=proposal, wanted=(0, POSE))
        self.session, self.reports, self.refused = SimpleNamespace(sensed=[]), [], []
        self._n_refused = n_refused

    def submit(self, report):
        self.reports.append(report)

    def take(self, report):
        if len(self.refused) < self._n_refused:
            raise RefusedError("too many", "some are waiting")
        self.reports.append(report)

    def refuse(self, error):
        self.refused.append(error)

    def of(self, kind):
        return [report for report in self.reports if isinstance(report, kind)]


class Refuser(Taker):
    """A service whose session refuses each reading, and says so with a snapshot that wants the same."""

    def take(self, report):
        super().take(report)
        if isinstance(report, PointsSensed):
            said = vars(self.published) | {"note": "refused (unusable): no point"}
            self.published = SimpleNamespace(**said)


class Ticks(threading.Event):
    """A stop that is set after so many waits, none of which takes time."""

    def __init__(self, n):
        super().__init__()
        self._left = n

    def wait(self, timeout=None):
        self._left -= 1
        if self._left < 0:
            self.set()
        return self.is_set()


@pytest.fixture
def carrier(monkeypatch):
    monkeypatch.setattr(arm_carrier, "SteeredMotion", Motion)
    site = SimpleNamespace(xmat=np.eye(3).ravel(), xpos=np.zeros(3))
    answer = SimpleNamespace(is_reached=True, explain=lambda: "")
    setup = SimpleNamespace(
        scene=SimpleNamespace(tip_site="tip"), positioner=SimpleNamespace(reach=lambda pose: answer)
    )

    def make(sense=None):
        data, settings = SimpleNamespace(site=lambda name: site), SimpleNamespace(sensing_s=0.1)
        return ArmCarrier(setup, data, None, settings, sense=sense)

    return make


def read(action):
    return Reading(np.zeros((3, 3)), np.zeros(3, dtype=bool), np.eye(4))


def test_a_standing_arm_is_asked_where_it_is(carrier) -> None:
    one, service = carrier(), Taker()
    one._motion.place_m = 0.25
    one.serve(service, Ticks(4), rate_hz=10.0)
    assert [tip.T_world_probe[0, 3] for tip in service.of(TipMoved)] == [0.0, 0.25, 0.25, 0.25]
    assert all(report.stamp_s is None for report in service.reports)
    assert service.of(PoseDeclined) == []


def test_a_pose_that_the_arm_was_pushed_off_is_declined_once(carrier) -> None:
    one, service = carrier(), Taker()
    one._motion.strayed = ["", "It was pushed.", "It was pushed."]
    one.serve(service, Ticks(8), rate_hz=10.0)
    assert [(each.pose_index, each.reason) for each in service.of(PoseDeclined)] == [(POSE, "It was pushed.")]
    assert one._motion.n_moves == 1


def test_a_pose_whose_reading_was_taken_is_not_declined(carrier) -> None:
    one, service = carrier(), Taker()
    service.session.sensed.append(POSE)
    one._motion.strayed = ["It was pushed."]
    one.serve(service, Ticks(4), rate_hz=10.0)
    assert service.of(PoseDeclined) == []


def test_a_pose_whose_simulated_reading_is_refused_is_declined_once(carrier) -> None:
    one, service = carrier(read), Refuser()
    one.serve(service, Ticks(8), rate_hz=10.0)
    assert len(service.of(PointsSensed)) == 1
    assert [(each.pose_index, each.reason) for each in service.of(PoseDeclined)] == [
        (POSE, "refused (unusable): no point")
    ]


def test_a_pose_whose_reading_cannot_be_taken_is_declined_and_not_said_for_ever(carrier) -> None:
    one, service = carrier(read), Taker()
    refusals = [RefusedError("wrong frame", "a place is 3 m from the organ")]

    def take(report):
        if refusals:
            raise refusals.pop()
        service.reports.append(report)

    service.take = take
    one.serve(service, Ticks(8), rate_hz=10.0)
    assert service.of(PointsSensed) == []
    assert [each.reason for each in service.of(PoseDeclined)] == ["a place is 3 m from the organ"]


def test_nothing_is_sensed_where_the_arm_was_pushed_off(carrier) -> None:
    one, service = carrier(read), Taker()
    one._motion.strayed = ["It was pushed."]
    one.serve(service, Ticks(4), rate_hz=10.0)
    assert service.of(PointsSensed) == []
    assert [each.reason for each in service.of(PoseDeclined)] == ["It was pushed."]


def test_a_report_that_is_refused_is_said_again_and_the_arm_stays(carrier) -> None:
    one, service = carrier(read), Taker(n_refused=2)
    one.serve(service, Ticks(8), rate_hz=10.0)
    assert len(service.refused) == 2
    assert len(service.of(PointsSensed)) == 1
    assert one._motion.n_moves == 1


@pytest.mark.parametrize("error", [WorldError("no"), ValueError("odd"), KeyError("x"), OverflowError("big")])
def test_any_fault_ends_the_session_and_is_kept(carrier, error) -> None:
    one, stop = carrier(), Ticks(4)
    one._motion.error = error
    one.serve(Taker(), stop, rate_hz=10.0)
    assert stop.is_set()
    assert one.error is error
