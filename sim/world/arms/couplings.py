"""Couplings: what makes the joints of an arm depend on each other.

Inverse kinematics, paths, timing and servos move every joint between base and flange on its own. An arm whose file
couples these joints would be told to go where it cannot, so it is refused, with the name of what couples them:

- an equality constraint between such joints (the mimic joints of a URDF are read as such), or one that ties together
  two bodies which these joints move against each other, as the rods of a parallelogram do;
- an equality constraint on a tendon that such joints lengthen, or limits of its length;
- actuators that drive several joints at once and are too few to place each of them (a differential with as many
  actuators as joints is none).

Constraints between joints beside the chain, such as a gripper's fingers, stay as they are: those joints rest at home.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from .body_tree import joints_above

MAX_TOLD = 3
"""Most couplings that are written out in one message."""
N_CONFIGURATIONS = 5
"""Configurations at which the actuators' moments are looked at: at a single one they may vanish by chance."""
LEAST_MOMENT = 1e-9
"""A moment arm below this drives nothing [m or 1]."""
LARGEST_TURN = 3.0
"""Configurations are drawn within this of zero [rad or m], and within the joints' limits."""


def couplings(model: mujoco.MjModel, flange_body: int) -> list[str]:
    """What couples the joints above a body, a phrase each; empty where all can move on their own.

    Args:
        model: The compiled arm, all of whose joints are hinges or slides.
        flange_body: The id of the body that carries the probe.
    """
    chain = _Chain(model, flange_body)
    return [*_equalities(model, chain), *_limited_tendons(model, chain), *_actuators(model, chain)]


def told(phrases: list[str]) -> str:
    """The first few of these phrases as one, and how many more there are."""
    more = len(phrases) - MAX_TOLD
    return "; ".join(phrases[:MAX_TOLD]) + (f"; and {more} more" if more > 0 else "")


class _Chain:
    """Which joints lead to the flange, and which bodies they move."""

    def __init__(self, model: mujoco.MjModel, flange_body: int) -> None:
        self._model = model
        self.joints = set(joints_above(model, flange_body))

    def moves_apart(self, bodies: Iterable[int]) -> bool:
        """Whether a joint of the chain moves some of these bodies against the others."""
        return len({self._n_joints_above(body) for body in bodies}) > 1

    def _n_joints_above(self, body: int) -> int:
        """How many joints of the chain move a body; bodies of one number move as one with the chain."""
        return len(self.joints.intersection(joints_above(self._model, body)))


def _equalities(model: mujoco.MjModel, chain: _Chain) -> Iterator[str]:
    for equality in range(model.neq):
        if not model.eq_active0[equality]:
            continue
        kind = mujoco.mjtEq(int(model.eq_type[equality]))
        ids = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
        title = _title(f"{kind.name.removeprefix('mjEQ_').lower()} constraint", model.equality(equality).name)
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            ids = [joint for joint in ids if joint >= 0]
            if chain.joints.intersection(ids):
                first, *other = (_called(model.joint(joint).name, "joint", joint) for joint in ids)
                yield f"the {title} " + (
                    f"makes {first} depend on {other[0]}" if other else f"holds {first} where it is"
                )
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            tendons = [tendon for tendon in ids if tendon >= 0 and _is_lengthened(model, tendon, chain)]
            if tendons:
                name = _called(model.tendon(tendons[0]).name, "tendon", tendons[0])
                yield f"the {title} holds the length of {name}"
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
                ids = [int(model.site_bodyid[site]) for site in ids]
            if chain.moves_apart(ids):
                first, second = (_called(model.body(body).name, "body", body) for body in ids)
                yield f"the {title} ties {first} to {second}"


def _limited_tendons(model: mujoco.MjModel, chain: _Chain) -> Iterator[str]:
    for tendon in np.flatnonzero(model.tendon_limited).tolist():
        if _is_lengthened(model, tendon, chain):
            name = model.tendon(tendon).name
            yield f"the limits of {_called(name, 'tendon', tendon)} allow some joint positions only together"


def _is_lengthened(model: mujoco.MjModel, tendon: int, chain: _Chain) -> bool:
    """Whether a joint of the chain changes the length of a tendon."""
    first = int(model.tendon_adr[tendon])
    branch: list[int] = []
    for row in range(first, first + int(model.tendon_num[tendon])):
        kind, wrapped = int(model.wrap_type[row]), int(model.wrap_objid[row])
        if kind == int(mujoco.mjtWrap.mjWRAP_JOINT):
            if wrapped in chain.joints:
                return True
        elif kind == int(mujoco.mjtWrap.mjWRAP_PULLEY):
            branch = []
        else:
            is_site = kind == int(mujoco.mjtWrap.mjWRAP_SITE)
            branch.append(int((model.site_bodyid if is_site else model.geom_bodyid)[wrapped]))
            if chain.moves_apart(branch):
                return True
    return False


def _actuators(model: mujoco.MjModel, chain: _Chain) -> Iterator[str]:
    """The first actuator of those that drive joints together and are too few to place each of them."""
    moments = _moments(model)
    is_driven = np.abs(moments).max(axis=0) > LEAST_MOMENT
    is_chain = np.isin(model.dof_jntid, list(chain.joints))
    coupling = np.flatnonzero((is_driven.sum(axis=1) > 1) & (is_driven & is_chain).any(axis=1))
    shared = np.flatnonzero(is_driven[coupling].any(axis=0))
    if not len(coupling) or max(np.linalg.matrix_rank(at[:, shared]) for at in moments) == len(shared):
        return
    joints = [int(model.dof_jntid[dof]) for dof in np.flatnonzero(is_driven[coupling[0]])]
    names = ", ".join(_called(model.joint(joint).name, "joint", joint) for joint in joints)
    title = _title("actuator", model.actuator(int(coupling[0])).name)
    yield f"the {title} drives {names} together, with too few others to place each"


def _moments(model: mujoco.MjModel) -> NDArray[np.float64]:
    """How each actuator drives each joint in some configurations, shape (N_CONFIGURATIONS, nu, nv)."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    low, high = np.clip(model.jnt_range.T, -LARGEST_TURN, LARGEST_TURN)
    is_limited = model.jnt_limited.astype(bool)
    low, high = np.where(is_limited, low, -LARGEST_TURN), np.where(is_limited, high, LARGEST_TURN)
    moments = np.zeros((N_CONFIGURATIONS, model.nu, model.nv))
    for at in moments if model.nu else ():
        data.qpos[:] = rng.uniform(low, high)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mju_sparse2dense(
            at, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
    return moments


def _title(kind: str, name: str) -> str:
    return f"{kind} {name!r}" if name else f"unnamed {kind}"


def _called(name: str, kind: str, index: int) -> str:
    return "the world" if kind == "body" and index == 0 else name or f"{kind} {index}"
