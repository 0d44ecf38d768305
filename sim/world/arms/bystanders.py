"""Bystanders: what an arm's file holds beside the arm, as scenes for a viewer do, and what is left out of it."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco

UNUSED = ("sensors", "tuples", "numerics", "texts", "skins", "cameras", "lights")
"""What plays no part here. Lights would wash out the pictures, and cameras and sensors may look at what is left out."""


def leave_out_bystanders(spec: mujoco.MjSpec, flange: mujoco.MjsBody) -> list[str]:
    """Remove from a spec what is no part of the arm; what a person should know is returned, a sentence each.

    Mocap bodies and bodies that float freely go, with the constraints, tendons and actuators that refer to them. A
    mocap body that carries the arm stands still from now on.

    Args:
        spec: The arm's file.
        flange: The body that carries the probe.
    """
    for kind in UNUSED:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    carrying, said = list(ancestry(flange)), []
    for body in list(spec.worldbody.bodies):
        carries = any(each.id == body.id and each.name == body.name for each in carrying)
        if body.mocap and carries:
            body.mocap = False
            said.append(f"the mocap body {body.name} carries the arm and is taken as its fixed base.")
        elif body.mocap or (_floats(body) and not carries):
            kind = "mocap body" if body.mocap else "free body"
            said.append(f"the {kind} {body.name} is left out, with whatever is tied to it.")
            spec.delete(body)
    return said


def ancestry(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and those that it hangs from, without the world."""
    while body.name != "world":
        yield body
        body = body.parent


def _floats(body: mujoco.MjsBody) -> bool:
    return any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
