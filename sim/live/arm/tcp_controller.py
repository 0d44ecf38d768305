"""A controller at the other end of a TCP connection, spoken to in lines of JSON.

The arm moves only while it hears from here, and it hears from here only while `follow` waits for it and hears it: there
is no thread that would go on saying "I am here" for a program that hangs.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic, sleep
from typing import Any

from .controller import ArmController, ArmState, ControllerError, Status
from .messages import (
    ARM,
    BEAT,
    FOLLOW,
    HELLO,
    MOST_BYTES,
    STATE,
    STOP,
    BrokenMessageError,
    arm_of,
    line_of,
    message_of,
    state_of,
    trajectory_of,
)
from .timed_path import ArmLimits, TimedPath

BEAT_S = 0.01
"""How often the arm is told to go on [s]."""
QUIET_S = 0.25
"""An arm that was not heard for so long is not told to go on, so that it stops [s]."""
REPEAT_S = 0.1
"""What was not heard is said again after this time [s]."""


class TcpController(ArmController):
    """See `ArmController`. A connection that is lost is made again; the arm has stopped meanwhile."""

    def __init__(self, host: str, port: int, *, patience_s: float = 5.0) -> None:
        """Connect, and learn what the arm is.

        Args:
            host: Where the controller listens.
            port: Its port.
            patience_s: How long to wait for a controller that cannot be reached or is silent.

        Raises:
            ControllerError: It is not there, or what it says cannot be understood.
        """
        self._address, self._patience_s = (host, port), patience_s
        self._connection: socket.socket | None = None
        self._buffer, self._heard_s, self._n_asked = bytearray(), monotonic(), 0
        self._connect()
        self.names, self.limits = self._introduction()

    def state(self) -> ArmState:
        """See `ArmController.state`; what was said before this was asked does not count."""
        self._n_asked += 1
        since_s, said_s = monotonic(), -REPEAT_S
        while True:
            if monotonic() - said_s > REPEAT_S:
                self._say(line_of(HELLO, n=self._n_asked))
                said_s = monotonic()
            for state in self._states(BEAT_S):
                if state.seen >= self._n_asked:
                    return state
            self._lose_patience(since_s)

    def follow(
        self, path: TimedPath, watch: Callable[[ArmState], bool] = lambda state: True
    ) -> list[ArmState]:
        """See `ArmController.follow`."""
        goal, states = self.state().goal + 1, list[ArmState]()
        sending = line_of(FOLLOW, goal=goal, trajectory=trajectory_of(path))
        said_s, is_wanted, since_s = -REPEAT_S, True, monotonic()
        self._heard_s = since_s
        while True:
            now_s = monotonic()
            if not states and now_s - said_s > REPEAT_S:
                self._say(sending)
                said_s = now_s
            if now_s - self._heard_s < QUIET_S:
                self._say(line_of(BEAT if is_wanted else STOP))
            if self._connection is None:
                return [*states, self._stopped(goal)]
            for state in self._states(BEAT_S):
                if state.goal != goal:
                    continue
                states.append(state)
                if state.status is not Status.FOLLOWING:
                    return states
                is_wanted = watch(state) and is_wanted
            self._lose_patience(self._heard_s if states else since_s)

    def close(self) -> None:
        """Leave the controller, which stops the arm."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _stopped(self, goal: int) -> ArmState:
        """Where the arm rests after the connection was lost and made again."""
        self._connect()
        since_s = monotonic()
        while (state := self.state()).status is Status.FOLLOWING:
            self._lose_patience(since_s)
        return ArmState(
            stamp_s=state.stamp_s, q=state.q, speed=state.speed, goal=goal,
            # It may have arrived before it was missed.
            status=Status.DONE if (state.goal, state.status) == (goal, Status.DONE) else Status.STOPPED,
            text=state.text or "The connection was lost.",
        )  # fmt: skip

    def _connect(self) -> None:
        self.close()
        since_s = monotonic()
        while True:
            try:
                self._connection = socket.create_connection(self._address, timeout=self._patience_s)
                break
            except OSError as error:
                if monotonic() - since_s > self._patience_s:
                    raise ControllerError(
                        f"The arm's controller at {self._name} cannot be reached ({error}). Start it, or name another "
                        "in `controller`."
                    ) from error
                sleep(REPEAT_S)
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer.clear()
        self._heard_s = monotonic()

    def _introduction(self) -> tuple[tuple[str, ...], ArmLimits]:
        """What the controller says that the arm is."""
        since_s, said_s = monotonic(), -REPEAT_S
        while True:
            if monotonic() - said_s > REPEAT_S:
                self._say(line_of(HELLO, n=self._n_asked))
                said_s = monotonic()
            for message in self._messages(BEAT_S):
                if message["op"] == ARM:
                    with self._understanding():
                        return arm_of(message)
            self._lose_patience(since_s)

    @property
    def _name(self) -> str:
        return f"arm://{self._address[0]}:{self._address[1]}"

    def _lose_patience(self, since_s: float) -> None:
        if monotonic() - since_s > self._patience_s:
            raise ControllerError(
                f"The arm's controller at {self._name} has said nothing of use for {self._patience_s:g} s, so that the "
                "arm is taken to stand still. Look after it, and start again."
            )

    def _say(self, line: bytes) -> None:
        if self._connection is None:
            return
        try:
            self._connection.settimeout(self._patience_s)
            self._connection.sendall(line)
        except OSError:
            self.close()

    def _states(self, wait_s: float) -> list[ArmState]:
        """The states that came; waits for some time where nothing has."""
        with self._understanding():
            return [state_of(each, self.names) for each in self._messages(wait_s) if each["op"] == STATE]

    def _messages(self, wait_s: float) -> list[dict[str, Any]]:
        """The messages that came; waits for some time where nothing has."""
        if self._connection is None:
            self._connect()
        assert self._connection is not None
        chunk = b""
        try:
            self._connection.settimeout(wait_s)
            chunk = self._connection.recv(1 << 16)
            if not chunk:
                self.close()
        except TimeoutError:
            return []
        except OSError:
            self.close()
        self._buffer += chunk
        if len(self._buffer) > MOST_BYTES:
            raise ControllerError(f"The arm's controller at {self._name} sends a line without end.")
        *lines, rest = bytes(self._buffer).split(b"\n")
        self._buffer[:] = rest
        with self._understanding():
            messages = [message_of(line) for line in lines]
        if messages:
            self._heard_s = monotonic()
        return messages

    @contextmanager
    def _understanding(self) -> Iterator[None]:
        try:
            yield
        except BrokenMessageError as error:
            self.close()
            raise ControllerError(
                f"The arm's controller at {self._name} is not understood: {error}."
            ) from error
