"""The server: any number of OpenIGTLink clients, which come and go, each served by two threads of its own."""

from __future__ import annotations

import socket
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from time import monotonic

from sim.closeable import Closeable
from sim.errors import FieldError

from ..address import IGTL_PORT
from ..errors import RefusedError
from .wire import LostStreamError, RawMessage, WireSettings, receive

LOOPBACK = "127.0.0.1"
"""Nobody but this machine is listened to."""
MOST_CLIENTS = 16
POLL_S = 0.2
"""How often a thread that waits looks whether it should end [s]."""
LAST_S = 1.0
"""How long clients are waited for at the end that have not been sent everything yet [s]."""


class _Client:
    """One client: what it still has to be sent, at most one message a device, so that a slow one never lags behind."""

    def __init__(self, connection: socket.socket, patience_s: float) -> None:
        connection.settimeout(POLL_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection, self._patience_s = connection, patience_s
        self._pending: dict[str, bytes] = {}
        self._changed = threading.Condition()
        self._is_sending = False
        self.is_gone = False

    def put(self, device: str, message: bytes) -> None:
        """Have a message sent in place of one of the same device that was not sent yet."""
        with self._changed:
            self._pending[device] = message
            self._changed.notify_all()

    def drain(self, until_s: float) -> None:
        """Wait until all that was put is sent, the client is gone, or the monotonic clock has come to a time [s]."""
        with self._changed:
            while (self._pending or self._is_sending) and not self.is_gone:
                if not self._changed.wait(max(until_s - monotonic(), 0.0)):
                    return

    def leave(self) -> None:
        """Close the connection."""
        with self._changed:
            self.is_gone = True
            self._changed.notify_all()
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def write(self, sent: Counter[str]) -> None:
        """Send what is put until the client is gone."""
        while True:
            with self._changed:
                while not (self._pending or self.is_gone):
                    self._changed.wait()
                if self.is_gone:
                    return
                device = next(iter(self._pending))
                message, self._is_sending = self._pending.pop(device), True
            try:
                self._send(message)
            except OSError:
                self.leave()
                return
            sent[device] += 1
            with self._changed:
                self._is_sending = False
                self._changed.notify_all()

    def _send(self, message: bytes) -> None:
        view, last_s = memoryview(message), monotonic()
        while view:
            try:
                n = self.connection.send(view)
            except TimeoutError:
                if self.is_gone or monotonic() - last_s > self._patience_s:
                    raise
                continue
            view, last_s = view[n:], monotonic()


class IgtlServer(Closeable):
    """A server that hands on what clients send, and sends all of them what is published."""

    def __init__(
        self,
        on_message: Callable[[RawMessage], None],
        on_refused: Callable[[RefusedError], None],
        *,
        host: str = LOOPBACK,
        port: int = IGTL_PORT,
        settings: WireSettings | None = None,
    ) -> None:
        """Listen, from now on.

        Args:
            on_message: Called with each message, from the thread of its client; a `RefusedError` of it is counted.
            on_refused: Called with what is refused.
            host: Address to listen at.
            port: Port, 0 for any that is free.
            settings: What is taken off the wire.

        Raises:
            FieldError: The address cannot be listened at.
        """
        self._on_message, self._on_refused = on_message, on_refused
        self._settings = settings or WireSettings()
        self._clients: list[_Client] = []
        self._latest: dict[str, bytes] = {}
        self._lock = threading.Lock()
        self._is_closed = threading.Event()
        self.sent: Counter[str] = Counter()
        self.n_served = 0
        try:
            self._socket = socket.create_server((host, port))
        except (OSError, OverflowError) as error:
            raise FieldError(
                "port", port, f"{host} cannot be listened at ({error}). Choose another."
            ) from error
        self._socket.settimeout(POLL_S)
        self.port: int = self._socket.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    @property
    def n_clients(self) -> int:
        """How many clients there are now."""
        return len(self._clients)

    def publish(self, device: str, message: bytes) -> None:
        """Send a message to all clients, and to all that come until another of its device is published."""
        with self._lock:
            self._latest[device] = message
            for client in self._clients:
                client.put(device, message)

    def close(self) -> None:
        """Leave all clients, once they have been sent what was published, and listen no more."""
        with self._lock:
            clients = list(self._clients)
        until_s = monotonic() + LAST_S
        for client in clients:
            client.drain(until_s)
        self._is_closed.set()
        with self._lock:
            for client in self._clients:
                client.leave()
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._socket.close()

    def _accept(self) -> None:
        while not self._is_closed.is_set():
            try:
                connection, _ = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            client = _Client(connection, self._settings.patience_s)
            with self._lock:
                is_full = len(self._clients) >= MOST_CLIENTS
                if not is_full:
                    self._clients.append(client)
                    self.n_served += 1
                    for device, message in self._latest.items():
                        client.put(device, message)
            if is_full:
                connection.close()
                self._on_refused(RefusedError("too many", f"{MOST_CLIENTS} clients are served already"))
                continue
            for target in (self._read, self._write):
                threading.Thread(target=target, args=(client,), daemon=True).start()

    def _write(self, client: _Client) -> None:
        client.write(self.sent)

    def _read(self, client: _Client) -> None:
        try:
            while not (self._is_closed.is_set() or client.is_gone):
                self._take_one(client)
        except (LostStreamError, OSError) as error:
            if isinstance(error.__cause__, RefusedError):
                self._on_refused(error.__cause__)
        finally:
            with self._lock:
                self._clients.remove(client)
            client.leave()
            client.connection.close()

    def _take_one(self, client: _Client) -> None:
        try:
            raw = receive(client.connection, self._settings)
            if raw is not None:
                self._on_message(raw)
        except RefusedError as error:
            self._on_refused(error)
