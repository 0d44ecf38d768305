"""Contact of a face: which of its points meets an organ first."""

import numpy as np
import pytest

from sim.world.body.contact import face_in_tip_m, way_to_contact_m
from sim.world.frames import frames_along
from sim.world.sensing.rays import SurfaceRays

CENTRE_M, BALL_M, FACE_M = np.array([0.5, 0.0, 0.06]), 0.06, 0.008
SAG_M = 2e-4
"""The ball's triangles lie up to 0.1 mm inside it."""


def tip_at(position_m, beam) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = frames_along(np.array([beam], dtype=float))[0], position_m
    return T


def way_m(scene, T, **more) -> float | None:
    options = {"above_m": 0.04, "search_m": 0.03, "face_radius_m": FACE_M} | more
    return way_to_contact_m(SurfaceRays(scene), scene.new_data(), T, **options)


def test_the_middle_of_a_face_that_stands_upright_on_a_ball_touches_first(scene) -> None:
    for beam in (np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.0, -0.8])):
        # Just beside the middle, where the ball has a vertex, which a ray may slip through.
        T = tip_at(np.add(CENTRE_M, [1e-4, 2e-4, 0.0]) - (BALL_M + 0.01) * beam, beam)
        assert way_m(scene, T) == pytest.approx(0.01, abs=SAG_M)
        assert way_m(scene, T, face_radius_m=0.0) == pytest.approx(0.01, abs=SAG_M)


@pytest.mark.parametrize("beside_m", [0.012, 0.025, 0.04])
def test_the_rim_touches_first_beside_the_top_of_a_ball(scene, beside_m) -> None:
    """The point of the disc that is nearest to the ball's axis meets the ball where this is highest under the disc."""
    T = tip_at(np.add(CENTRE_M, [beside_m, 0.0, BALL_M + 0.01]), (0.0, 0.0, -1.0))
    for face_m in (FACE_M, 0.0):
        height_m = np.sqrt(BALL_M**2 - (beside_m - face_m) ** 2)
        # The ring has a point within 11 degrees of the nearest one.
        missed_m = face_m * (1.0 - np.cos(np.pi / 16)) * (beside_m - face_m) / height_m
        found_m = way_m(scene, T, face_radius_m=face_m, search_m=0.05)
        assert BALL_M + 0.01 - height_m - SAG_M <= found_m <= BALL_M + 0.01 - height_m + missed_m + SAG_M


def test_a_rim_over_the_organ_is_a_contact(scene) -> None:
    T = tip_at(np.add(CENTRE_M, [BALL_M + 0.004, 0.0, 0.05]), (0.0, 0.0, -1.0))
    assert way_m(scene, T, face_radius_m=0.0, search_m=0.1) is None
    assert 0.02 < way_m(scene, T, search_m=0.1) < 0.05


def test_a_face_that_meets_nothing_in_reach_or_begins_inside_has_no_contact(scene) -> None:
    T = tip_at(np.add(CENTRE_M, [0.0, 0.0, BALL_M + 0.02]), (0.0, 0.0, -1.0))
    assert way_m(scene, T, search_m=0.015) is None
    assert way_m(scene, tip_at(CENTRE_M, (0.0, 0.0, -1.0))) is None


def test_the_points_of_a_face_lie_on_a_disc() -> None:
    points_m = face_in_tip_m(FACE_M)
    np.testing.assert_array_equal(points_m[0], 0.0)
    np.testing.assert_allclose(np.linalg.norm(points_m, axis=1)[-16:], FACE_M)
    np.testing.assert_array_equal(points_m[:, 2], 0.0)
