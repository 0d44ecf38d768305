"""A controller at the other end of a TCP connection, spoken to in lines of JSON.

The arm moves only while it hears from here, and it hears from here only while `follow` waits for it and hears it: there
is no thread that would go on saying "I am here" for a program that hangs.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
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
from .progress import Progress
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
        self._is_closed = False
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
        here = self.state()
        goal, states = here.goal + 1, list[ArmState]()
        if not watch(here):
            return [replace(here, goal=goal, status=Status.STOPPED, text="It was told to stop.")]
        sending = line_of(FOLLOW, goal=goal, trajectory=trajectory_of(path))
        said_s, is_wanted = -REPEAT_S, True
        self._heard_s = since_s = monotonic()
        progress = Progress(path, since_s)
        while True:
            now_s = monotonic()
            if not states and now_s - said_s > REPEAT_S:
                self._say(sending)
                said_s = now_s
            if now_s - self._heard_s < QUIET_S:
                self._say(line_of(BEAT if is_wanted else STOP))
            if self._connection is None:
                return [*states, self._stopped(goal, "The connection was lost.")]
            for state in self._states(BEAT_S):
                if state.goal != goal and states:
                    return [
                        *states,
                        self._stopped(goal, "The controller forgot its path, or was sent another."),
                    ]
                if state.goal != goal:
                    continue
                states.append(state)
                if state.status is not Status.FOLLOWING:
                    return states
                is_wanted = watch(state) and is_wanted
                progress.see(state.q, monotonic())
            self._lose_patience(self._heard_s if states else since_s)
            self._expect_progress(progress.since_s, path.duration_s if is_wanted else 0.0)

    def close(self) -> None:
        """Leave the controller for good, which stops the arm; another thread may still be waiting for it."""
        self._is_closed = True
        self._leave()

    def _leave(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    def _stopped(self, goal: int, text: str) -> ArmState:
        """Where the arm rests after it was lost sight of on a path."""
        if self._connection is None:
            self._connect()
        since_s = monotonic()
        while (state := self.state()).status is Status.FOLLOWING:
            self._lose_patience(since_s)
        return ArmState(
            stamp_s=state.stamp_s, q=state.q, speed=state.speed, goal=goal,
            # It may have arrived before it was missed.
            status=Status.DONE if (state.goal, state.status) == (goal, Status.DONE) else Status.STOPPED,
            text=state.text or text,
        )  # fmt: skip

    def _connect(self) -> None:
        self._leave()
        since_s = monotonic()
        while True:
            self._refuse_closed()
            try:
                connection = socket.create_connection(self._address, timeout=self._patience_s)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                break
            except OSError as error:
                if monotonic() - since_s > self._patience_s:
                    raise ControllerError(
                        f"The arm's controller at {self._name} cannot be reached ({error}). Start it, or name another "
                        "in `controller`."
                    ) from error
                sleep(REPEAT_S)
        self._connection = connection
        self._buffer.clear()
        self._heard_s = monotonic()
        if self._is_closed:  # by another thread, meanwhile
            self._leave()
            self._refuse_closed()

    def _refuse_closed(self) -> None:
        if self._is_closed:
            raise ControllerError(
                f"The arm's controller at {self._name} was left, and the arm stands still. Make a new one to go on."
            )

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

    def _expect_progress(self, since_s: float, path_s: float) -> None:
        """Give up an arm that says that it moves, and does not get on for as long as its whole path takes."""
        if monotonic() - since_s > path_s + self._patience_s:
            raise ControllerError(
                f"The arm's controller at {self._name} follows its path and has not got on for "
                f"{path_s + self._patience_s:.3g} s, so that it is told no more to go on. See what holds the arm, and "
                "start again with the same options."
            )

    def _say(self, line: bytes) -> None:
        connection = self._connection
        if connection is None:
            return
        try:
            connection.settimeout(self._patience_s)
            connection.sendall(line)
        except OSError:
            self._leave()

    def _states(self, wait_s: float) -> list[ArmState]:
        """The states that came; waits for some time where nothing has."""
        with self._understanding():
            states = [state_of(each, self.names) for each in self._messages(wait_s) if each["op"] == STATE]
        if states:
            self._heard_s = monotonic()
        return states

    def _messages(self, wait_s: float) -> list[dict[str, Any]]:
        """The messages that came; waits for some time where nothing has."""
        connection = self._connection
        if connection is None:
            self._connect()
            return []
        chunk = b""
        try:
            connection.settimeout(wait_s)
            chunk = connection.recv(1 << 16)
            if not chunk:
                self._leave()
        except TimeoutError:
            return []
        except OSError:
            self._leave()
        self._buffer += chunk
        if len(self._buffer) > MOST_BYTES:
            raise ControllerError(f"The arm's controller at {self._name} sends a line without end.")
        *lines, rest = bytes(self._buffer).split(b"\n")
        self._buffer[:] = rest
        with self._understanding():
            return [message_of(line) for line in lines]

    @contextmanager
    def _understanding(self) -> Iterator[None]:
        try:
            yield
        except BrokenMessageError as error:
            self.close()
            raise ControllerError(
                f"The arm's controller at {self._name} is not understood: {error}."
            ) from error
