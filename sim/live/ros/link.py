"""The link: shows snapshots on topics of ROS by a rosbridge, poses again and again, and hands on what topics report."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from time import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.closeable import Closeable
from sim.errors import FieldError
from sim.world.optional import optional_module

from ..errors import RefusedError
from ..reports import Report
from ..snapshot import Snapshot
from .messages import (
    Message,
    cloud_of,
    for_bridge,
    joint_trajectory,
    markers_of,
    points_of,
    pose_stamped,
    tip_of,
)

TIP, PROPOSED, MAP, SURFACES, PATH = (
    "/sounding/tip",
    "/sounding/proposed",
    "/sounding/map",
    "/sounding/surfaces",
    "/sounding/joint_trajectory",
)
"""Topics that are published."""
REPORTED_TIP, REPORTED_POINTS = "/probe/tip", "/probe/points"
"""Topics that are listened to."""
POSE, CLOUD, MARKERS, TRAJECTORY = (
    "geometry_msgs/PoseStamped",
    "sensor_msgs/PointCloud2",
    "visualization_msgs/MarkerArray",
    "trajectory_msgs/JointTrajectory",
)
TYPES = {
    TIP: POSE, PROPOSED: POSE, MAP: CLOUD, SURFACES: MARKERS, PATH: TRAJECTORY,
    REPORTED_TIP: POSE, REPORTED_POINTS: CLOUD,
}  # fmt: skip
"""The type of each topic."""
LATCHED = (MAP, SURFACES, PATH)
"""Topics whose last message whoever comes later gets too."""
PATIENCE_S = 5.0
"""How long a rosbridge is waited for [s]."""
MOST_BETWEEN_TRIES_S = 2.0
"""The longest wait between two tries to find a rosbridge again [s]."""
MOST_UNSENT_BYTES = 16_000_000
"""While so much waits to be sent, nothing more is: a bridge that hangs does not fill the memory."""


def roslibpy() -> Any:
    """The module roslibpy.

    Raises:
        MissingPackageError: It is not installed.
    """
    return optional_module("roslibpy", "ros", "ROS")


class RosLink(Closeable):
    """A client of a rosbridge, with threads of its own until it is closed. A lost connection is made again."""

    def __init__(
        self,
        host: str,
        port: int,
        *,
        field: str = "ros",
        rate_hz: float = 30.0,
        submit: Callable[[Report], None] | None = None,
        refuse: Callable[[RefusedError], None] = lambda error: None,
        tip: Callable[[], NDArray[np.float64] | None] = lambda: None,
    ) -> None:
        """Connect, advertise and, where reports are taken, subscribe.

        Args:
            host: Where the rosbridge listens.
            port: Its port.
            field: The field that the address is the value of, for the error.
            rate_hz: How often the poses of the tip and of the proposal are sent [Hz].
            submit: Called with each report; None where something is only shown.
            refuse: Called with what is refused.
            tip: Where the tip is now, where that is known sooner than a snapshot tells.

        Raises:
            MissingPackageError: roslibpy is not installed.
            FieldError: Nobody listens there.
        """
        module = roslibpy()
        self._submit, self._refuse, self._tip, self._rate_hz = submit, refuse, tip, rate_hz
        self._ros = _connected(module, host, port, field)
        self._topics = _topics_of(module, self._ros)
        self._latest: dict[str, Message] = {}
        self._snapshot: Snapshot | None = None
        self._is_closed, self._was_connected = threading.Event(), True
        self._lock, self._latching = threading.Lock(), threading.Lock()
        if submit is not None:
            self._topics[REPORTED_TIP].subscribe(lambda message: self._hear(tip_of, message))
            self._topics[REPORTED_POINTS].subscribe(lambda message: self._hear(points_of, message))
        self._ticking = threading.Thread(target=self._tick, daemon=True)
        self._ticking.start()

    def publish(self, snapshot: Snapshot) -> None:
        """Show a snapshot."""
        now_s = time()
        with self._lock:
            self._snapshot = snapshot
            self._show_poses(snapshot)
        if (cloud := cloud_of(snapshot, now_s)) is not None:
            self._send(MAP, cloud)
        self._send(SURFACES, markers_of(snapshot, now_s))

    def publish_pose(self, T_world_probe: NDArray[np.float64]) -> None:
        """Show the pose that is proposed, ahead of the snapshot that tells all of it."""
        with self._lock:
            if self._snapshot is not None:
                self._snapshot = self._snapshot.proposing(T_world_probe)
            self._send(PROPOSED, pose_stamped(T_world_probe, time()))

    def publish_path(self, trajectory: Message) -> None:
        """Show a path that an arm is sent, by its names and points."""
        self._send(PATH, joint_trajectory(trajectory, time()))

    def close(self) -> None:
        """Leave the rosbridge."""
        self._is_closed.set()
        self._ticking.join(timeout=2.0)
        _leave(self._ros)

    def _hear(self, read: Callable[[Any], Report], message: Any) -> None:
        try:
            report = read(message)
            if self._submit is not None:
                self._submit(report)
        except RefusedError as error:
            self._refuse(error)

    def _tick(self) -> None:
        while not self._is_closed.wait(1.0 / self._rate_hz):
            is_connected = self._ros.is_connected
            if is_connected and not self._was_connected:
                self._send_latched()
            self._was_connected = is_connected
            # No pose of before is sent after a new one.
            with self._lock:
                snapshot, T_world_tip = self._snapshot, self._tip()
                if snapshot is not None and T_world_tip is not None:
                    snapshot = replace(snapshot, T_world_tip=T_world_tip)
                if snapshot is not None:
                    self._show_poses(snapshot)

    def _show_poses(self, snapshot: Snapshot) -> None:
        now_s = time()
        if snapshot.proposal is not None and snapshot.proposal.T_world_probe is not None:
            self._send(PROPOSED, pose_stamped(snapshot.proposal.T_world_probe, now_s))
        if snapshot.T_world_tip is not None:
            self._send(TIP, pose_stamped(snapshot.T_world_tip, now_s))

    def _send(self, topic: str, message: Message) -> None:
        if topic not in LATCHED:
            self._write(topic, message)
            return
        # Else what is sent again could be older than what was sent meanwhile, and be the last.
        with self._latching:
            self._latest[topic] = message
            self._write(topic, message)

    def _send_latched(self) -> None:
        """Send all that is latched again."""
        with self._latching:
            for topic, message in self._latest.items():
                self._write(topic, message)

    def _write(self, topic: str, message: Message) -> None:
        # Without a connection roslibpy would keep message after message for later, and so would a bridge that hangs.
        if self._ros.is_connected and unsent_bytes(self._ros) < MOST_UNSENT_BYTES:
            self._topics[topic].publish(for_bridge(message))


def unsent_bytes(ros: Any) -> int:
    """How much waits to be sent on a connection, as far as its transport tells."""
    transport = getattr(getattr(ros.factory, "_proto", None), "transport", None)
    size = getattr(transport, "get_write_buffer_size", None)
    return 0 if size is None else int(size())


def _connected(module: Any, host: str, port: int, field: str) -> Any:
    """A client of a rosbridge that has answered.

    Raises:
        FieldError: Nobody listens there; the field is named.
    """
    logging.getLogger("roslibpy").setLevel(logging.ERROR)
    # Twisted's reactor, the default, cannot be started a second time in a process.
    ros = module.Ros(host, port, transport="asyncio")
    # Of its own accord it would wait up to an hour between two tries.
    ros.factory.maxDelay = MOST_BETWEEN_TRIES_S
    try:
        ros.run(timeout=PATIENCE_S)
    except Exception as error:
        _leave(ros)
        problem = f"no rosbridge answers there ({error}). Start it, or name another."
        raise FieldError(field, f"ws://{host}:{port}", problem) from error
    return ros


def _topics_of(module: Any, ros: Any) -> dict[str, Any]:
    """All topics on a connection, by name."""
    return {name: module.Topic(ros, name, kind, latch=name in LATCHED) for name, kind in TYPES.items()}


def _leave(ros: Any) -> None:
    """Close a connection, or the one that a last try may still make."""
    with suppress(Exception):  # whatever a connection that is lost says to its end
        ros.factory.maxRetries = 0
        ros.factory.on_ready(lambda protocol: protocol.send_close())
