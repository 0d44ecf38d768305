"""Checks: what a compiled arm must be, so that everything after can rely on it."""

from __future__ import annotations

import mujoco
import numpy as np

from .body_tree import joints_above
from .couplings import couplings, told

LARGEST_M = 100.0
"""No arm is longer than this [m]; a file in millimetres is."""
LARGEST_LINK_M = 10.0
"""No shape of a link is larger than this [m]."""
NUMBERS = {
    "body": ("pos", "quat", "ipos", "mass", "inertia"),
    "jnt": ("pos", "axis", "range", "stiffness"),
    "dof": ("armature", "damping"),
    "geom": ("pos", "quat", "size"),
    "site": ("pos", "quat"),
}
"""Arrays of a model that decide where an arm is and how it moves."""


def why_unusable(model: mujoco.MjModel, flange_body: int, flange: str) -> str | None:
    """Why an arm cannot be used, as one or two sentences, or None.

    Args:
        model: The compiled arm.
        flange_body: The id of the body that carries the probe.
        flange: What the flange is called.
    """
    if model.njnt == 0:
        return "this model has no joints, so it is not an arm."
    if model.nflex:
        name = mujoco.mj_id2name(model, int(mujoco.mjtObj.mjOBJ_FLEX), 0)
        return f"it holds a flex, {name}, whose points are joints of their own. Remove it from the file."
    return _bad_joints(model, flange_body, flange) or _bad_numbers(model) or _coupled(model, flange_body)


def _bad_joints(model: mujoco.MjModel, flange_body: int, flange: str) -> str | None:
    hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    other = np.flatnonzero(~np.isin(model.jnt_type, (hinge, slide)))
    if len(other):
        return (
            f"{model.joint(int(other[0])).name} is a free or ball joint. Sounding needs a fixed base and hinge or "
            "slide joints; remove the <freejoint> of the base, or replace the ball joint by hinges."
        )
    chain = np.array(joints_above(model, flange_body), dtype=np.int64)
    if not len(chain):
        return f"no joint moves {flange}. Name a site or body of the last link with `flange`."
    is_short = (model.jnt_limited[chain] == 1) & (np.abs(model.jnt_range[chain]).max(axis=1) < LARGEST_M)
    is_endless = (model.jnt_type[chain] == slide) & ~is_short
    if is_endless.any():
        name = model.joint(int(chain[np.argmax(is_endless)])).name
        return (
            f"{name} slides without limits, as a mobile base does. Sounding needs a fixed base: give the joint a "
            "range, or remove it and place the arm with `base_mm`."
        )
    return None


def _bad_numbers(model: mujoco.MjModel) -> str | None:
    """Whether a number of the model is none, or so large that its unit cannot be metres."""
    for kind, names in NUMBERS.items():
        for name in names:
            values = np.atleast_2d(getattr(model, f"{kind}_{name}").T).T
            if not len(values):
                continue
            is_bad = ~np.isfinite(values).all(axis=1)
            if is_bad.any():
                return (
                    f"the {name} of {_called(model, kind, int(np.argmax(is_bad)))} holds what is no number."
                )
            is_length = (kind, name) in {("body", "pos"), ("jnt", "pos"), ("geom", "pos"), ("site", "pos")}
            is_large = np.abs(values).max(axis=1) > LARGEST_M
            if is_length and is_large.any():
                return (
                    f"{_called(model, kind, int(np.argmax(is_large)))} lies more than {LARGEST_M:.0f} m from what it "
                    "belongs to. MJCF counts in metres; is the file in millimetres?"
                )
    is_moved = (model.body_weldid != 0)[model.geom_bodyid]
    is_large = is_moved & (model.geom_size.max(axis=1, initial=0.0) > LARGEST_LINK_M)
    if is_large.any():
        return (
            f"{_called(model, 'geom', int(np.argmax(is_large)))} is larger than {LARGEST_LINK_M:.0f} m. MJCF counts in "
            "metres; is the file in millimetres?"
        )
    return None


def _coupled(model: mujoco.MjModel, flange_body: int) -> str | None:
    found = couplings(model, flange_body)
    if not found:
        return None
    return (
        f"{told(found)}. Sounding moves every joint between base and flange on its own, so it would send this arm "
        "where it cannot go. Remove that from the file where the real arm's joints are free of it; an arm whose joints "
        "depend on each other cannot be used."
    )


def _called(model: mujoco.MjModel, kind: str, index: int) -> str:
    """What an element of the model is called."""
    if kind == "dof":
        kind, index = "jnt", int(model.dof_jntid[index])
    word = {"jnt": "joint"}.get(kind, kind)
    return f"{word} {getattr(model, word)(index).name or f'number {index}'}"
