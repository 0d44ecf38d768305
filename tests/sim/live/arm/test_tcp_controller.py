"""What waits for a controller, on a line and a clock in memory: it ends whatever the controller says or leaves out."""

import json
from itertools import count

import numpy as np
import pytest
from arm_paths import LIMITS, path

from sim.live.arm import tcp_controller
from sim.live.arm.controller import ControllerError, Status
from sim.live.arm.messages import ARM, FOLLOW, HELLO, STATE, BrokenMessageError, arm_fields, arm_of, state_of
from sim.live.arm.tcp_controller import TcpController

NAMES = ("a", "b")


class Line:
    """A controller in memory: `answers` gives the fields of its states after a path was sent, one at a time."""

    def __init__(self, answers, *, noise=False):
        self.now_s, self.sent, self.seen = 0.0, [], 0
        self._answers, self._noise = iter(answers), noise

    def __call__(self, address, timeout):
        return self

    def settimeout(self, wait_s):
        pass

    def setsockopt(self, *options):
        pass

    def close(self):
        pass

    def sendall(self, line):
        self.sent.append(json.loads(line))
        self.seen = self.sent[-1].get("n", self.seen)

    def recv(self, most):
        self.now_s += 0.01
        is_sent = any(each["op"] == FOLLOW for each in self.sent)
        fields = {"goal": 0, "status": "idle", "position": [0.0, 0.0]}
        if is_sent:
            answer = next(self._answers, None)
            if answer is None and not self._noise:
                raise TimeoutError
            fields |= answer or {}
        state = {
            "op": STATE,
            "stamp_s": self.now_s,
            "name": NAMES,
            "velocity": [0, 0],
            "text": "",
            "seen": self.seen,
        }
        said = [{"op": ARM, **arm_fields(NAMES, LIMITS)}, state | fields]
        if is_sent and answer is None:
            said = [{"op": "noise"}]
        return b"".join(json.dumps(each).encode() + b"\n" for each in said)

    def ops(self):
        return [each["op"] for each in self.sent]


@pytest.fixture
def joined(monkeypatch):
    """Joins a controller to a line."""

    def join(line):
        monkeypatch.setattr(tcp_controller.socket, "create_connection", line)
        monkeypatch.setattr(tcp_controller, "monotonic", lambda: line.now_s)
        return TcpController("there", 1, patience_s=1.0)

    return join


def following(q=(0.0, 0.0)):
    return {"goal": 1, "status": "following", "position": list(q)}


def test_an_arm_that_gets_on_slowly_is_waited_for(joined) -> None:
    ends = np.linspace([0.0, 0.0], [0.8, -0.5], 2000)
    line = Line([*(following(q) for q in ends), {"goal": 1, "status": "done", "position": [0.8, -0.5]}])
    assert joined(line).follow(path())[-1].status is Status.DONE
    assert line.now_s > 20.0


def test_an_arm_that_never_gets_on_is_given_up(joined) -> None:
    line = Line(following((0.4, -0.25)) for _ in range(100_000))
    with pytest.raises(ControllerError, match=r"has not got on for 3 s.*start again"):
        joined(line).follow(path(duration_s=2.0))
    assert line.now_s == pytest.approx(3.0, abs=0.2)


def test_an_arm_that_was_told_to_stop_and_stays_on_its_path_is_given_up(joined) -> None:
    line, numbers = Line(following() for _ in range(100_000)), count()
    with pytest.raises(ControllerError, match="has not got on for 1 s"):
        joined(line).follow(path(), lambda state: next(numbers) < 3)


def test_messages_that_are_no_states_do_not_renew_patience(joined) -> None:
    line = Line([following()], noise=True)
    with pytest.raises(ControllerError, match="nothing of use for 1 s"):
        joined(line).follow(path())
    # Nor is the arm told to go on by who does not hear it.
    beats = line.ops().count("beat")
    assert beats <= tcp_controller.QUIET_S / 0.01 + 2


def test_a_controller_that_forgot_the_path_has_stopped_it(joined) -> None:
    line = Line([following(), following((0.1, -0.06)), *[{"position": [0.1, -0.06]}] * 50])
    last = joined(line).follow(path())[-1]
    assert (last.status, last.goal) == (Status.STOPPED, 1)
    assert "forgot its path" in last.text
    np.testing.assert_array_equal(last.q, [0.1, -0.06])


def test_states_of_a_path_before_are_passed_over(joined) -> None:
    line = Line([{}, {}, following(), {"goal": 1, "status": "done", "position": [0.8, -0.5]}])
    assert [state.status for state in joined(line).follow(path())] == [Status.FOLLOWING, Status.DONE]


def test_nothing_is_sent_to_an_arm_that_is_not_to_move(joined) -> None:
    line = Line([])
    last = joined(line).follow(path(), lambda state: False)[-1]
    assert (last.status, last.goal) == (Status.STOPPED, 1)
    assert set(line.ops()) == {HELLO}


def test_a_controller_that_was_left_is_not_joined_again(joined) -> None:
    line = Line([])
    controller = joined(line)
    controller.close()
    for use in (controller.state, lambda: controller.follow(path())):
        with pytest.raises(ControllerError, match="was left"):
            use()
    assert line.sent == []


@pytest.mark.parametrize("field", ["stamp_s", "position"])
def test_numbers_beyond_all_bounds_are_no_state(field) -> None:
    state = {"stamp_s": 0.0, "name": ["a", "b"], "position": [0, 0], "velocity": [0, 0], "goal": 0, "seen": 0}
    state |= {"status": "idle", "text": "", field: 10**400 if field == "stamp_s" else [10**400, 0]}
    with pytest.raises(BrokenMessageError, match="a state cannot be read"):
        state_of(state, NAMES)


def test_limits_beyond_all_bounds_and_names_that_are_no_list_are_not_understood() -> None:
    fields = arm_fields(NAMES, LIMITS) | {"speed": [10**400, 1]}
    with pytest.raises(BrokenMessageError, match="what the arm is cannot be read"):
        arm_of(fields)
    with pytest.raises(BrokenMessageError, match="a state cannot be read"):
        state_of({"name": {"a": 0, "b": 0}, "stamp_s": 0.0, "goal": 0, "seen": 0}, NAMES)
