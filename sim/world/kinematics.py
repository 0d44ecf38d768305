"""Kinematics: mink IK from a sensing pose to joint positions, with the roll about the beam left free."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mink
import mujoco
import numpy as np
from numpy.typing import NDArray

from .clearance import Clearance, Collision
from .ik_result import IkResult, IkStatus
from .scene import Scene


@dataclass(frozen=True, kw_only=True)
class IkSettings:
    """Tolerances and effort of the IK."""

    position_tolerance_m: float = 1e-4
    """Largest accepted distance of the tip from the pose."""
    angle_tolerance_rad: float = 2e-3
    """Largest accepted angle between the beam and the pose's normal."""
    max_iterations: int = 40
    """Steps of one start."""
    max_restarts: int = 20
    """Further starts after the first, from a fixed set of configurations near the pose."""
    max_step_rad: float = 0.5
    """No joint moves more than this in one step: the cap turns 440 of 500 solved poses into 475."""
    posture_cost: float = 1e-3
    """Weight that keeps the spare joint near its start; ten times more costs a sixth of the poses."""
    standoff_m: float = 0.04
    """The probe arrives from and leaves to this far above the surface, along the normal."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("position_tolerance_m", "angle_tolerance_rad", "max_step_rad", "standoff_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        if self.max_iterations < 1 or self.max_restarts < 0:
            raise ValueError(
                f"max_iterations={self.max_iterations}, max_restarts={self.max_restarts}: at least 1 and 0."
            )


N_SEEDS = 400
"""Configurations that restarts are taken from; at 400 the nearest is within a few centimetres of any pose."""
AXIS_WEIGHT_M = 0.3
"""A turn of the beam by one radian counts like this distance when seeds are compared with a pose."""


class Kinematics:
    """Solves sensing poses for the arm of a scene."""

    def __init__(self, scene: Scene, clearance: Clearance, settings: IkSettings | None = None) -> None:
        """Build tasks, limits and the set of start configurations of `scene`'s arm."""
        self.settings = settings or IkSettings()
        self._scene = scene
        self._clearance = clearance
        self._model = scene.model
        self._configuration = mink.Configuration(scene.model)
        self._tip_id = scene.model.site(scene.tip_site).id
        self._frame = mink.FrameTask(
            scene.tip_site, "site", position_cost=1.0, orientation_cost=[0.3, 0.3, 0.0], lm_damping=1e-6
        )
        self._posture = mink.PostureTask(scene.model, cost=self.settings.posture_cost)
        self._limits: list[mink.Limit] = [mink.ConfigurationLimit(scene.model)]
        self._reach_m, self._shoulder_m = _reach_bound(scene)
        self._seeds = self._make_seeds()

    def solve(self, position_m: NDArray[np.float64], normal: NDArray[np.float64]) -> IkResult:
        """Joint positions that bring the tip to a sensing pose, and to the stand-off above it.

        Args:
            position_m: Where the tip touches, world frame [m], shape (3,).
            normal: Inward unit normal: the direction of the beam, shape (3,).

        Raises:
            ValueError: A pose that is not finite, or a normal that is not of unit length.
        """
        position_m, normal = _checked_pose(position_m, normal)
        if np.linalg.norm(position_m - self._shoulder_m) > self._reach_m:
            q = self._scene.home_q
            return IkResult(IkStatus.TOO_FAR, q, q, *self.errors(q, position_m, normal), 0, 0)
        if (hit := self._clearance.probe_collision(_frame_at(position_m, normal))) is not None:
            q = self._scene.home_q
            detail = f"However the arm stands, {hit}."
            return IkResult(IkStatus.COLLISION, q, q, *self.errors(q, position_m, normal), 0, 0, detail)
        best: IkResult | None = None
        n_iterations = 0
        for restart, q_start in enumerate(self._starts(position_m, normal)):
            result = self._attempt(q_start, position_m, normal)
            n_iterations += result.n_iterations
            result = replace(result, n_iterations=n_iterations, n_restarts=restart)
            if result.is_reached:
                return result
            best = result if best is None else _better(best, result)
        assert best is not None
        return replace(best, n_iterations=n_iterations, n_restarts=self.settings.max_restarts)

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

    def _attempt(
        self, q_start: NDArray[np.float64], position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> IkResult:
        """Pose, then stand-off, from one start, both verified."""
        contact = self._converge(q_start, position_m, normal)
        if not contact.is_reached:
            return contact
        if (hit := self.collision(contact.q)) is not None:
            return replace(contact, status=IkStatus.COLLISION, detail=f"At the pose {hit}.")
        above_m = position_m - self.settings.standoff_m * normal
        lifted = self._converge(contact.q, above_m, normal)
        if not lifted.is_reached:
            return replace(
                contact, status=lifted.status, detail=f"Above the pose: {lifted.detail or 'no answer.'}"
            )
        if (hit := self.collision(lifted.q)) is not None:
            return replace(contact, status=IkStatus.COLLISION, detail=f"Above the pose {hit}.")
        return replace(contact, q_standoff=lifted.q)

    def _converge(
        self, q_start: NDArray[np.float64], position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> IkResult:
        """Iterate differential IK from one start until within tolerance; contacts are not looked at."""
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
            step = mink.solve_ik(
                configuration, [self._frame, self._posture], 1.0, "daqp", damping=1e-8, limits=self._limits
            )
            largest = float(np.abs(step).max(initial=0.0))
            configuration.integrate_inplace(step * min(1.0, settings.max_step_rad / max(largest, 1e-12)), 1.0)
            if largest < 1e-6:
                break
        q = configuration.q.copy()
        at_limit = self._joint_at_limit(q)
        status = IkStatus.JOINT_LIMIT if at_limit else IkStatus.NOT_CONVERGED
        return IkResult(status, q, q, distance_m, angle_rad, n, 0, at_limit)

    def _joint_at_limit(self, q: NDArray[np.float64]) -> str:
        """A phrase naming a joint that stands at its limit, or an empty one."""
        low, high = self._model.jnt_range.T
        room = np.minimum(q - low, high - q)[: self._model.njnt]
        room[~self._model.jnt_limited.astype(bool)] = np.inf
        joint = int(np.argmin(room))
        return (
            f"{self._model.joint(joint).name} is at its limit ({q[joint]:+.3f})."
            if room[joint] < 1e-3
            else ""
        )

    def _starts(
        self, position_m: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Home first, then the seeds whose tip is nearest to the pose."""
        q, tips_m, beams = self._seeds
        turn_rad = np.arccos(np.clip(beams @ normal, -1.0, 1.0))
        away = np.linalg.norm(tips_m - position_m, axis=1) + AXIS_WEIGHT_M * turn_rad
        order = np.argsort(away, kind="stable")[: self.settings.max_restarts]
        return [self._scene.home_q, *q[order]]

    def _make_seeds(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Collision-free configurations (K, n) with their tip positions (K, 3) [m] and beams (K, 3)."""
        low, high = _search_range(self._model, self._scene.home_q)
        rng = np.random.default_rng(
            0
        )  # a constant of the algorithm: the same starts for every seed of an episode
        found: list[NDArray[np.float64]] = [self._scene.home_q]
        for q in rng.uniform(low, high, (4 * N_SEEDS, self._model.nq)):
            if self.collision(q) is None:
                found.append(q)
            if len(found) == N_SEEDS:
                break
        tips_m, beams = np.empty((len(found), 3)), np.empty((len(found), 3))
        data = self._configuration.data
        for i, q in enumerate(found):
            data.qpos[:] = q
            mujoco.mj_kinematics(self._model, data)
            tips_m[i], beams[i] = (
                data.site_xpos[self._tip_id],
                data.site_xmat[self._tip_id].reshape(3, 3)[:, 2],
            )
        return np.array(found), tips_m, beams


def _better(first: IkResult, second: IkResult) -> IkResult:
    """The result that came closer: a collision at the pose beats one that never got there."""

    def rank(result: IkResult) -> tuple[bool, float]:
        return result.status is not IkStatus.COLLISION, result.position_error_m + 0.1 * result.angle_error_rad

    return min(first, second, key=rank)


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


def _frame_at(position_m: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """A T_world_probe at a sensing pose, of any roll, shape (4, 4)."""
    T_world_probe = np.eye(4)
    T_world_probe[:3, :3] = _target(position_m, normal, np.eye(3)).as_matrix()[:3, :3]
    T_world_probe[:3, 3] = position_m
    return T_world_probe


def _target(
    position_m: NDArray[np.float64], normal: NDArray[np.float64], xmat: NDArray[np.float64]
) -> mink.SE3:
    """T_world_tip with its z along the normal and the roll that turns the present tip least."""
    x_axis = xmat.reshape(3, 3)[:, 0]
    x_axis = x_axis - (x_axis @ normal) * normal
    if np.linalg.norm(x_axis) < 1e-6:
        x_axis = np.linalg.svd(normal[None])[2][1]
    x_axis = x_axis / np.linalg.norm(x_axis)
    R = np.column_stack([x_axis, np.cross(normal, x_axis), normal])
    return mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(R), position_m)


def _reach_bound(scene: Scene) -> tuple[float, NDArray[np.float64]]:
    """A distance [m] from the first joint's anchor that the tip can never pass, and that anchor [m], shape (3,).

    The sum of the offsets along the chain, plus the full travel of every slide joint.
    """
    model, data = scene.model, scene.new_data()
    tip = model.site(scene.tip_site).id
    body, reach_m = int(model.site_bodyid[tip]), float(np.linalg.norm(model.site_pos[tip]))
    anchor_m = data.site_xpos[tip].copy()
    while body != 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count):
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                reach_m += float(np.abs(model.jnt_range[joint]).max())
            reach_m += 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
            anchor_m = data.xpos[body].copy()
        if count and not _has_joint_above(model, body):
            break
        reach_m += float(np.linalg.norm(model.body_pos[body]))
        body = int(model.body_parentid[body])
    return reach_m, anchor_m


def _has_joint_above(model: mujoco.MjModel, body: int) -> bool:
    parent = int(model.body_parentid[body])
    while parent != 0:
        if model.body_jntnum[parent]:
            return True
        parent = int(model.body_parentid[parent])
    return False


def _search_range(
    model: mujoco.MjModel, home_q: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ranges that seeds are drawn from: the joint limits, or one turn about home where there is none."""
    limited = model.jnt_limited.astype(bool)
    low = np.where(limited, model.jnt_range[:, 0], home_q - np.pi)
    high = np.where(limited, model.jnt_range[:, 1], home_q + np.pi)
    return low, high
