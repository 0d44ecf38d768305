import numpy as np
import pytest
import trimesh

from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.anatomy.placement import lay_on_table
from sim.world.errors import AnatomyError, MeshError
from sim.world.solids.solid import Solid


def ball(centre_m=(0.0, 0.0, 0.0), radius_m=0.06):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius_m)
    mesh.apply_translation(centre_m)
    return Solid.from_trimesh(mesh)


def rng():
    return np.random.default_rng(0)


def test_detection_points_are_500_in_each_tumour():
    tumours = (ball((0.03, 0, 0), 0.01), ball((-0.03, 0, 0), 0.005))
    anatomy = build_anatomy(ball(), tumours, name="two", rng=rng())
    assert anatomy.detection_points_m.shape == (1000, 3)
    assert np.bincount(anatomy.detection_tumours).tolist() == [500, 500]
    assert np.array_equal(anatomy.tumour_of(anatomy.detection_points_m), anatomy.detection_tumours)
    assert anatomy.is_tumour(anatomy.detection_points_m).all()
    assert anatomy.notices == ()


def test_truth_is_what_lies_in_the_organ_and_in_a_tumour():
    protruding = ball((0.06, 0.0, 0.0), 0.02)
    anatomy = build_anatomy(ball((0, 0, 0), 0.065), (protruding,), name="edge", rng=rng())
    points = rng().uniform(-0.09, 0.09, size=(5000, 3))
    in_organ = ball((0, 0, 0), 0.065).to_trimesh().contains(points)
    in_tumour = protruding.to_trimesh().contains(points)
    assert min((in_organ & in_tumour).sum(), (in_tumour & ~in_organ).sum()) > 5
    assert np.array_equal(anatomy.is_tumour(points), in_organ & in_tumour)
    assert np.array_equal(anatomy.is_inside_organ(points), in_organ)
    assert anatomy.is_inside_organ(anatomy.detection_points_m).all()


def test_points_in_two_tumours_belong_to_the_first():
    anatomy = build_anatomy(ball(), (ball((0, 0, 0), 0.01), ball((0, 0, 0), 0.02)), name="nested", rng=rng())
    points = np.array([[0.001, 0.002, 0.003], [0.015, 0.001, 0.0], [0.04, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert anatomy.tumour_of(points).tolist() == [0, 1, -1, -1]


def test_protrusion_is_remarked_on_with_its_share():
    # A ball of radius r centred on a flat face: half of it is outside; shifted inwards by r/2, 5/32 are.
    organ = Solid.from_trimesh(trimesh.creation.box((0.2, 0.2, 0.2)))
    anatomy = build_anatomy(organ, (ball((0, 0, 0.09), 0.02),), name="cap", rng=rng())
    assert len(anatomy.notices) == 1
    share = float(anatomy.notices[0].split(": ")[1].split("%")[0]) / 100
    assert anatomy.notices[0].startswith("tumour 1: ")
    assert share == pytest.approx(5 / 32, abs=0.06)  # 4 standard errors of 500 draws


def test_a_tumour_outside_is_refused_by_name():
    with pytest.raises(
        AnatomyError, match=r"far\.stl: only 0% of it lies inside the organ, .* frame and unit"
    ):
        build_anatomy(ball(), (ball((0.2, 0, 0), 0.01),), name="x", rng=rng(), tumour_names=("far.stl",))


def test_a_tumour_mostly_outside_is_refused():
    organ = Solid.from_trimesh(trimesh.creation.box((0.2, 0.2, 0.2)))
    with pytest.raises(AnatomyError, match="tumour 1: only"):
        build_anatomy(organ, (ball((0, 0, 0.105), 0.02),), name="x", rng=rng())


def test_no_tumour_is_allowed():
    anatomy = build_anatomy(ball(), name="healthy", rng=rng())
    assert anatomy.detection_points_m.shape == (0, 3)
    assert not anatomy.is_tumour(rng().uniform(-0.05, 0.05, size=(100, 3))).any()
    assert anatomy.tumour_volumes_m3.shape == (0,)


def test_names_must_match_the_tumours():
    with pytest.raises(AnatomyError, match="2 tumour names were given for 1 tumours"):
        build_anatomy(ball(), (ball((0, 0, 0), 0.01),), name="x", rng=rng(), tumour_names=("a", "b"))


@pytest.fixture
def files(tmp_path):
    organ = trimesh.creation.box((160.0, 120.0, 100.0))
    tumour = trimesh.creation.icosphere(subdivisions=2, radius=8.0)
    tumour.apply_translation([30.0, -40.0, 20.0])
    paths = tmp_path / "organ.stl", tmp_path / "tumour.stl"
    organ.export(paths[0])
    tumour.export(paths[1])
    return paths


def test_files_are_laid_on_the_table_with_their_tumours(files):
    loaded = load_anatomy(CaseFiles(organ=str(files[0]), tumours=(str(files[1]),)))
    placed = lay_on_table(loaded.organ, loaded.tumours)
    assert placed.organ.bounds_m == pytest.approx(
        np.array([[0.42, -0.05, 0.0], [0.58, 0.05, 0.12]]), abs=1e-7
    )
    # left 30, back -40, head 20 of the middle: x + 0.03, z + 0.04 (front up), y + 0.02
    assert placed.tumours[0].bounds_m.mean(axis=0) == pytest.approx([0.53, 0.02, 0.10], abs=1e-6)
    assert placed.T_world_organ @ [0.03, -0.04, 0.02, 1.0] == pytest.approx([0.53, 0.02, 0.10, 1.0], abs=1e-7)


def test_a_tumour_file_in_another_unit_is_refused_with_the_remedy(files, tmp_path):
    small = trimesh.creation.icosphere(radius=0.008)
    small.export(tmp_path / "metres.stl")
    with pytest.raises(MeshError, match=r"metres\.stl: .* tumour is 0\.016 mm long.*`unit` m"):
        load_anatomy(CaseFiles(organ=str(files[0]), tumours=(str(tmp_path / "metres.stl"),)))


def test_the_same_seed_gives_the_same_detection_points(files):
    loaded = load_anatomy(CaseFiles(organ=str(files[0]), tumours=(str(files[1]),)))
    one, other = (build_anatomy(loaded.organ, loaded.tumours, name="x", rng=rng()) for _ in range(2))
    assert np.array_equal(one.detection_points_m, other.detection_points_m)
