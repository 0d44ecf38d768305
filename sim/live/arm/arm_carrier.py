"""The arm carrier: a driven arm takes the probe where a session proposes, and says where the tip really is."""

from __future__ import annotations

import threading
from collections.abc import Callable
from time import time

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.episode.setup import Setup
from sim.world.errors import WorldError
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.reading import Reading

from ..reports import PointsSensed, PoseDeclined, TipMoved
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
        self.error: WorldError | None = None
        """Why the arm was given up; None where it was not."""

    def serve(self, service: Service, stop: threading.Event, *, rate_hz: float) -> None:
        """Go to what a service proposes until it advises to end, the arm is given up, or `stop` is set.

        Args:
            service: Proposes, and gets the reports.
            stop: Stops the arm. It is set where the arm is given up.
            rate_hz: How often the tip's pose is reported while the arm stands [Hz].
        """
        self._service, self._stop = service, stop
        done: tuple[int, int | None] | None = None
        try:
            while not stop.wait(1.0 / rate_hz):
                newest = service.published
                # A reading that was refused leads to a snapshot too, and to no way.
                wanted = None if newest is None else _wanted(newest)
                if newest is None or wanted == done:
                    self._tell(self._tip())
                    continue
                done = wanted
                self._answer(newest, service)
        except WorldError as error:
            if not stop.is_set():
                self.error = error
        finally:
            stop.set()

    def _answer(self, seen: Snapshot, service: Service) -> None:
        """Go to the pose of a snapshot, and sense there where that is simulated."""
        pose = _wanted(seen)[1]
        if pose is None:
            return
        answer = self._positioner.reach(pose)
        reason = answer.explain()
        if answer.is_reached:
            reason = self._motion.move(self._data, pose).reason
        if reason:
            service.submit(PoseDeclined(pose_index=pose, reason=reason, stamp_s=time()))
            return
        self._tell(self._tip())
        if self._sense is not None and not self._stop.wait(self._settings.sensing_s):
            reading = self._sense(seen.n_sensed)
            now_s = self._tell(self._tip())
            if not len(reading.points_m):
                reason = "The sensor saw nothing of the organ there."
                service.submit(PoseDeclined(pose_index=pose, reason=reason, stamp_s=now_s))
                return
            service.submit(
                PointsSensed(points_m=reading.points_m, is_occupied=reading.is_occupied, stamp_s=now_s)
            )

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

    def _tell(self, T_world_probe: Array) -> float:
        """Say where the tip is, and return when that was [s]."""
        now_s = time()
        if self._service is not None:
            self._service.submit(TipMoved(T_world_probe=T_world_probe, stamp_s=now_s))
        return now_s


def _wanted(seen: Snapshot) -> tuple[int, int | None]:
    """Which action a snapshot proposes, and from which pose; None where it advises to end."""
    proposal = seen.proposal
    if proposal is None or proposal.advice != "sense":
        return seen.n_sensed, None
    return seen.n_sensed, proposal.pose_index
