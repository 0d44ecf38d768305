"""The motion of an arm that an outside controller drives along timed paths, and that is wherever it really got to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.episode.moving.arm_motion import limits_of, paths_of
from sim.episode.moving.motion import Motion, ProcedureStoppedError, joint_travel_rad
from sim.episode.moving.path_motion import PathMotion
from sim.episode.moving.plan import Plan
from sim.episode.moving.travel import Travel
from sim.episode.positioner import ArmPositioner
from sim.episode.setup import Setup
from sim.world.ik.chain import Chain
from sim.world.motion.arrival import BEAM_TOLERANCE_RAD, TIP_TOLERANCE_M, Arrival
from sim.world.motion.settings import MotionSettings

from .controller import ArmController, ArmState, ControllerError, Status
from .timed_path import ArmLimits, TimedPath

OFF_PATH = 0.02
"""An arm this far from where its path was to lead has not followed it [rad or m]; the way from there is unknown."""
MOST_STOPS = 20
"""An arm that was stopped on one path more often than this is given up."""
STATE_S = 0.01
"""A controller's clock that began anew is taken to go on so much after what it said last [s]: nobody knows better."""


class SteeredMotion(PathMotion):
    """A motion model that sends its timed paths to a controller, and takes the true state back."""

    def __init__(
        self,
        setup: Setup,
        controller: ArmController,
        settings: MotionSettings,
        watch: Callable[[NDArray[np.float64]], bool] = lambda q: True,
        show: Callable[[TimedPath], None] = lambda path: None,
    ) -> None:
        """Move the arm of a setup.

        Args:
            setup: Gives arm, workspace and organ.
            controller: Drives the arm.
            settings: Speeds.
            watch: Called with the chain's joints while the arm moves; False stops it.
            show: Called with each path that is sent.

        Raises:
            ControllerError: The controller drives another arm, or the setup has none.
        """
        positioner = setup.positioner
        if not isinstance(positioner, ArmPositioner):
            raise ControllerError("A free-flying probe cannot be steered: name the `arm` that is.")
        chain = positioner.search.chain
        if tuple(chain.names) != controller.names:
            raise ControllerError(
                f"The controller drives the joints {', '.join(controller.names)}, and the arm has "
                f"{', '.join(chain.names)}, from the base on. Name the `arm` that is driven, or the other controller."
            )
        paths, timer = paths_of(setup, positioner, settings)
        super().__init__(
            positioner, paths, timer, settings, Travel(positioner, None, settings), setup.scene.tip_site
        )
        own = ArmLimits(low=chain.low, high=chain.high, speed=limits_of(setup, positioner, settings).speed)
        self._controller, self._limits = controller, own.within(controller.limits)
        self._watch, self._show = watch, show
        self._rest_q = chain.home

    @property
    def chain(self) -> Chain:
        """The joints that are driven."""
        return self._chain

    def begin(self, data: mujoco.MjData) -> None:
        """Bring a state to where the arm is, and find the way on from there.

        Raises:
            ControllerError: It is where no way leads off.
        """
        q = self._rest_q = self._controller.state().q
        self._put(data, q)
        if self._paths.is_lifted_at(q):
            self._last, self._way_back = None, q[None]
            return
        # Near the organ: the arm was left in contact, or on the way to or from it.
        tip_m, poses_m = data.site(self._tip_site).xpos, self._positioner.workspace.positions_m
        reason = self.stand_at(data, int(np.argmin(np.linalg.norm(poses_m - tip_m, axis=1))))
        if reason:
            raise ControllerError(
                f"From where the arm is no way leads off: {reason} Bring it to where it is free by its own controller, "
                "and start again."
            )

    def look(self, data: mujoco.MjData) -> str:
        """Bring a state to where a standing arm is now, and say how it strayed from where it is to stand.

        Returns:
            A sentence; empty where the tip is within the tolerances of an arrival.

        Raises:
            ControllerError: The controller does not say where the arm is.
        """
        q = self._controller.state().q
        self._put(data, q)
        strayed = Arrival.of(self._chain.forward(np.stack([q, self._rest_q])), press_m=0.0)
        if strayed.is_there:
            return ""
        return (
            f"The arm was moved after it had come to rest: its tip is {strayed.error_m * 1e3:.1f} mm and its beam "
            f"{np.rad2deg(strayed.error_rad):.1f} degrees from where they are to be, and {TIP_TOLERANCE_M * 1e3:g} mm "
            f"and {np.rad2deg(BEAM_TOLERANCE_RAD):g} degrees are allowed. See what pushed it."
        )

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`; an arm that was moved meanwhile finds the way on from where it is."""
        if float(np.abs(self._controller.state().q - self._rest_q).max()) > OFF_PATH:
            self.begin(data)
        return super().move(data, pose)

    def _follow(self, data: mujoco.MjData, plan: Plan) -> Motion:
        """See `PathMotion._follow`; the arm is brought as far as it really got."""
        whole = TimedPath(names=self._controller.names, time_s=plan.time_s, q=plan.q, speed=plan.speed)
        whole.check(self._limits)
        states = self._states_along(whole)
        motion = self._motion_of(data, plan, states)
        self._rest_q = plan.q[-1] if motion.is_done else states[-1].q
        if states[-1].status is not Status.DONE:
            raise ProcedureStoppedError(
                f"The arm's controller did not bring it to the pose ({states[-1].status}): "
                f"{states[-1].text or 'it gave no reason.'} The arm stands still, and what was sensed is kept. Look "
                "after the arm and the line to its controller, and start again with the same options.",
                motion,
            )
        return motion

    def _states_along(self, whole: TimedPath) -> list[ArmState]:
        """Send a path, and what is left of it where the arm was stopped; nothing once the arm is not to move."""
        here = self._controller.state()
        states = [replace(here, status=Status.STOPPED, text="It was told to stop before it began.")]
        for n in range(MOST_STOPS + 1):
            if states[-1].status is not Status.STOPPED or not self._watch(states[-1].q):
                break
            begins = whole.begun_at if n == 0 else whole.rest_from
            part = begins(states[-1].q, farthest=OFF_PATH)
            part.check(self._limits)
            self._show(part)
            states += self._controller.follow(part, lambda state: self._watch(state.q))
        return states

    def _put(self, data: mujoco.MjData, q: NDArray[np.float64]) -> None:
        """Bring a state to where the joints are, shape (n,)."""
        data.qpos[:] = self._chain.full(q)
        mujoco.mj_fwdPosition(data.model, data)

    def _motion_of(self, data: mujoco.MjData, plan: Plan, states: list[ArmState]) -> Motion:
        """The motion that the arm's states show, to the end of which the state is brought."""
        time_s = elapsed([state.stamp_s for state in states])
        # Of states of one time the last counts, so that the end is always among them.
        is_new = np.r_[np.diff(time_s) > 0.0, True]
        q = np.stack([state.q for state in states])[is_new]
        nearest = [int(np.argmin(np.abs(plan.q - each).max(axis=1))) for each in q]
        full = self._chain.full(q)
        self._put(data, q[-1])
        arrival = Arrival.of(self._chain.forward(np.stack([q[-1], plan.q[-1]])), press_m=0.0)
        return Motion(
            time_s=time_s[is_new],
            states=full,
            tips_m=self._chain.forward(q).tips_m,
            phases=plan.phases[nearest],
            joint_travel_rad=joint_travel_rad(data.model, full),
            tracking_error_m=arrival.error_m,
            tracking_error_rad=arrival.error_rad,
            reason="" if arrival.is_there else arrival.reason(),
        )


def elapsed(stamps_s: Sequence[float]) -> NDArray[np.float64]:
    """Time since the first of some stamps [s], never falling: a clock that jumps back began anew, and goes on."""
    steps_s = np.diff(np.array(stamps_s, dtype=np.float64))
    return np.r_[0.0, np.cumsum(np.where(steps_s < 0.0, STATE_S, steps_s))]
