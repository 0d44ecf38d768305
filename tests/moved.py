"""Motions between poses that several tests look at."""

from __future__ import annotations

from sim.movers import make_mover

POSES = (0, 14_399, 7_000, 119, 14_000, 3_333)
"""Poses at corners and in the middle of the organ, so that transfers cross it."""


def motions(stage, kind, poses=POSES, **more):
    mover = make_mover(stage, kind, **more)
    data = stage.scene.new_data()
    return [mover.move(data, pose) for pose in poses if stage.carrier.reach(pose).is_reached], mover
