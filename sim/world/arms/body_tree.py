"""The tree of a model's bodies: what a body hangs from, and the joints above it."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco


def bodies_above(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """Ids of a body and of those that it hangs from, without the world."""
    while body != 0:
        yield body
        body = int(model.body_parentid[body])


def joints_above(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the joints between the world and a body, from the base on."""
    joints: list[int] = []
    for each in bodies_above(model, body):
        first = int(model.body_jntadr[each])
        joints[:0] = range(first, first + int(model.body_jntnum[each]))
    return joints


def hangs_below(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    """Whether a body is another, or hangs from it."""
    return ancestor in bodies_above(model, body)
