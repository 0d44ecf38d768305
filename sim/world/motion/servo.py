"""The servo-driven arm: MuJoCo's dynamics under position servos, with the probe pressing on a compliant organ.

MuJoCo would touch the organ's convex hull, so the organ stays out of its contacts: a spring and a damper act on the
tip along the normal of the true surface, by the exact distance to its triangles.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.mujoco_messages import caught_warnings
from sim.world.ik.chain import Array, Chain
from sim.world.scene.scene import Scene

from .contact_surface import ContactSurface
from .settings import FACE_M, LIVER_YOUNG_PA, ServoSettings, punch_stiffness_n_m

PANDA_KP = (4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0)
"""Gains of the servos of MuJoCo Menagerie's Panda [N m / rad]; damping a tenth of them [N m s / rad]."""
OTHER_FREQUENCY_RAD_S = 60.0
"""Servos of other arms are critically damped at this frequency, by the joints' inertia at home."""
FASTEST_M_S = 2.0
"""Away from the organ, contact is looked for again when the tip could have got there at this speed."""


@dataclass(frozen=True, eq=False)
class ServoRun:
    """What the simulated arm did, at every recorded time."""

    states: Array
    """Joint positions of the scene, shape (T, nq)."""
    tips_m: Array
    """Positions of the tip [m], shape (T, 3)."""
    force_n: Array
    """Contact force [N], shape (T,)."""
    peak_force_n: float
    """The largest of all steps, also between recorded times [N]."""
    is_stopped: bool
    """Whether the force limit ended it; the arrays then end there."""
    is_unstable: bool
    """Whether the dynamics ran away; the arrays then end before, and there the arm stands still."""


class TipContact(Protocol):
    """What acts on the tip in place of the spring along the surface's normal."""

    def force_along_beam_n(self, data: mujoco.MjData, tip: Array, beam: Array, tip_m_s: Array) -> float:
        """The force on the tip against the beam [N].

        Args:
            data: A state whose kinematics are up to date.
            tip: Where the tip is [m], shape (3,).
            beam: The direction of the beam, shape (3,).
            tip_m_s: The tip's velocity [m/s], shape (3,).
        """
        ...


class ServoArm:
    """An arm with servos, simulated on its own copy of a scene; keeps its state from run to run."""

    def __init__(
        self,
        scene: Scene,
        chain: Chain,
        organ: ContactSurface,
        settings: ServoSettings,
        *,
        is_panda: bool,
        face_radius_m: float = FACE_M,
    ) -> None:
        """Prepare the copy: it has no actuators but the servos, whose damping is put into the joints, and no weight."""
        model = self.model = copy.copy(scene.model)
        self._organ, self._settings = organ, settings
        own_n_m = punch_stiffness_n_m(LIVER_YOUNG_PA, face_radius_m)
        self.stiffness_n_m = own_n_m if settings.stiffness_n_m is None else settings.stiffness_n_m
        """The spring under the tip [N/m]."""
        self._tip = model.site(scene.tip_site).id
        # The weight of every body is compensated, as gravcomp="1" does, also of arms whose files do not say so.
        model.opt.gravity[:] = 0.0
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        # Joints beside the chain, as those of fingers, have servos too, which hold them at home.
        beside = np.setdiff1d(np.arange(model.njnt), chain.joints)
        joints = np.concatenate([chain.joints, beside])
        self._columns, self._dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._beside_q = scene.home_q[model.jnt_qposadr[beside]]
        self._kp, self._kv = _gains(scene, self._dofs, is_panda=is_panda)
        # The integrator takes joint damping implicitly, so that stiff servos stay stable.
        model.dof_damping[self._dofs] += self._kv
        has_limit = model.jnt_actfrclimited[joints].astype(bool)
        self._least_torque = np.where(has_limit, model.jnt_actfrcrange[joints, 0], -np.inf)
        self._most_torque = np.where(has_limit, model.jnt_actfrcrange[joints, 1], np.inf)
        self.data = scene.new_data()
        self._jacobian = np.zeros((3, model.nv))
        self._n_asleep = 0
        self.tip_contact: TipContact | None = None
        """What acts on the tip; None for the spring along the normal of the organ as planned."""

    @property
    def dt_s(self) -> float:
        """Time of one step [s]."""
        return float(self.model.opt.timestep)

    def run(self, q: Array, speed: Array, *, record_every: int) -> ServoRun:
        """What the arm does that follows configurations of the chain, one per step, until the force passes its limit.

        Args:
            q: Where the servos are sent, shape (T, n).
            speed: How fast, shape (T, n).
            record_every: Every so many steps is recorded, and the last one.
        """
        return self.follow(zip(q, speed, strict=True), record_every=record_every)

    def follow(self, commands: Iterable[tuple[Array, Array]], *, record_every: int) -> ServoRun:
        """What the arm does that is sent one command a step, each made when the step before has been done.

        Args:
            commands: At least one: where the servos of the chain are sent, and how fast, shape (n,) each.
            record_every: Every so many steps is recorded, and the last one.
        """
        states, tips_m, forces_n, peak_n, is_stopped = [], [], [], 0.0, False
        start_q, start_s, is_unstable, is_recorded = self.data.qpos.copy(), self.data.time, False, False
        beside_q, beside_speed = self._beside_q, np.zeros(len(self._beside_q))
        with caught_warnings():
            for index, (q, speed) in enumerate(commands):
                force_n = self._step(np.append(q, beside_q), np.append(speed, beside_speed))
                # MuJoCo begins anew, at time 0, where accelerations are no longer numbers that it can work with.
                is_unstable = self.data.time < start_s + (index + 0.5) * self.dt_s
                if is_unstable:
                    self._stand_still(states[-1] if states else start_q)
                peak_n = max(peak_n, force_n)
                is_stopped = force_n > self._settings.force_limit_n
                is_recorded = (index + 1) % record_every == 0
                if is_recorded:
                    self._record(states, tips_m, forces_n)
                if is_stopped or is_unstable:
                    break
            if not is_recorded:
                self._record(states, tips_m, forces_n)
        return ServoRun(
            np.array(states), np.array(tips_m), np.array(forces_n), peak_n, is_stopped, is_unstable
        )

    def _record(self, states: list[Array], tips_m: list[Array], forces_n: list[float]) -> None:
        """Append the present state."""
        mujoco.mj_fwdPosition(self.model, self.data)
        states.append(self.data.qpos.copy())
        tips_m.append(self.data.site_xpos[self._tip].copy())
        forces_n.append(self.contact()[0])

    def _stand_still(self, q: Array) -> None:
        """Put the arm to joint positions of the scene, at rest."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = q
        self._n_asleep = 0

    def contact(self) -> tuple[float, NDArray[np.float64]]:
        """The force on the tip [N] and its direction, out of the organ, in the present state."""
        if self.tip_contact is not None:
            return self._along_beam(self.tip_contact)
        distance_m, outward = self._organ.signed_distance_and_normal(self.data.site_xpos[self._tip])
        depth_m = -distance_m
        if depth_m <= 0.0:
            return 0.0, outward
        mujoco.mj_jacSite(self.model, self.data, self._jacobian, None, self._tip)
        inward_m_s = -float(outward @ self._jacobian @ self.data.qvel)
        settings = self._settings
        return max(0.0, self.stiffness_n_m * depth_m + settings.damping_n_s_m * inward_m_s), outward

    def _force(self) -> tuple[float, Array]:
        """The contact force [N] and its direction; far from the organ it is not looked for in every step."""
        if self.tip_contact is not None:
            return self._along_beam(self.tip_contact)
        if self._n_asleep > 0:
            self._n_asleep -= 1
            return 0.0, np.zeros(3)
        clearance_m = self._organ.clearance_m(self.data.site_xpos[self._tip])
        self._n_asleep = int(clearance_m / (FASTEST_M_S * self.dt_s))
        return self.contact() if self._n_asleep == 0 else (0.0, np.zeros(3))

    def _along_beam(self, tip_contact: TipContact) -> tuple[float, Array]:
        """The force of a contact along the beam [N], and its direction."""
        data, tip = self.data, self._tip
        mujoco.mj_jacSite(self.model, data, self._jacobian, None, tip)
        beam = data.site_xmat[tip].reshape(3, 3)[:, 2].copy()
        force_n = tip_contact.force_along_beam_n(data, data.site_xpos[tip], beam, self._jacobian @ data.qvel)
        return force_n, -beam

    def _step(self, q: Array, speed: Array) -> float:
        """The contact force that acted in one step of the dynamics [N]."""
        model, data = self.model, self.data
        mujoco.mj_step1(model, data)
        force_n, outward = self._force()
        now = data.qvel[self._dofs]
        wanted = self._kp * (q - data.qpos[self._columns]) + self._kv * speed
        torque = np.clip(wanted - self._kv * now, self._least_torque, self._most_torque)
        data.qfrc_applied[:] = 0.0
        # The joints' damping takes the last term off again.
        data.qfrc_applied[self._dofs] = torque + self._kv * now
        if force_n > 0.0:
            data.qfrc_applied += (force_n * outward) @ self._jacobian
        mujoco.mj_step2(model, data)
        return force_n


def _gains(scene: Scene, dofs: NDArray[np.int64], *, is_panda: bool) -> tuple[Array, Array]:
    """Stiffness [N m / rad] and damping [N m s / rad] of the servos, shape (n,) each; for slides N / m and N s / m."""
    if is_panda:
        kp = np.array(PANDA_KP)
        return kp, 0.1 * kp
    data = scene.new_data()
    inertia, unit = np.zeros(scene.model.nv), np.zeros(scene.model.nv)
    own = np.zeros(len(dofs))
    # A joint's own inertia is the torque that a unit acceleration of this joint and no other takes.
    for row, dof in enumerate(dofs.tolist()):
        unit[:] = 0.0
        unit[dof] = 1.0
        mujoco.mj_mulM(scene.model, data, inertia, unit)
        own[row] = inertia[dof]
    return own * OTHER_FREQUENCY_RAD_S**2, 2.0 * own * OTHER_FREQUENCY_RAD_S
