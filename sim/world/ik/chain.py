"""The serial chain from the world to the probe's tip, as arrays: forward kinematics of many configurations at once."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.body_tree import bodies_above, joints_above
from sim.world.frames import quaternion_matrix
from sim.world.scene.scene import Scene

Array = NDArray[np.float64]

MANY_TURNS_RAD = 100.0
"""A limit as far from zero as this is none: the hinge may turn on and on [rad]."""


@dataclass(frozen=True, eq=False)
class ChainState:
    """Tip and joints of N configurations of a chain of n joints, world frame."""

    tips_m: Array
    """Positions of the tip [m], shape (N, 3)."""
    R_world_tip: Array
    """Orientations of the tip; the third column is the beam, shape (N, 3, 3)."""
    axes: Array
    """Unit axes of the joints, shape (N, n, 3)."""
    anchors_m: Array
    """Points on those axes [m], shape (N, n, 3)."""

    @property
    def beams(self) -> Array:
        """Directions of the beam, shape (N, 3)."""
        return self.R_world_tip[:, :, 2]


class Chain:
    """The joints that move the probe's tip, taken from a compiled scene.

    T_world_tip = C_0 J_1(q_1) C_1 ... J_n(q_n) C_n, where each C is constant and each J turns about, or slides along,
    its own z. Joints beside the chain (a gripper's fingers) stay as they are at home.
    """

    def __init__(self, scene: Scene) -> None:
        """Read the chain of `scene`'s tip out of its model."""
        model = scene.model
        tip = model.site(scene.tip_site).id
        self.joints = np.array(joints_above(model, int(model.site_bodyid[tip])), dtype=np.int64)
        """Ids of the chain's joints, from the base on, shape (n,)."""
        self.columns = model.jnt_qposadr[self.joints]
        """Where the chain's joints lie in the scene's joint positions, shape (n,)."""
        self._home_q = scene.home_q.copy()
        self.names = [
            model.joint(joint).name.removeprefix("arm_") or f"joint{joint}" for joint in self.joints
        ]
        self.is_slide = model.jnt_type[self.joints] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        is_limited = model.jnt_limited[self.joints].astype(bool)
        low, high = model.jnt_range[self.joints].T
        self.low = np.where(is_limited & (low > -MANY_TURNS_RAD), low, -np.inf)
        self.high = np.where(is_limited & (high < MANY_TURNS_RAD), high, np.inf)
        self._zero = model.qpos0[self.columns].copy()
        self._R, self._p = _constants(model, self.joints, tip)
        self._T_world_base = scene.T_world_base

    def at_base(self, T_world_base: Array) -> Chain:
        """The same chain with its base at another frame, shape (4, 4)."""
        moved = copy.copy(self)
        T = T_world_base @ np.linalg.inv(self._T_world_base)
        moved._R, moved._p, moved._T_world_base = self._R.copy(), self._p.copy(), T_world_base.copy()
        moved._R[0] = T[:3, :3] @ self._R[0]
        moved._p[0] = T[:3, :3] @ self._p[0] + T[:3, 3]
        return moved

    @property
    def n_joints(self) -> int:
        """Number of joints of the chain."""
        return len(self.joints)

    @property
    def home(self) -> Array:
        """The chain's joints at home [rad or m], shape (n,)."""
        return self._home_q[self.columns]

    def search_range(self) -> tuple[Array, Array]:
        """Ranges that configurations are drawn from: the limits, or half a turn about home where there is none."""
        low = np.where(np.isfinite(self.low), self.low, self.home - np.pi)
        return low, np.where(np.isfinite(self.high), self.high, self.home + np.pi)

    def full(self, q: Array) -> Array:
        """Joint positions of the whole scene, shape (..., nq), from those of the chain, shape (..., n)."""
        positions = np.tile(self._home_q, (*q.shape[:-1], 1))
        positions[..., self.columns] = q
        return positions

    def limit_room(self, q: Array) -> Array:
        """Distance of each joint from its nearer limit [rad or m], infinite where it has none, shape (N, n)."""
        return np.minimum(q - self.low, self.high - q)

    def forward(self, q: Array) -> ChainState:
        """Tips and joints of configurations of the chain, shape (N, n)."""
        n_q = len(q)
        axes, anchors_m = np.empty((n_q, self.n_joints, 3)), np.empty((n_q, self.n_joints, 3))
        R = np.tile(self._R[0], (n_q, 1, 1))
        p = np.tile(self._p[0], (n_q, 1))
        turn = q - self._zero
        cos, sin = np.cos(turn)[:, :, None], np.sin(turn)[:, :, None]
        for i in range(self.n_joints):
            axes[:, i], anchors_m[:, i] = R[:, :, 2], p
            if self.is_slide[i]:
                p = p + turn[:, i, None] * R[:, :, 2]
            else:
                x, y = R[:, :, 0].copy(), R[:, :, 1]
                R[:, :, 0], R[:, :, 1] = cos[:, i] * x + sin[:, i] * y, cos[:, i] * y - sin[:, i] * x
            p = p + (R.reshape(-1, 3) @ self._p[i + 1]).reshape(-1, 3)
            R = (R.reshape(-1, 3) @ self._R[i + 1]).reshape(-1, 3, 3)
        return ChainState(p, R, axes, anchors_m)

    def jacobian(self, state: ChainState) -> Array:
        """How the tip moves with each joint, shape (N, 5, n).

        Rows: velocity of the tip in the world [m/s], then turning rate about the tip's own x and y [rad/s]; the turn
        about the beam is the roll, which is free.
        """
        lever_m = state.tips_m[:, None, :] - state.anchors_m
        jacobian = np.empty((len(lever_m), 5, self.n_joints))
        velocity = cross(state.axes, lever_m)
        velocity[:, self.is_slide] = state.axes[:, self.is_slide]
        jacobian[:, :3] = velocity.transpose(0, 2, 1)
        jacobian[:, 3:] = (state.axes @ state.R_world_tip[:, :, :2]).transpose(0, 2, 1)
        jacobian[:, 3:, self.is_slide] = 0.0
        return jacobian

    def manipulability(self, q: Array) -> Array:
        """Yoshikawa's sqrt(det(J J^T)) of the five directions that a sensing pose fixes [m^3], shape (N,)."""
        jacobian = self.jacobian(self.forward(q))
        return np.sqrt(np.maximum(np.linalg.det(jacobian @ jacobian.transpose(0, 2, 1)), 0.0))

    def axis_hub(self) -> tuple[float, float]:
        """Where the last joint lies beside the beam: its height above the tip along it, and its distance from it [m].

        That height is the same for every roll, so the pose tells the point of the beam there.
        """
        state = self.forward(self.home[None])
        offset_m = state.anchors_m[0, -1] - state.tips_m[0]
        height_m = float(offset_m @ state.beams[0])
        return height_m, float(np.linalg.norm(offset_m - height_m * state.beams[0]))

    def hub_reach(self) -> tuple[Array, float]:
        """The first joint's anchor [m], shape (3,), and the farthest that the last joint's can be from it [m].

        The sum of the links between them bounds the distance, whatever the joints do.
        """
        lengths_m = np.linalg.norm(self._p[1:-1], axis=1)
        travel_m = np.abs(np.stack([self.low, self.high]) - self._zero)[:, self.is_slide]
        slides_m = travel_m.max(axis=0, initial=0.0)
        return self._p[0], float(lengths_m.sum() + slides_m.sum())


def _constants(model: mujoco.MjModel, joints: NDArray[np.int64], tip: int) -> tuple[Array, Array]:
    """The constant rotations (n + 1, 3, 3) and shifts (n + 1, 3) [m] between joints whose own z is their axis."""
    rotations, shifts_m = [], []
    R, p = np.eye(3), np.zeros(3)
    for body in reversed(list(bodies_above(model, int(model.site_bodyid[tip])))):
        p, R = p + R @ model.body_pos[body], R @ quaternion_matrix(model.body_quat[body])
        for joint in joints[model.jnt_bodyid[joints] == body]:
            R_joint = _z_along(model.jnt_axis[joint])
            rotations.append(R @ R_joint)
            shifts_m.append(p + R @ model.jnt_pos[joint])
            R, p = R_joint.T, -R_joint.T @ model.jnt_pos[joint]
    rotations.append(R @ quaternion_matrix(model.site_quat[tip]))
    shifts_m.append(p + R @ model.site_pos[tip])
    return np.array(rotations), np.array(shifts_m)


def _z_along(axis: Array) -> Array:
    """A rotation that brings z to a unit axis, shape (3, 3); its roll says nothing, as the next constant undoes it."""
    side = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(side, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; np.cross takes three times as long on many small vectors."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
