"""Kinematics: IK from a sensing pose to joint positions, with the roll about the beam left free.

A search of many starts at once finds the most comfortable answer; `damped_least_squares.py` says what it minimises.
mink, a quadratic program per step with the joint limits as constraints, brings the answer within the tolerances.
MuJoCo's contacts and the organ's true surface verify it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import mink
import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.frames import frames_along
from sim.world.scene.clearance import Clearance, Collision
from sim.world.scene.scene import Scene

from .damped_least_squares import AXIS_WEIGHT_M
from .result import IkResult, IkStatus
from .search import IkSearch
from .settings import IkSettings

SEARCH_SLACK = 5.0
"""The search may miss the tolerances by this factor; mink closes the rest."""


class Kinematics:
    """Solves sensing poses for the arm of a scene."""

    def __init__(self, scene: Scene, clearance: Clearance, settings: IkSettings | None = None) -> None:
        """Build tasks, limits and the search of `scene`'s arm."""
        self.settings = settings or IkSettings()
        self._scene = scene
        self._clearance = clearance
        self._model = scene.model
        self._configuration = mink.Configuration(scene.model)
        self._tip_id = scene.model.site(scene.tip_site).id
        self._frame = mink.FrameTask(
            scene.tip_site,
            "site",
            # Costs per metre and per radian; the last is that of the roll about the beam, which is free.
            position_cost=1.0,
            orientation_cost=[AXIS_WEIGHT_M, AXIS_WEIGHT_M, 0.0],
            lm_damping=1e-6,
        )
        self._posture = mink.PostureTask(scene.model, cost=self.settings.posture_cost)
        self._limits: list[mink.Limit] = [mink.ConfigurationLimit(scene.model)]
        loose = replace(
            self.settings,
            position_tolerance_m=SEARCH_SLACK * self.settings.position_tolerance_m,
            angle_tolerance_rad=SEARCH_SLACK * self.settings.angle_tolerance_rad,
        )
        self.search = IkSearch(scene, clearance, loose)
        self._strict = self.search.with_settings(self.settings)

    def solve(self, position_m: NDArray[np.float64], normal: NDArray[np.float64]) -> IkResult:
        """Joint positions that bring the tip to a sensing pose, and to the stand-off above it.

        Args:
            position_m: Where the tip touches, world frame [m], shape (3,).
            normal: Inward unit normal: the direction of the beam, shape (3,).

        Raises:
            ValueError: A pose that is not finite, or a normal that is not of unit length.
        """
        return self.solve_many(np.asarray(position_m)[None], np.asarray(normal)[None])[0]

    def solve_many(self, positions_m: NDArray[np.float64], normals: NDArray[np.float64]) -> list[IkResult]:
        """The answers to many poses, each as `solve` gives it, in far less time than one after another.

        Args:
            positions_m: Where the tip touches, world frame [m], shape (N, 3).
            normals: Inward unit normals, shape (N, 3).

        Raises:
            ValueError: A pose that is not finite, or a normal that is not of unit length.
        """
        poses = [_checked_pose(*pose) for pose in zip(positions_m, normals, strict=True)]
        if not poses:
            return []
        found = self.search.search(*(np.array(part) for part in zip(*poses, strict=True))).results
        return [self._finished(result, *pose) for result, pose in zip(found, poses, strict=True)]

    def _finished(
        self, found: IkResult, position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> IkResult:
        """The search's answer within the tolerances, or why there is none."""
        if not found.is_reached:
            return found
        if (polished := self._polished(found, position_m, normal)) is not None:
            return polished
        # At the very rim of the reach mink may fail where a search with its tolerances does not.
        return self._strict.search(position_m[None], normal[None]).results[0]

    def _polished(
        self, found: IkResult, position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> IkResult | None:
        """The search's answer brought within the tolerances by mink and verified; None where that fails."""
        contact = self._converge(found.q, position_m, normal)
        above_m = position_m - self.settings.standoff_m * normal
        lifted = self._converge(found.q_standoff, above_m, normal)
        n_iterations = found.n_iterations + contact.n_iterations + lifted.n_iterations
        for part in (contact, lifted):
            if not part.is_reached or self.collision(part.q) is not None:
                return None
        if self.settings.padding_m > 0.0:
            ends = np.stack([contact.q, lifted.q])
            if not self.search.meter.measure(ends).is_free.all():
                return None
        return replace(contact, q_standoff=lifted.q, n_iterations=n_iterations, n_restarts=found.n_restarts)

    def errors(
        self, q: NDArray[np.float64], position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Distance [m] of the tip from a pose and angle [rad] of the beam from its normal, by forward kinematics."""
        data = self._configuration.data
        data.qpos[:] = q
        mujoco.mj_kinematics(self._model, data)
        return _pose_errors(data, self._tip_id, position_m, normal)

    def collision(self, q: NDArray[np.float64]) -> Collision | None:
        """The worst forbidden contact of a configuration, or None."""
        data = self._configuration.data
        data.qpos[:] = q
        mujoco.mj_kinematics(self._model, data)
        return self._clearance.collision(data)

    def _converge(
        self, q_start: NDArray[np.float64], position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> IkResult:
        """Where steps of mink from one start end, within tolerance or not; contacts are not looked at."""
        settings, configuration = self.settings, self._configuration
        configuration.update(q_start)
        self._posture.set_target(q_start)
        self._frame.set_target(_target(position_m, normal, configuration.data.site_xmat[self._tip_id]))
        distance_m, angle_rad, n = np.inf, np.inf, 0
        for n in range(settings.max_iterations + 1):
            distance_m, angle_rad = _pose_errors(configuration.data, self._tip_id, position_m, normal)
            if distance_m <= settings.position_tolerance_m and angle_rad <= settings.angle_tolerance_rad:
                q = configuration.q.copy()
                return IkResult(IkStatus.REACHED, q, q, distance_m, angle_rad, n, 0)
            try:
                step = mink.solve_ik(
                    configuration,
                    [self._frame, self._posture],
                    1.0,
                    "daqp",
                    damping=1e-8,
                    limits=self._limits,
                )
            except mink.NoSolutionFound:
                break
            largest = float(np.abs(step).max(initial=0.0))
            configuration.integrate_inplace(step * min(1.0, settings.max_step_rad / max(largest, 1e-12)), 1.0)
            self._hold_limits()
            if largest < 1e-6:
                break
        q = configuration.q.copy()
        return IkResult(IkStatus.NOT_CONVERGED, q, q, distance_m, angle_rad, n, 0)

    def _hold_limits(self) -> None:
        """Bring joints back that the solver's tolerance, about 1e-6, let beyond their limits."""
        q, chain = self._configuration.q, self.search.chain
        held = q.copy()
        held[chain.columns] = np.clip(q[chain.columns], chain.low, chain.high)
        if not np.array_equal(held, q):
            self._configuration.update(held)


def _checked_pose(
    position_m: NDArray[np.float64], normal: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    position_m, normal = np.asarray(position_m, dtype=np.float64), np.asarray(normal, dtype=np.float64)
    if position_m.shape != (3,) or not np.all(np.isfinite(position_m)):
        raise ValueError(f"position_m={position_m}: must be three finite numbers [m].")
    if normal.shape != (3,) or not abs(float(np.linalg.norm(normal)) - 1.0) < 1e-6:
        raise ValueError(f"normal={normal}: must be a unit vector of three finite numbers.")
    return position_m, normal


def _pose_errors(
    data: mujoco.MjData, tip_id: int, position_m: NDArray[np.float64], normal: NDArray[np.float64]
) -> tuple[float, float]:
    xmat = data.site_xmat[tip_id]
    bx, by, bz = float(xmat[2]), float(xmat[5]), float(xmat[8])
    nx, ny, nz = normal.tolist()
    sine = math.hypot(by * nz - bz * ny, bz * nx - bx * nz, bx * ny - by * nx)
    return math.dist(data.site_xpos[tip_id], position_m), math.atan2(sine, bx * nx + by * ny + bz * nz)


def _target(
    position_m: NDArray[np.float64], normal: NDArray[np.float64], xmat: NDArray[np.float64]
) -> mink.SE3:
    """T_world_tip with its z along the normal and the roll that turns the present tip least."""
    R = frames_along(normal[None], xmat.reshape(1, 3, 3)[:, :, 0])[0]
    return mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(R), position_m)
