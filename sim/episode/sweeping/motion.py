"""The motion of a sweep: the probe glides to where it is wanted, reads on the way, and is lifted where it must be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Planner, Situation
from sim.world.ik.settings import IkSettings
from sim.world.motion.settings import MotionSettings

from ..moving.motion import Motion, MotionModel, Phase, joined, set_state, state_of
from ..moving.travel import Travel
from ..planned.checks import checked_paths
from .ground import Ground
from .settings import SweepSettings
from .slides import Slide
from .surface_way import SMOOTH_M, SurfaceWay, surface_way

MOST_DETOUR = 2.0
"""A way over the surface that takes more than this many times as long as flying and the sensing after it is flown."""


class SweepMotion(MotionModel):
    """A motion model that keeps the probe on the organ where it can, and has another model fly where it cannot."""

    senses_in_motion = True

    def __init__(
        self,
        inner: MotionModel,
        ground: Ground,
        slide: Slide,
        settings: SweepSettings,
        speeds: MotionSettings,
    ) -> None:
        """Glide over `ground`, and fly as another model does.

        Args:
            inner: Flies: lifts the probe, brings it over and down. It moves what the ground's setup carries.
            ground: Where the probe glides.
            slide: Brings it along a way.
            settings: How fast it glides, and how often it reads.
            speeds: How fast it flies, and how long the first reading after that takes.
        """
        self._inner, self._ground, self._slide = inner, ground, slide
        self._settings, self._speeds = settings, speeds
        self.travel = self._times = SweepTravel(ground, settings, speeds)
        self.notices = (*inner.notices, *ground.notices)
        self._at: int | None = None
        self._via: tuple[int, ...] = ()

    def extended(self, situation: Situation) -> Situation:
        """See `MotionModel.extended`: where the probe glides, how fast, and how often it reads."""
        return replace(
            situation,
            roadmap=self._ground.roadmap,
            sweep_speed_m_s=self._settings.speed_m_s,
            read_every_m=self._settings.read_every_m,
        )

    def ranking(self, planner: Planner, situation: Situation) -> Iterator[int]:
        """See `MotionModel.ranking`: the ends of the planner's paths; the last one that was asked for is gone."""
        n_poses = self._ground.setup.workspace.n_poses
        for path in checked_paths(planner, planner.paths(self.extended(situation)), n_poses):
            self._via = path[:-1]
            yield path[-1]

    def halts(self, data: mujoco.MjData, motion: Motion) -> Iterator[int | None]:
        """See `MotionModel.halts`."""
        for pose, row in zip(motion.passed, motion.passed_rows, strict=True):
            set_state(data, motion.states[row])
            yield pose
        set_state(data, motion.states[-1])

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`: by way of the poses that the planner's path names."""
        stops, self._via = [*self._via, pose], ()
        path = self._path_through(stops)
        if len(stops) > 1 and path and not isinstance(motion := self._slid(data, path), str):
            self._at = pose if motion.is_done else None
            return motion
        legs = [self._leg(data, stop) for stop in stops]
        begun = [leg for leg in legs if len(leg.time_s)]
        if not begun:
            return legs[-1]
        return replace(joined(begun), reason=legs[-1].reason)

    def _path_through(self, stops: Sequence[int]) -> tuple[int, ...]:
        """The poses of the way over the surface by some stops; empty where the probe has to be lifted on it."""
        if self._at is None:
            return ()
        path = [self._at]
        for stop in stops:
            if stop == path[-1]:
                continue
            way = self._ground.roadmap.ways_from(path[-1]).to(stop)
            if not way or not self._times.is_worth_sliding(path[-1], stop):
                return ()
            path += way[1:]
        return tuple(path) if len(path) > 1 else ()

    def _leg(self, data: mujoco.MjData, stop: int) -> Motion:
        """The motion from where the probe is to a pose."""
        if stop == self._at:
            return self._read_again(data, stop)
        if self._at is not None:
            path = self._ground.roadmap.ways_from(self._at).to(stop)
            if len(path) > 1 and self._times.is_worth_sliding(self._at, stop):
                motion = self._slid(data, path)
                if not isinstance(motion, str):
                    self._at = stop if motion.is_done else None
                    return motion
        motion = self._inner.move(data, stop)
        # After a miss the probe is somewhere above the organ.
        self._at = stop if motion.is_done else self._at if not len(motion.time_s) else None
        return self._read_after(motion, stop) if motion.is_done else motion

    def _read_again(self, data: mujoco.MjData, pose: int) -> Motion:
        """The motion of a probe that stays where it is for a reading."""
        tip_m = data.site(self._ground.setup.scene.tip_site).xpos
        return Motion(
            time_s=np.array([0.0, 1.0 / self._settings.frame_rate_hz]),
            states=np.tile(state_of(data), (2, 1)),
            tips_m=np.tile(tip_m, (2, 1)),
            phases=np.full(2, Phase.HOLD, dtype=np.int8),
            joint_travel_rad=0.0 if data.model.nq else None,
            held=self._slide.nothing_held,
            passed=(pose,),
            passed_rows=(1,),
        )

    def _slid(self, data: mujoco.MjData, path: Sequence[int]) -> Motion | str:
        """The slide along a path of neighbours, or why there is none."""
        before, reason = state_of(data), ""
        for smooth_m in (SMOOTH_M, 0.0):
            way = self._way(path, smooth_m)
            if not self._ground.is_allowed(way.places_m).all():
                reason = "The way over the surface crosses what must not be pressed."
                continue
            rows = way.readings(self._settings.read_every_m)
            motion = self._slide.move(data, way, rows)
            if isinstance(motion, str):
                reason = motion
                continue
            if not motion.is_done:
                return replace(motion, passed_rows=())
            if reason := self._inner.stand_at(data, path[-1]):
                set_state(data, before)
                return reason
            lever_m = self._ground.setup.cone.depth_m / 2.0
            poses = self._ground.roadmap.nearest(way.places_m[rows], way.beams[rows], lever_m)
            poses[-1] = path[-1]
            return replace(motion, passed=tuple(poses.tolist()))
        return reason

    def _way(self, path: Sequence[int], smooth_m: float) -> SurfaceWay:
        ground = self._ground
        tilt_rad = self._settings.most_tilt_rad
        return surface_way(
            ground.setup.workspace, path, ground.surface, most_tilt_rad=tilt_rad, smooth_m=smooth_m
        )

    def _read_after(self, motion: Motion, pose: int) -> Motion:
        """A flight with the time that the probe stays still at its end for a reading."""
        return replace(
            motion,
            time_s=np.append(motion.time_s, motion.motion_s + self._speeds.sensing_s),
            states=np.vstack([motion.states, motion.states[-1:]]),
            tips_m=np.vstack([motion.tips_m, motion.tips_m[-1:]]),
            phases=np.append(motion.phases, np.int8(Phase.HOLD)),
            held=self._slide.nothing_held,
            passed=(pose,),
            passed_rows=(len(motion.time_s),),
        )


class SweepTravel(Travel):
    """An estimate of how long a sweep takes from pose to pose: gliding, or flying where that is far shorter."""

    def __init__(self, ground: Ground, settings: SweepSettings, speeds: MotionSettings) -> None:
        """Glide over `ground`, and fly at the tip's speeds."""
        self._ground, self._sweep, self._speeds = ground, settings, speeds
        self._up_down_s = 2.0 * IkSettings().standoff_m / speeds.approach_speed_m_s

    def seconds(self, start: int, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        """See `Travel.seconds`; here lift, descent and the sensing after them are in it."""
        glide_s, fly_s = self._glide_s(start, poses), self._fly_s(start, poses)
        return np.where(glide_s <= MOST_DETOUR * fly_s, glide_s, fly_s)

    def is_worth_sliding(self, start: int, end: int) -> bool:
        """Whether the probe glides from a pose to another rather than flies."""
        poses = np.array([end])
        return bool(self._glide_s(start, poses)[0] <= MOST_DETOUR * self._fly_s(start, poses)[0])

    def _glide_s(self, start: int, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._ground.roadmap.ways_from(start).lengths_m[poses] / self._sweep.speed_m_s

    def _fly_s(self, start: int, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        places_m = self._ground.setup.workspace.positions_m
        over_s = np.linalg.norm(places_m[poses] - places_m[start], axis=1) / self._speeds.tip_speed_m_s
        return over_s + self._up_down_s + self._speeds.sensing_s
