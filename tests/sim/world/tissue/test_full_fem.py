"""The elastic organ held against full finite element solutions, at an indentation of 10 mm by a face of 4 mm radius.

The tolerances are those that the model promises: an interior displacement within 1 mm, a force within 10 %.
"""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="the full solutions need scikit-fem, which the extra `dev` brings")
from organ_fem import is_in_mesh, organ_mesh, press_organ
from pressed_bodies import HALF_HEIGHT_M, HALF_WIDTH_M, ball
from round_organ_fem import press_spheroid, spheroid_mesh

from sim.world.frames import frames_along
from sim.world.solids.surface_distance import surface_distance_of
from sim.world.tissue.elastic_organ import build_elastic_organ
from sim.world.tissue.settings import ElasticSettings

FACE_M, DEPTH_M, TOP_M = 0.004, 0.010, 2 * HALF_HEIGHT_M
LIVER_PA, TUMOUR_PA = 5000.0, 50_000.0


def spheroid_points(spheroid):
    """Points all over the spheroid and close below the face, none of them beyond the full solution's straight edges."""
    along, down = np.meshgrid(np.linspace(1e-4, 0.03, 15), np.linspace(0.001, 0.05, 20))
    close = np.column_stack([along.ravel(), 0.0 * along.ravel(), TOP_M - down.ravel()])
    points = np.concatenate([spheroid.sample_inside(3000, np.random.default_rng(0)), close])
    scaled = (points - [0.0, 0.0, HALF_HEIGHT_M]) / [HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M]
    return points[(scaled**2).sum(axis=1) < 0.985]


def full_solution(points, ratio, tumour):
    """Force [N] and displacement [m] of the axisymmetric solution; a tumour is (depth of its middle, radius)."""
    sizes = [((FACE_M, TOP_M), 0.0003, 0.25, 0.0)]
    if tumour is not None:
        sizes.append(((0.0, TOP_M - tumour[0]), tumour[1] / 8, 0.3, 1.1 * tumour[1]))

    def modulus_pa(middles):
        if tumour is None:
            return np.full(middles.shape[1], LIVER_PA)
        away = np.hypot(middles[0], middles[1] - (TOP_M - tumour[0]))
        return np.where(away < tumour[1], TUMOUR_PA, LIVER_PA)

    force_n, moved_m = press_spheroid(
        spheroid_mesh(HALF_WIDTH_M, HALF_HEIGHT_M, sizes),
        face_radius_m=FACE_M,
        depth_m=DEPTH_M,
        modulus_pa=modulus_pa,
        poissons_ratio=ratio,
        bed_height_m=0.2 * TOP_M,
    )
    radial = np.hypot(points[:, 0], points[:, 1])
    out, up = moved_m(np.column_stack([radial, points[:, 2]])).T
    return force_n, np.column_stack([out * points[:, 0] / radial, out * points[:, 1] / radial, up])


@pytest.mark.parametrize(
    ("ratio", "tumour"),
    [
        (0.3, None),
        (0.45, None),
        (0.49, None),
        (0.49, (0.015, 0.006)),
        (0.49, (0.02, 0.008)),
        (0.45, (0.03, 0.012)),
    ],
)
def test_displacement_and_force_of_a_spheroid_are_those_of_the_full_solution(spheroid, ratio, tumour):
    points = spheroid_points(spheroid)
    force_n, moved_m = full_solution(points, ratio, tumour)
    tumours = [ball([0.0, 0.0, TOP_M - tumour[0]], tumour[1])] if tumour else []
    organ = build_elastic_organ(spheroid, tumours=tumours, tissue=ElasticSettings(poissons_ratio=ratio))
    pressed = organ.press([0.0, 0.0, TOP_M], [0.0, 0.0, -1.0], depth_m=DEPTH_M, face_radius_m=FACE_M)
    off_m = np.linalg.norm(pressed.displacement_m(points) - moved_m, axis=1)
    print(
        f"\nnu {ratio}, tumour {tumour}: force {force_n:.4f} N, here {pressed.force_n:.4f} N; displacement off by "
        f"{1e3 * off_m.max():.2f} mm at most, {1e3 * off_m.mean():.2f} mm in the mean"
    )
    assert pressed.force_n == pytest.approx(force_n, rel=0.1)
    assert off_m.max() < 1e-3
    assert off_m.mean() < 1e-4
    if tumour:
        softer = build_elastic_organ(spheroid, tissue=ElasticSettings(poissons_ratio=ratio))
        without = softer.press([0.0, 0.0, TOP_M], [0.0, 0.0, -1.0], depth_m=DEPTH_M, face_radius_m=FACE_M)
        # What a stiff tumour changes is told: the model without it is farther off, both in force and in displacement.
        assert abs(without.force_n - force_n) > 2 * abs(pressed.force_n - force_n)
        assert np.linalg.norm(without.displacement_m(points) - moved_m, axis=1).mean() > 1.5 * off_m.mean()


@pytest.mark.slow
@pytest.mark.parametrize("place_xy_m", [(0.45, 0.03), (0.57, 0.0), (0.5, 0.0), (0.5265, -0.0282)])
def test_displacement_and_force_of_the_embedded_liver_are_those_of_the_full_solution(liver, place_xy_m):
    """Pressed on the right lobe, on the slope of the left one, between them, and beside the notch; minutes each."""
    top = np.array([*place_xy_m, liver.top_height_m([place_xy_m])[0]])
    organ = build_elastic_organ(liver)
    near = organ.surface.around(top, 0.008)
    inward = -(organ.surface.normals[near] * organ.surface.areas_m2[near, None]).sum(axis=0)
    pressed = organ.press(top, inward, depth_m=DEPTH_M, face_radius_m=FACE_M)
    frame = frames_along(pressed.contact.direction[None])[0]
    bed_m = liver.bounds_m[0, 2] + 0.2 * liver.extents_m[2]
    mesh = organ_mesh(
        liver,
        top,
        frame,
        coarse_m=0.014,
        rim_m=0.0013,
        growth=0.8,
        face_radius_m=FACE_M,
        bed_height_m=bed_m,
    )
    force_n, moved_m = press_organ(
        mesh,
        top,
        pressed.contact.direction,
        face_radius_m=FACE_M,
        depth_m=DEPTH_M,
        modulus_pa=LIVER_PA,
        poissons_ratio=0.49,
        bed_height_m=bed_m,
    )
    along, down = np.meshgrid(np.linspace(0.0, 0.03, 9), np.linspace(0.001, 0.04, 12))
    close = top + np.column_stack([along.ravel(), 0.0 * along.ravel(), down.ravel()]) @ frame.T
    points = np.concatenate([liver.sample_inside(4000, np.random.default_rng(1)), close])
    points = points[surface_distance_of(liver).signed_distance_m(points) < -0.0007]
    points = points[is_in_mesh(mesh, points)]
    off_mm = 1e3 * np.linalg.norm(pressed.displacement_m(points) - moved_m(points), axis=1)
    print(
        f"\n{place_xy_m}: {mesh.t.shape[1]} tetrahedra; force {force_n:.4f} N, here {pressed.force_n:.4f} N; "
        f"displacement off by {off_mm.max():.2f} mm at most, {off_mm.mean():.2f} mm in the mean of {len(points)} points"
    )
    assert len(points) > 3500
    assert pressed.force_n == pytest.approx(force_n, rel=0.1)
    assert off_mm.max() < 1.0
