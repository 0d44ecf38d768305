"""Viewpoints against the geometry of a picture: what has to be seen is, and the subject is large."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.world.camera.viewpoint import Margins, viewpoint_of


def box_m(size_m, at_m):
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    return corners * size_m + at_m


MARGINS = Margins(above=0.08, below=0.1, right=0.35)


@given(
    size_m=st.tuples(*[st.floats(0.004, 0.6)] * 3),
    arm_m=st.floats(0.2, 2.5),
    base_rad=st.floats(-4.0, 4.0),
    aspect=st.floats(0.8, 2.5),
)
def test_any_organ_is_large_and_in_the_free_part_beside_any_arm(size_m, arm_m, base_rad, aspect):
    organ = box_m(np.array(size_m), [0.5, 0.1, size_m[2] / 2])
    away = np.array([np.cos(base_rad), np.sin(base_rad), 0.4]) * arm_m
    arm = box_m(np.array([0.2, 0.2, arm_m]), organ.mean(axis=0) + away)
    view = viewpoint_of(organ, arm, aspect=aspect, base_rad=base_rad, margins=MARGINS)
    seen = view.in_window(organ)
    # The free part ends at these places of the window; rounding alone may pass them.
    assert seen[:, 0].min() >= -1 - 1e-9
    assert seen[:, 0].max() <= 1 - 2 * MARGINS.right + 1e-9
    assert seen[:, 1].min() >= -1 + 2 * MARGINS.below - 1e-9
    assert seen[:, 1].max() <= 1 - 2 * MARGINS.above + 1e-9
    # It takes its share of the width, unless the free height is all taken first.
    width, height = np.ptp(seen, axis=0) / 2
    assert width >= 1 / 3 or height >= 0.8 * (1 - MARGINS.above - MARGINS.below) / 1.1


@given(size_m=st.floats(0.004, 0.6), arm_m=st.floats(0.2, 2.5), base_rad=st.floats(-4.0, 4.0))
def test_without_a_share_everything_is_in_the_picture(size_m, arm_m, base_rad):
    organ = box_m(np.full(3, size_m), [0.5, 0.1, size_m / 2])
    arm = box_m(np.array([0.2, 0.3, arm_m]), [0.5 + np.cos(base_rad), np.sin(base_rad), arm_m / 2])
    view = viewpoint_of(organ, arm, aspect=0.9, base_rad=base_rad, margins=Margins(), least_share=0.0)
    assert (np.abs(view.in_window(np.concatenate([organ, arm]))) <= 1).all()


def test_a_window_shows_what_lies_in_its_middle_in_its_middle():
    organ = box_m(np.full(3, 0.2), [0.5, 0.0, 0.1])
    view = viewpoint_of(organ, np.empty((0, 3)), aspect=4 / 3, base_rad=np.pi, margins=Margins())
    R = view.R_world_camera
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)  # rounding alone
    middle_m = view.eye_m + R @ (*view.centre, 1.0)
    np.testing.assert_allclose(view.in_window(middle_m[None]), [[0, 0]], atol=1e-12)
    edge_m = view.eye_m + R @ (view.centre[0] + view.half_height * 4 / 3, view.centre[1], 1.0)
    assert view.in_window(edge_m[None])[0] == pytest.approx([1, 0], abs=1e-12)
