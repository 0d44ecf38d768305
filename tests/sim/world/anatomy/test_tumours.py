import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from sim.world.anatomy.paper_organ import UNIT_M, paper_organ, surface_height
from sim.world.anatomy.tumour_shapes import lobulated_shape
from sim.world.anatomy.tumours import plant_lobulated, plant_spheres
from sim.world.errors import PlantingError
from sim.world.solids.solid import Solid


@pytest.fixture(scope="module")
def organ():
    return paper_organ().solid


@pytest.fixture(scope="module")
def ball():
    return Solid.from_trimesh(trimesh.creation.icosphere(subdivisions=3, radius=0.07))


def centre_m(tumour):
    return tumour.vertices_m.mean(axis=0)


def equivalent_diameter_m(tumour):
    return np.cbrt(6.0 / np.pi * tumour.volume_m3)


def test_spheres_follow_the_papers_rule(organ):
    planted = [plant_spheres(organ, 3, rng=np.random.default_rng(seed)) for seed in range(40)]
    centres = np.array([[centre_m(tumour) for tumour in spheres] for spheres in planted]) / UNIT_M
    x, y, z = np.moveaxis(centres, -1, 0)
    assert np.abs(x).max() <= 2.2
    assert np.abs(y).max() <= 2.2
    depth = surface_height(x, y) - z
    assert depth.min() >= 1.2 - 1e-3  # chords of the surface deviate by less than 1e-3 units
    assert depth.max() <= 2.8 + 1e-3
    apart = np.linalg.norm(centres[:, [0, 0, 1]] - centres[:, [1, 2, 2]], axis=-1)
    assert apart.min() > 0.8
    # 120 draws even in x, y and depth: means within five standard errors.
    assert x.mean() == pytest.approx(0.0, abs=5 * 4.4 / np.sqrt(12 * 120))
    assert depth.mean() == pytest.approx(2.0, abs=5 * 1.6 / np.sqrt(12 * 120))


def test_spheres_have_the_volume_of_their_radius_and_lie_inside(organ):
    for tumour in plant_spheres(organ, 3, rng=np.random.default_rng(5)):
        assert tumour.volume_m3 == pytest.approx(4 / 3 * np.pi * (0.4 * UNIT_M) ** 3, rel=1e-9)
        x, y, z = tumour.vertices_m.T / UNIT_M
        assert np.abs([x, y]).max() < 3.0
        assert ((z > organ.bounds_m[0, 2] / UNIT_M) & (z < surface_height(x, y))).all()
        assert tumour.to_trimesh().is_watertight


def test_lobulated_tumours_are_deep_apart_and_in_range(ball):
    tumours = plant_lobulated(ball, 6, rng=np.random.default_rng(0), diameter_range_m=(0.008, 0.03))
    diameters = [equivalent_diameter_m(tumour) for tumour in tumours]
    assert min(diameters) >= 0.008 - 1e-9
    assert max(diameters) <= 0.03 + 1e-9
    for i, tumour in enumerate(tumours):
        depth = trimesh.proximity.signed_distance(ball.to_trimesh(), tumour.vertices_m)
        assert depth.min() >= 0.0025 - 1e-4  # the distance used is within 0.1 mm
        mesh = tumour.to_trimesh()
        assert mesh.is_watertight
        assert mesh.volume > 0
        for other in tumours[:i]:
            assert KDTree(other.vertices_m).query(tumour.vertices_m)[0].min() >= 0.002
            assert not mesh.contains(other.vertices_m).any()


def test_lobulated_shapes_are_bumpy_but_not_torn():
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(30):
        vertices, faces = lobulated_shape(0.02, rng)
        mesh = trimesh.Trimesh(vertices, faces)
        assert mesh.volume == pytest.approx(np.pi / 6 * 0.02**3, rel=1e-9)
        outward = np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center)
        assert (outward > 0).all()  # star-shaped: every facet faces away from the middle
        ratios.append(mesh.volume / mesh.convex_hull.volume)
    assert 0.85 < np.mean(ratios) < 0.98  # a ball has 1


def test_no_tumour_is_allowed_and_a_negative_number_is_not(ball):
    assert plant_lobulated(ball, 0, rng=np.random.default_rng(0)) == ()
    with pytest.raises(ValueError, match="n=-1 must be at least 0"):
        plant_spheres(ball, -1, rng=np.random.default_rng(0))


def test_only_attainable_places_are_taken(ball):
    def share_left_of_the_middle(points_m):
        return float((points_m[:, 0] < 0.0).mean())

    rng = np.random.default_rng(2)
    tumours = plant_lobulated(
        ball, 3, rng=rng, diameter_range_m=(0.01, 0.015), is_attainable=share_left_of_the_middle
    )
    for tumour in tumours:
        inside = tumour.sample_inside(2000, np.random.default_rng(3))
        assert (
            share_left_of_the_middle(inside) > 0.92
        )  # 95 % judged on 500 points, three standard errors less


@pytest.mark.parametrize("plant", [plant_spheres, plant_lobulated])
def test_an_organ_out_of_reach_gives_an_error_with_a_remedy(ball, plant):
    with pytest.raises(PlantingError, match=r"no place was found for .* 1 of 2 .* ask for fewer or smaller"):
        plant(ball, 2, rng=np.random.default_rng(0), is_attainable=lambda points_m: 0.5)


def test_too_many_tumours_give_an_error(ball):
    with pytest.raises(PlantingError, match="no place was found for sphere"):
        plant_spheres(ball, 50, rng=np.random.default_rng(0), radius_m=0.02, depth_range_m=(0.03, 0.1))


def test_arguments_out_of_range_are_refused(ball):
    with pytest.raises(ValueError, match=r"diameter_range_m=\(0.02, 0.01\) must ascend"):
        plant_lobulated(ball, 1, rng=np.random.default_rng(0), diameter_range_m=(0.02, 0.01))
    with pytest.raises(ValueError, match=r"radius_m=0\.0 must be above 0"):
        plant_spheres(ball, 1, rng=np.random.default_rng(0), radius_m=0.0)


def test_the_same_seed_plants_the_same_tumours(ball):
    one, other = (plant_lobulated(ball, 2, rng=np.random.default_rng(9)) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.vertices_m, b.vertices_m)
