"""Home: the configuration in which an arm rests, from the keyframes of its file."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

HOME_KEYFRAMES = ("home", "ready", "stow")
"""Names under which robot models keep their rest configuration; the first one found is used."""
OUTSIDE_TOLD = 1e-6
"""A home farther than this beyond a joint's limits is told [rad or m]; nearer is a matter of rounding."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A keyframe as the file has it."""

    name: str
    values: dict[str, NDArray[np.float64]]
    """The numbers of each of its attributes that MuJoCo checks the size of."""


def take_keyframes(spec: mujoco.MjSpec) -> list[Keyframe]:
    """The keyframes of a spec, which are removed from it: one of the wrong size would make MuJoCo refuse all of it."""
    taken = []
    for key in list(spec.keys):
        values = {
            name: np.array(getattr(key, name)) for name in ("qpos", "qvel", "act", "ctrl", "mpos", "mquat")
        }
        taken.append(Keyframe(key.name, values))
        spec.delete(key)
    # Otherwise the compiler would add empty ones up to this number.
    spec.nkey = 0
    return taken


def usable(keyframes: list[Keyframe], model: mujoco.MjModel) -> tuple[list[Keyframe], list[str]]:
    """Those keyframes that fit a model, and a sentence about each of the others."""
    sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na, "ctrl": model.nu}
    sizes |= {"mpos": 3 * model.nmocap, "mquat": 4 * model.nmocap}
    good, said = [], []
    for number, keyframe in enumerate(keyframes, 1):
        wrong = [
            f"its {name} has {len(values)} numbers in place of {sizes[name]}"
            for name, values in keyframe.values.items()
            if len(values) not in (0, sizes[name])
        ]
        if not np.isfinite(keyframe.values["qpos"]).all():
            wrong.append("its qpos holds what is no number")
        if wrong:
            title = repr(keyframe.name) if keyframe.name else f"number {number}"
            said.append(f"the keyframe {title} is left out: {', and '.join(wrong)}.")
        else:
            good.append(keyframe)
    return good, said


def home_positions(model: mujoco.MjModel, keyframes: list[Keyframe]) -> dict[str, float]:
    """The position of each hinge and slide at home, by name [rad or m].

    That is the keyframe named home or the like; without one the first keyframe, and without any the middle of each
    range.

    Args:
        model: The file's model, all joints of which have names.
        keyframes: Those that fit it.
    """
    named = {keyframe.name: keyframe for keyframe in reversed(keyframes)}
    found = next((named[name] for name in HOME_KEYFRAMES if name in named), None)
    low, high = model.jnt_range.T
    if found is None and keyframes:
        found = keyframes[0]
    if found is not None:
        q = found.values["qpos"] if len(found.values["qpos"]) else model.qpos0
        at = q[model.jnt_qposadr]
    else:
        at = np.where(model.jnt_limited.astype(bool), (low + high) / 2.0, model.qpos0[model.jnt_qposadr])
    return {model.joint(joint).name: float(at[joint]) for joint in range(model.njnt)}


def within_limits(model: mujoco.MjModel, home: dict[str, float]) -> tuple[NDArray[np.float64], list[str]]:
    """Home within the joints' limits, shape (n_joints,), and a sentence about each joint that was beyond its own."""
    at = np.array([home[model.joint(joint).name] for joint in range(model.njnt)], dtype=np.float64)
    is_limited = model.jnt_limited.astype(bool)
    held = np.where(is_limited, np.clip(at, *model.jnt_range.T), at)
    said = [
        f"at home, {model.joint(joint).name} is at {at[joint]:.4g}, beyond its limits; {held[joint]:.4g} is taken."
        for joint in np.flatnonzero(np.abs(held - at) > OUTSIDE_TOLD).tolist()
    ]
    return held, said
