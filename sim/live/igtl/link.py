"""The link: shows snapshots to OpenIGTLink clients, poses again and again, and hands on what they report."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.closeable import Closeable

from ..address import IGTL_PORT
from ..errors import RefusedError
from ..patient_frame import PatientFrame
from ..reports import Report
from ..snapshot import Snapshot
from .messages import PROPOSED, messages_of, pose_messages, report_of, transform_message
from .server import LOOPBACK, IgtlServer
from .wire import RawMessage, WireSettings, igtl


@dataclass(frozen=True, kw_only=True)
class LinkSettings:
    """Where clients come to, and how often they hear where the probe is."""

    host: str = LOOPBACK
    """Address to listen at; the default hears this machine alone."""
    port: int = IGTL_PORT
    """Port, 0 for any that is free."""
    rate_hz: float = 30.0
    """How often the poses of the tip and of the proposal are sent [Hz]."""
    wire: WireSettings = field(default_factory=WireSettings)
    """What is taken off the wire."""


def refuse_all(report: Report) -> None:
    """Refuse a report, where only something is shown.

    Raises:
        RefusedError: Always.
    """
    raise RefusedError("unknown", f"nobody listens to a {type(report).__name__}: this is only shown")


class IgtlLink(Closeable):
    """Serves OpenIGTLink clients from threads of its own until it is closed."""

    def __init__(
        self,
        frame: PatientFrame,
        settings: LinkSettings | None = None,
        *,
        submit: Callable[[Report], None] = refuse_all,
        refuse: Callable[[RefusedError], None] = lambda error: None,
        tip: Callable[[], NDArray[np.float64] | None] = lambda: None,
    ) -> None:
        """Listen, from now on.

        Args:
            frame: Where the patient lies.
            settings: Where to listen.
            submit: Called with each report of a client; a `RefusedError` of it is counted.
            refuse: Called with what is refused.
            tip: Where the tip is now, where that is known sooner than a snapshot tells.

        Raises:
            MissingPackageError: pyigtl is not installed.
            FieldError: The address cannot be listened at.
        """
        igtl()  # told before anything waits for it
        self._frame, self._settings = frame, settings or LinkSettings()
        self._submit, self._tip = submit, tip
        self._snapshot: Snapshot | None = None
        self._is_closed, self._lock = threading.Event(), threading.Lock()
        self.server = IgtlServer(
            self._hear,
            refuse,
            host=self._settings.host,
            port=self._settings.port,
            settings=self._settings.wire,
        )
        self._ticking = threading.Thread(target=self._tick, daemon=True)
        self._ticking.start()

    def publish(self, snapshot: Snapshot) -> None:
        """Show a snapshot to all clients, those who come later too."""
        with self._lock:
            is_first, self._snapshot = self._snapshot is None, snapshot
        for device, message in messages_of(snapshot, self._frame, with_organ=is_first):
            self.server.publish(device, message)

    def publish_pose(self, T_world_probe: NDArray[np.float64]) -> None:
        """Show the pose that is proposed, ahead of the snapshot that tells all of it."""
        with self._lock:
            if self._snapshot is not None:
                self._snapshot = self._snapshot.proposing(T_world_probe)
            self.server.publish(PROPOSED, transform_message(PROPOSED, T_world_probe, self._frame))

    def close(self) -> None:
        """Leave all clients."""
        self._is_closed.set()
        self._ticking.join(timeout=2.0)
        self.server.close()

    def _hear(self, raw: RawMessage) -> None:
        self._submit(report_of(raw, self._frame))

    def _tick(self) -> None:
        while not self._is_closed.wait(1.0 / self._settings.rate_hz):
            # No pose of before is sent after a new one.
            with self._lock:
                snapshot, T_world_tip = self._snapshot, self._tip()
                if snapshot is not None and T_world_tip is not None:
                    snapshot = replace(snapshot, T_world_tip=T_world_tip)
                for device, message in () if snapshot is None else pose_messages(snapshot, self._frame):
                    self.server.publish(device, message)
