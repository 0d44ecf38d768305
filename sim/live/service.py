"""A service: one session that works off what transports report, one report after the other, and tells how it stands."""

from __future__ import annotations

import queue
import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from time import time

import numpy as np
from numpy.typing import NDArray

from .errors import RefusedError
from .reports import PointsSensed, PoseDeclined, Report, TipMoved, check_report, reading_of
from .session import Session
from .snapshot import Snapshot

MOST_WAITING = 32
"""Reports that may wait while the map learns; more are refused."""
MOST_TIPS = 20_000
"""Poses of the tip that are remembered at most, to find the one at which a reading was taken."""


@dataclass(frozen=True, kw_only=True)
class ServiceSettings:
    """What a service takes for old."""

    stale_s: float = 2.0
    """A tip this much older than a reading says nothing of where it was taken, and a report whose time stamp is this
    far from the clock of this machine is refused [s]."""

    def __post_init__(self) -> None:
        """Validate the range."""
        if not 0.0 < self.stale_s <= 3600.0:
            raise ValueError(f"stale_s={self.stale_s}: must be above 0 and at most 3600.")


class Service:
    """A session in a thread of its own.

    Transports call `submit` from any thread. What is refused is counted by its reason, in `refused`.
    """

    def __init__(
        self,
        session: Session,
        publish: Callable[[Snapshot], None],
        settings: ServiceSettings | None = None,
        *,
        publish_pose: Callable[[NDArray[np.float64]], None] = lambda T: None,
        clock: Callable[[], float] = time,
    ) -> None:
        """Serve a session, which nobody else may use from now on.

        Args:
            session: The session.
            publish: Called with each new snapshot, from the service's thread.
            settings: What counts as old.
            publish_pose: Called with the pose that is proposed, before the snapshot that tells all of it.
            clock: Seconds since 1970.
        """
        self.session = session
        self._publish, self._settings, self._clock = publish, settings or ServiceSettings(), clock
        self._publish_pose = publish_pose
        self._waiting: queue.Queue[tuple[Report, NDArray[np.float64] | None]] = queue.Queue(MOST_WAITING)
        self._lock = threading.Lock()
        self.published: Snapshot | None = None
        """The last snapshot; None until there is one."""
        self.refused: Counter[str] = Counter()
        self._note = ""
        self._newest: dict[type, float] = {}
        self._tips: deque[tuple[float, NDArray[np.float64]]] = deque()

    def submit(self, report: Report) -> None:
        """Have a report worked off, at once if it only moves the tip; what is refused is counted.

        Args:
            report: The report, in the world's frame.
        """
        try:
            self.take(report)
        except RefusedError as error:
            self.refuse(error)

    def take(self, report: Report) -> None:
        """Have a report worked off, as `submit` does, for who wants to know whether it was taken.

        Raises:
            RefusedError: It was not; nothing is counted.
        """
        stamp_s = self._fresh(report)
        check_report(report, self.session.organ)
        with self._lock:
            if report.stamp_s is not None:
                self._newest[type(report)] = stamp_s
            if isinstance(report, TipMoved):
                self._remember(stamp_s, report.T_world_probe)
                return
            # The tip as it was then: it may move on before the report is worked off.
            T = self._tip_at(stamp_s) if isinstance(report, PointsSensed) else None
        try:
            self._waiting.put_nowait((report, T))
        except queue.Full:
            raise RefusedError("too many", f"{MOST_WAITING} reports are waiting already") from None

    def refuse(self, error: RefusedError) -> None:
        """Count something that was refused."""
        with self._lock:
            self.refused[error.kind] += 1
            self._note = f"refused ({error.kind}): {error}"

    def run(self, stop: threading.Event) -> None:
        """Work off reports until `stop` is set; the first snapshot is published at once."""
        self._tell()
        while not stop.is_set():
            try:
                report, T_world_probe = self._waiting.get(timeout=0.1)
            except queue.Empty:
                continue
            try:
                self._work_off(report, T_world_probe)
            except RefusedError as error:
                self.refuse(error)
            self._tell()

    def _tell(self) -> None:
        self.published = self.snapshot()
        self._publish(self.published)

    def snapshot(self) -> Snapshot:
        """How the session stands; it plans the next action if it has not yet."""
        session = self.session
        with self._lock:
            refused, note = dict(self.refused), self._note
        return Snapshot(
            n_sensed=len(session.sensed),
            T_world_tip=self.tip(),
            proposal=session.propose(self._publish_pose),
            query=session.organ.query,
            probability=session.organ.on_lattice(session.prediction.probability, outside=0.0),
            organ=session.organ.organ,
            refused=refused,
            note=note,
        )

    def tip(self) -> NDArray[np.float64] | None:
        """Where the tip was last, shape (4, 4) [m]; None where nobody has said."""
        return self._tips[-1][1] if self._tips else None

    def _work_off(self, report: Report, T_world_probe: NDArray[np.float64] | None) -> None:
        if isinstance(report, PoseDeclined):
            self.session.decline(report.pose_index, report.reason)
        elif isinstance(report, PointsSensed) and T_world_probe is not None:
            self.session.observe(reading_of(report, T_world_probe, self.session.organ))

    def _remember(self, stamp_s: float, T_world_probe: NDArray[np.float64]) -> None:
        """Remember where the tip was, for as long as a reading may be of then.

        A reading is at most `stale_s` old, and its tip at most that much older. Tips that come thicker than memory
        holds for so long leave out those between.
        """
        tips, span_s = self._tips, 2.0 * self._settings.stale_s
        if len(tips) > 1 and 0.0 <= stamp_s - tips[-2][0] < span_s / MOST_TIPS:
            tips.pop()
        tips.append((stamp_s, T_world_probe))
        while len(tips) > MOST_TIPS or tips[0][0] < stamp_s - span_s:
            tips.popleft()

    def _tip_at(self, stamp_s: float) -> NDArray[np.float64]:
        """Where the tip was when something was sensed, shape (4, 4) [m].

        Raises:
            RefusedError: It is not known.
        """
        if not self._tips:
            raise RefusedError("unusable", "a reading came before any pose of the tip")
        tip_s, T_world_probe = min(self._tips, key=lambda tip: abs(tip[0] - stamp_s))
        if abs(stamp_s - tip_s) > self._settings.stale_s:
            raise RefusedError(
                "stale", f"the tip's pose and the reading are {abs(stamp_s - tip_s):.3g} s apart"
            )
        return T_world_probe

    def _fresh(self, report: Report) -> float:
        """The time of a report [s]; one without a stamp is of now, whatever the stamps of others say.

        Raises:
            RefusedError: It is older than one of its kind, or its clock is another.
        """
        now_s, stamp_s = self._clock(), report.stamp_s
        if stamp_s is None:
            return now_s
        if not abs(stamp_s - now_s) <= self._settings.stale_s:
            raise RefusedError("stale", f"its time stamp is {now_s - stamp_s:.3g} s before the clock here")
        if stamp_s < self._newest.get(type(report), 0.0):
            raise RefusedError("stale", "it is older than one that came before")
        return stamp_s
