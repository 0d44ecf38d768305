"""A simulated probe: it flies to where it is sent in real time, and senses the truth of a seed as an episode would."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from time import time

import numpy as np
from numpy.typing import NDArray

from sim.episode.planned.checks import checked_reading
from sim.episode.setup import Setup
from sim.episode.truth import make_truth
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor

from .errors import RefusedError
from .reports import SAW_NOTHING, PointsSensed, PoseDeclined, TipMoved
from .service import Service
from .snapshot import Snapshot

TRUTH_STREAM, SENSOR_STREAM = 0, 1
"""Which of the streams that an episode spawns from its seed are the truth's and the sensor's."""
LIFT_M = 0.03
"""How far the tip is lifted off the organ on its way [m]."""


@dataclass(frozen=True, kw_only=True)
class Flight:
    """How a simulated probe flies."""

    rate_hz: float
    """How often the tip's pose is reported [Hz]."""
    speed: float
    """How many times faster than a real probe it is; 0 jumps and does not wait."""
    settings: MotionSettings
    """How fast a real probe moves, and how long it senses."""

    def way(
        self, T_start: NDArray[np.float64] | None, T_end: NDArray[np.float64]
    ) -> Iterator[NDArray[np.float64]]:
        """Poses of the tip on its way: off the organ, over, and down on it; the last is the end."""
        if T_start is not None and self.speed > 0.0:
            off, over = _lifted(T_start), _lifted(T_end)
            legs = ((T_start, off), (off, over), (over, T_end))
            approach_m_s, tip_m_s = self.settings.approach_speed_m_s, self.settings.tip_speed_m_s
            for (T_a, T_b), speed_m_s in zip(legs, (approach_m_s, tip_m_s, approach_m_s), strict=True):
                length_m = float(np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]))
                n = max(1, int(length_m / (speed_m_s * self.speed) * self.rate_hz))
                for i in range(n):
                    T = (T_b if i > n / 2 else T_a).copy()
                    T[:3, 3] = T_a[:3, 3] + (T_b[:3, 3] - T_a[:3, 3]) * (i / n)
                    yield T
        yield T_end


class SimulatedProbe:
    """A probe in the scene of a seed's truth, which flies where it is sent unless somebody carries it."""

    def __init__(self, setup: Setup, sensor: Sensor, *, seed: int) -> None:
        """Plant the tumours of a seed.

        Args:
            setup: The setup; one with an arm is carried by somebody else, who changes `data`.
            sensor: Makes the readings.
            seed: Seed of truth and sensor, as in an episode.

        Raises:
            WorldError: No place for the tumours was found.
        """
        streams = np.random.default_rng(seed).spawn(SENSOR_STREAM + 1)
        self.truth = make_truth(setup, streams[TRUTH_STREAM])
        self._setup, self._sensor, self._rng = setup, sensor, streams[SENSOR_STREAM]
        self.data = self.truth.scene.new_data()
        """The state of the scene, which whoever carries the probe may change."""
        self._state, self._seed = SceneState(self.truth.scene, self.data), seed
        self.error: Exception | None = None
        """Why the flight ended; None where nothing went wrong."""

    def sense(self, T_world_probe: NDArray[np.float64]) -> Reading:
        """What the sensor reads with the tip at a pose, shape (4, 4) [m]."""
        self._setup.positioner.shift(self.data, T_world_probe)
        return checked_reading(self._sensor, self._state, self._rng)

    def sense_here(self, action: int) -> Reading:
        """What the sensor reads where the tip of `data` is; its stream is that of the action, whatever came before."""
        rng = np.random.default_rng((self._seed, SENSOR_STREAM, action))
        return checked_reading(self._sensor, self._state, rng)

    def serve(self, service: Service, stop: threading.Event, flight: Flight) -> None:
        """Fly to what a service proposes and report what is sensed there, until it advises to end or `stop` is set.

        Args:
            service: Proposes, and gets the reports.
            stop: Ends the flight; it is set where something goes wrong.
            flight: How it flies.
        """
        try:
            self._fly(service, stop, flight)
        except Exception as error:
            # Nobody else would hear of a fault in a thread.
            self.error = error
            stop.set()

    def _fly(self, service: Service, stop: threading.Event, flight: Flight) -> None:
        T_now: NDArray[np.float64] | None = None
        answered: Snapshot | None = None
        while not stop.is_set():
            seen = service.published
            if seen is None or seen is answered or seen.proposal is None:
                stop.wait(0.005)
                continue
            T_next, (_, pose) = seen.proposal.T_world_probe, seen.wanted
            if T_next is None or pose is None:
                return
            is_refused = answered is not None and seen.wanted == answered.wanted
            answered = seen
            if is_refused:
                service.submit(PoseDeclined(pose_index=pose, reason=seen.note, stamp_s=None))
                continue
            for T in flight.way(T_now, T_next):
                service.submit(TipMoved(T_world_probe=T, stamp_s=time()))
                if flight.speed > 0.0 and stop.wait(1.0 / flight.rate_hz):
                    return
            T_now, reading = T_next, self.sense(T_next)
            if flight.speed > 0.0 and stop.wait(flight.settings.sensing_s / flight.speed):
                return
            # Without stamps: these are of now, and no clock of the outside makes them old.
            service.submit(TipMoved(T_world_probe=T_next, stamp_s=None))
            _report(service, reading, pose)


def _report(service: Service, reading: Reading, pose: int) -> None:
    """Report a reading, or that a pose has none that can be used."""
    reason = SAW_NOTHING
    if len(reading.points_m):
        try:
            service.take(PointsSensed.of_reading(reading, stamp_s=None))
            return
        except RefusedError as error:
            service.refuse(error)
            reason = str(error)
    service.submit(PoseDeclined(pose_index=pose, reason=reason, stamp_s=None))


def _lifted(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose of the tip drawn back along its beam."""
    lifted = T.copy()
    lifted[:3, 3] -= LIFT_M * T[:3, 2]
    return lifted
