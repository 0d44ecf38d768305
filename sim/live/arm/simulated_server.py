"""A simulated arm behind a TCP port, with a connection that delays, jitters and loses what is said.

Its clock is the number of its steps, so that on a busy machine the arm and what watches over it become slow together.
"""

from __future__ import annotations

import select
import socket
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic, sleep

import numpy as np

from sim.closeable import Closeable
from sim.errors import FieldError

from ..address import ARM_PORT
from .messages import (
    ARM,
    ASK_RECORD,
    HELLO,
    MOST_BYTES,
    RECORD,
    STATE,
    BrokenMessageError,
    arm_fields,
    line_of,
    message_of,
    state_fields,
)
from .simulated_arm import SimulatedArm

STATE_EVERY = 2
"""After so many time steps the arm says where it is."""


@dataclass(frozen=True, kw_only=True)
class Impairment:
    """What a connection does to messages, in either direction."""

    delay_s: float = 0.0
    """Every message comes so much later [s]."""
    jitter_s: float = 0.0
    """And up to so much more, by chance; their order stays [s]."""
    lost: float = 0.0
    """Share of messages that never come."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for field in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, field) <= 10.0:
                raise FieldError(field, getattr(self, field), "must be from 0 to 10.")
        if not 0.0 <= self.lost < 1.0:
            raise FieldError("lost", self.lost, "must be 0 or more, and below 1.")


class _Lane:
    """Messages on their way."""

    def __init__(self, impairment: Impairment, rng: np.random.Generator) -> None:
        self._impairment, self._rng = impairment, rng
        self._waiting: deque[tuple[float, bytes]] = deque()

    def put(self, now_s: float, line: bytes) -> None:
        """Have a message come later, or never."""
        own = self._impairment
        lost, late = self._rng.random(2)
        if lost < own.lost:
            return
        due_s = now_s + own.delay_s + late * own.jitter_s
        self._waiting.append((max(due_s, self._waiting[-1][0]) if self._waiting else due_s, line))

    def due(self, now_s: float) -> list[bytes]:
        """What has come."""
        lines = []
        while self._waiting and self._waiting[0][0] <= now_s:
            lines.append(self._waiting.popleft()[1])
        return lines


class SimulatedServer(Closeable):
    """Serves one client at a time; the next one waits."""

    def __init__(
        self,
        arm: SimulatedArm,
        *,
        host: str = "127.0.0.1",
        port: int = ARM_PORT,
        impairment: Impairment | None = None,
        seed: int = 0,
    ) -> None:
        """Listen, from now on.

        Args:
            arm: What is served.
            host: Address to listen at.
            port: Port, 0 for any that is free.
            impairment: What becomes of messages.
            seed: Seed of that.

        Raises:
            FieldError: The address cannot be listened at.
        """
        self.arm, self._impairment = arm, impairment or Impairment()
        self._rngs = np.random.default_rng(seed).spawn(2)
        try:
            self._socket = socket.create_server((host, port), backlog=1)
        except (OSError, OverflowError) as error:
            raise FieldError(
                "port", port, f"{host} cannot be listened at ({error}). Choose another."
            ) from error
        self.port: int = self._socket.getsockname()[1]
        self._client: socket.socket | None = None
        self._leave()

    def run(self, stop: threading.Event) -> None:
        """Let the arm's time pass until `stop` is set."""
        next_s, n = monotonic(), 0
        while not stop.is_set():
            self._listen()
            self.arm.tick()
            n += 1
            if n % STATE_EVERY == 0:
                self._out.put(
                    self.arm.now_s, line_of(STATE, **state_fields(self.arm.state, self.arm.settings.names))
                )
            self._speak()
            # A clock that fell behind goes on from now: it makes up for nothing.
            tick_s = self.arm.settings.tick_s
            next_s = max(next_s + tick_s, monotonic() - tick_s)
            sleep(max(0.0, next_s - monotonic()))

    def close(self) -> None:
        """Leave the client, and listen no more."""
        self._leave()
        self._socket.close()

    def _leave(self) -> None:
        """Forget a client, and all that was on its way."""
        if self._client is not None:
            self._client.close()
        self._client = None
        self._buffer, self._unsent = bytearray(), b""
        self._in, self._out = (_Lane(self._impairment, rng) for rng in self._rngs)

    def _listen(self) -> None:
        """Take what came, and do what is due."""
        if self._client is None and select.select([self._socket], [], [], 0.0)[0]:
            self._client, _ = self._socket.accept()
            self._client.setblocking(False)
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            while self._client is not None and (chunk := self._client.recv(1 << 18)) is not None:
                self._buffer += chunk
                if not chunk or len(self._buffer) > MOST_BYTES:
                    self._leave()
        except BlockingIOError:
            pass
        except OSError:
            self._leave()
        *lines, rest = bytes(self._buffer).split(b"\n")
        self._buffer[:] = rest
        for line in lines:
            self._in.put(self.arm.now_s, line)
        for line in self._in.due(self.arm.now_s):
            with suppress(BrokenMessageError):
                self._do(line)

    def _do(self, line: bytes) -> None:
        message, own = message_of(line), self.arm.settings
        self.arm.hear(message)
        if message["op"] == HELLO:
            self._out.put(self.arm.now_s, line_of(ARM, version=1, **arm_fields(own.names, own.limits)))
        elif message["op"] == ASK_RECORD:
            self._out.put(self.arm.now_s, line_of(RECORD, **self.arm.record))

    def _speak(self) -> None:
        """Send what is due; a client that does not keep up misses some of it."""
        lines = self._out.due(self.arm.now_s)
        if self._client is None:
            return
        if not self._unsent:
            self._unsent = b"".join(lines)
        try:
            while self._unsent:
                self._unsent = self._unsent[self._client.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self._leave()
