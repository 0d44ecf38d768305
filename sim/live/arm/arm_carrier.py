"""The arm carrier: a driven arm takes the probe where a session proposes, and says where the tip really is."""

from __future__ import annotations

import threading
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.episode.setup import Setup
from sim.world.errors import WorldError
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.reading import Reading

from ..errors import RefusedError
from ..reports import SAW_NOTHING, PointsSensed, PoseDeclined, TipMoved
from ..service import Service
from ..snapshot import Snapshot
from .controller import ArmController
from .steered_motion import SteeredMotion
from .timed_path import TimedPath

Array = NDArray[np.float64]


class ArmCarrier:
    """An arm between a service, which proposes, and a controller, which drives. A thread of its own serves it."""

    def __init__(
        self,
        setup: Setup,
        data: mujoco.MjData,
        controller: ArmController,
        settings: MotionSettings,
        *,
        sense: Callable[[int], Reading] | None = None,
        show: Callable[[TimedPath], None] = lambda path: None,
    ) -> None:
        """Stand where the arm is.

        Args:
            setup: Gives arm, workspace and organ.
            data: A state of its scene, which is kept where the arm really is.
            controller: Drives the arm.
            settings: Speeds, and how long sensing takes.
            sense: Reads the simulated truth for an action by its number; None where readings come from outside.
            show: Called with each path that the arm is sent.

        Raises:
            ControllerError: It is another arm, does not say where it is, or stands where no way leads off.
        """
        self._data, self._sense, self._settings = data, sense, settings
        self._site, self._positioner = setup.scene.tip_site, setup.positioner
        self._stop, self._service = threading.Event(), None
        self._service: Service | None
        self._motion = SteeredMotion(setup, controller, settings, self._moves_on, show)
        self._motion.begin(data)
        self.error: Exception | None = None
        """Why the arm was given up; None where it was not."""
        self._answered: Snapshot | None = None
        self._at: int | None = None  # the pose at which the arm stands until a reading is taken
        self._owed: PoseDeclined | PointsSensed | None = None  # what the service has not taken yet

    def serve(self, service: Service, stop: threading.Event, *, rate_hz: float) -> None:
        """Go to what a service proposes until it advises to end, the arm is given up, or `stop` is set.

        Args:
            service: Proposes, and gets the reports.
            stop: Stops the arm. It is set where the arm is given up.
            rate_hz: How often the tip's pose is reported while the arm stands [Hz].
        """
        self._service, self._stop = service, stop
        try:
            while not stop.wait(1.0 / rate_hz):
                self._attend(service)
        except WorldError as error:
            # A controller that is left while a stopped arm is waited for is no fault.
            if not stop.is_set():
                self.error = error
        except Exception as error:
            # Nobody else would hear of a fault in a thread.
            self.error = error
        finally:
            stop.set()

    def _attend(self, service: Service) -> None:
        """Do what the newest snapshot asks for, or see where the arm stands; and say what the service did not take."""
        newest = service.published
        # A reading that was refused leads to a snapshot too, and to no way.
        if newest is not None and (self._answered is None or newest.wanted != self._answered.wanted):
            self._answered, self._at, self._owed = newest, None, None
            self._owed = self._answer(newest)
        elif newest is not None and (refused := self._refused(newest)) is not None:
            self._answered, self._owed = newest, _declined(refused, newest.note)
        else:
            strayed = self._look()
            # A reading that was taken but not yet learnt from was taken before the arm strayed.
            is_taken = newest is not None and len(service.session.sensed) > newest.n_sensed
            if strayed and self._at is not None and not is_taken:
                self._owed = _declined(self._at, strayed)
        if self._owed is not None:
            self._say(service, self._owed)

    def _refused(self, newest: Snapshot) -> int | None:
        """The pose of a simulated reading that was refused: a new snapshot wants what was answered; None where none."""
        is_answered = self._sense is not None and self._owed is None and self._at is None
        return newest.wanted[1] if is_answered and newest is not self._answered else None

    def _say(self, service: Service, owed: PoseDeclined | PointsSensed) -> None:
        """Say what is owed: again later where the service has too much to do; what is of no use is a pose declined."""
        try:
            service.take(owed)
        except RefusedError as error:
            service.refuse(error)
            if error.kind != "too many" and isinstance(owed, PointsSensed) and self._at is not None:
                self._owed = _declined(self._at, str(error))
            return
        self._at, self._owed = None, None

    def _answer(self, seen: Snapshot) -> PoseDeclined | PointsSensed | None:
        """Go to the pose of a snapshot, and sense there where that is simulated; what there is to report of it."""
        _, pose = seen.wanted
        if pose is None:
            return None
        answer = self._positioner.reach(pose)
        reason = answer.explain()
        if answer.is_reached:
            reason = self._motion.move(self._data, pose).reason
        if reason:
            return _declined(pose, reason)
        self._at = pose
        self._tell(self._tip())
        if self._sense is None or self._stop.wait(self._settings.sensing_s):
            return None
        if strayed := self._look():
            return _declined(pose, strayed)
        reading = self._sense(seen.n_sensed)
        if not len(reading.points_m):
            return _declined(pose, SAW_NOTHING)
        return PointsSensed.of_reading(reading, stamp_s=None)

    def _look(self) -> str:
        """See where the arm stands, tell it, and say how it strayed; empty where it did not."""
        strayed = self._motion.look(self._data)
        self._tell(self._tip())
        return strayed

    def _moves_on(self, q: Array) -> bool:
        """Tell where the tip is while the arm moves, and whether it may move on."""
        tip, T = self._motion.chain.forward(q[None]), np.eye(4)
        T[:3, :3], T[:3, 3] = tip.R_world_tip[0], tip.tips_m[0]
        self._tell(T)
        return not self._stop.is_set()

    def _tip(self) -> Array:
        """Where the tip of the state is, shape (4, 4) [m]."""
        site = self._data.site(self._site)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = site.xmat.reshape(3, 3), site.xpos
        return T

    def _tell(self, T_world_probe: Array) -> None:
        """Say where the tip is now."""
        if self._service is not None:
            self._service.submit(TipMoved(T_world_probe=T_world_probe, stamp_s=None))


def _declined(pose: int, reason: str) -> PoseDeclined:
    # No stamp: it is of now, and what clocks of the outside say does not make it old.
    return PoseDeclined(pose_index=pose, reason=reason, stamp_s=None)
