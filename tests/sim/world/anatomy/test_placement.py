import numpy as np
import pytest
import trimesh

from sim.world.anatomy.placement import R_WORLD_LPS, R_WORLD_UPRIGHT, lay_on_table, put_at_pose
from sim.world.errors import PlacementError
from sim.world.solids.solid import Solid


def marked_box():
    """A box with one corner pulled out, so that no axis or sign can be mixed up."""
    mesh = trimesh.creation.box((0.2, 0.15, 0.1))
    mesh.apply_translation([0.5, -0.7, 1.2])
    return Solid.from_trimesh(mesh)


def test_left_head_and_front_become_x_y_and_z():
    left, back, head = np.eye(3)
    assert R_WORLD_LPS @ left == pytest.approx([1, 0, 0])
    assert R_WORLD_LPS @ head == pytest.approx([0, 1, 0])
    assert R_WORLD_LPS @ -back == pytest.approx([0, 0, 1])
    assert np.linalg.det(R_WORLD_LPS) == pytest.approx(1.0)


def test_the_box_is_centred_and_touches_the_table():
    placed = lay_on_table(marked_box(), centre_xy_m=(0.45, 0.05))
    low, high = placed.organ.bounds_m
    assert 0.5 * (low + high)[:2] == pytest.approx([0.45, 0.05], abs=1e-12)
    assert low[2] == pytest.approx(0.0, abs=1e-12)
    assert high - low == pytest.approx([0.2, 0.1, 0.15], abs=1e-12)


def test_tumours_keep_their_place_in_the_organ():
    tumour = trimesh.creation.icosphere(radius=0.01)
    tumour.apply_translation([0.55, -0.72, 1.21])
    placed = lay_on_table(marked_box(), (Solid.from_trimesh(tumour),))
    T = placed.T_world_organ
    assert placed.tumours[0].bounds_m.mean(axis=0) == pytest.approx(
        (T @ [0.55, -0.72, 1.21, 1.0])[:3], abs=1e-9
    )
    assert placed.organ.volume_m3 == pytest.approx(marked_box().volume_m3, rel=1e-9)


def test_an_upright_organ_keeps_its_axes():
    placed = lay_on_table(marked_box(), R_world_organ=R_WORLD_UPRIGHT)
    assert placed.organ.extents_m == pytest.approx([0.2, 0.15, 0.1], abs=1e-12)
    assert placed.T_world_organ[:3, :3] == pytest.approx(np.eye(3))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), "finite 4 x 4"),
        (np.full((4, 4), np.nan), "finite 4 x 4"),
        (2.0 * np.eye(4), "last row"),
        (np.diag([2.0, 1.0, 1.0, 1.0]), "scales or shears"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "mirrors"),
    ],
)
def test_what_is_no_rigid_motion_is_refused(matrix, message):
    with pytest.raises(PlacementError, match=message):
        put_at_pose(marked_box(), T_world_organ=matrix)


def test_a_centre_that_is_no_point_of_the_plane_is_refused():
    with pytest.raises(PlacementError, match="two finite numbers"):
        lay_on_table(marked_box(), centre_xy_m=(0.5, np.inf))
