"""Motions between poses that several tests look at."""

from __future__ import annotations

from sim.episode.moving.arm_motion import make_motion_model

POSES = (0, 14_399, 7_000, 119, 14_000, 3_333)
"""Poses at corners and in the middle of the organ, so that transfers cross it."""


def motions(setup, kind, poses=POSES, **more):
    motion_model = make_motion_model(setup, kind, **more)
    data = setup.scene.new_data()
    return [
        motion_model.move(data, pose) for pose in poses if setup.positioner.reach(pose).is_reached
    ], motion_model
