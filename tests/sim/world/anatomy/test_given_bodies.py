"""Tumours, targets and structures in files of their own: one rule for meshes, masks and surfaces in memory."""

import numpy as np
import pytest
import trimesh
from scanned_ball import CENTRE_MM, TUMOUR_MM, ball_labels, grid, load, save_nifti

from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.errors import AnatomyError, MeshError, WorldError
from sim.world.solids.solid import Solid
from sim.world.volumes.label_coding import LabelChoice


def ball_mm(radius_mm, middle_mm=TUMOUR_MM, subdivisions=3):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_mm)
    mesh.apply_translation(middle_mm)
    return mesh


def saved(mesh, path):
    mesh.export(path)
    return str(path)


def mask(path, spheres, spacing_mm=(3.0, 3.0, 3.0), half_mm=66.0):
    """A label volume of balls: (label, middle [mm], radius [mm]) each."""
    T, shape = grid(spacing_mm, half_mm=half_mm)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    labels = np.zeros(shape, np.uint8)
    for label, middle_mm, radius_mm in spheres:
        labels[np.linalg.norm(points_mm - middle_mm, axis=-1) < radius_mm] = label
    return str(save_nifti(path, labels, T))


def named_mask(path, names, labels):
    """A .seg.nrrd of labels with names."""
    import nrrd

    T, _ = grid()
    header = {
        "space": "left-posterior-superior",
        "space directions": T[:3, :3].T,
        "space origin": T[:3, 3],
    }
    for index, (label, name) in enumerate(names.items()):
        header |= {f"Segment{index}_LabelValue": str(label), f"Segment{index}_Name": name}
        header |= {f"Segment{index}_Layer": "0", f"Segment{index}_ID": f"S{index}"}
    nrrd.write(str(path), labels, header)
    return str(path)


@pytest.fixture(scope="module")
def liver(tmp_path_factory):
    """The ball without its tumour, as a file of its own."""
    T, shape = grid()
    return save_nifti(
        tmp_path_factory.mktemp("organ") / "liver.nii.gz", (ball_labels(T, shape) > 0).astype(np.uint8), T
    )


@pytest.mark.parametrize("diameter_mm", [2.8, 3.3])
def test_one_rule_of_size_holds_for_labels_masks_meshes_and_memory(tmp_path, diameter_mm):
    # A grid of 0.5 mm about a small organ holds either ball within a tenth of its diameter.
    middle, organ = CENTRE_MM, (1, CENTRE_MM, 20.0)
    fine = {"spacing_mm": (0.5, 0.5, 0.5), "half_mm": 22.0}
    alone = mask(tmp_path / "organ.nii.gz", [organ], **fine)
    both = mask(tmp_path / "both.nii.gz", [organ, (2, middle, diameter_mm / 2)], **fine)
    own = mask(tmp_path / "nodule.nii.gz", [(1, middle, diameter_mm / 2)], **fine)
    mesh = saved(ball_mm(diameter_mm / 2, middle), tmp_path / "nodule.stl")
    memory = Solid.from_trimesh(trimesh.load(mesh, process=True)).vertices_m * 1e-3
    solid = Solid(memory, np.asarray(trimesh.load(mesh, process=True).faces))
    ways = [load(both), *(load(alone, tumours=(each,)) for each in (own, mesh, solid))]
    is_kept = diameter_mm > 3.0
    assert [len(each.tumours) for each in ways] == [int(is_kept)] * 4
    for each in ways:
        assert (
            any(
                "taken for noise of the outline and dropped, as all under 3 mm are" in n for n in each.notices
            )
            != is_kept
        )


def test_the_names_in_a_tumours_own_file_are_kept_and_tell_what_is_none(tmp_path, liver):
    T, shape = grid()
    labels = ball_labels(T, shape)
    labels[:6, :6, :6] = 5
    path = named_mask(tmp_path / "t.seg.nrrd", {1: "Liver", 2: "HCC, segment 7", 5: "aorta vessel"}, labels)
    loaded = load(liver, tumours=(path,))
    assert len(loaded.tumours) == 1
    assert loaded.tumour_names[0].endswith("t.seg.nrrd (HCC, segment 7)")
    said = " ".join(loaded.notices)
    assert "by the labels' names 2 'HCC, segment 7' is taken for a tumour" in said
    assert "the labels 1 'Liver' and 5 'aorta vessel' are left out" in said


def test_an_organ_in_a_tumours_file_is_told_by_what_it_fills(tmp_path, liver):
    path = mask(tmp_path / "t.nii.gz", [(1, CENTRE_MM, 55.0), (2, TUMOUR_MM, 11.0)])
    loaded = load(liver, tumours=(path,))
    assert len(loaded.tumours) == 1
    assert loaded.tumours[0].volume_m3 < 1e-5
    assert any("is taken for the organ itself" in notice for notice in loaded.notices)
    with pytest.raises(MeshError, match=r"fills 100% of the organ, so it is the organ itself and no tumour"):
        load(liver, tumours=(str(liver),))


def test_the_same_holds_for_objects_of_a_mesh(tmp_path, liver):
    scene = trimesh.Scene()
    scene.add_geometry(ball_mm(55.0, CENTRE_MM), node_name="liver", geom_name="liver")
    scene.add_geometry(ball_mm(11.0), node_name="tumour", geom_name="tumour")
    loaded = load(liver, tumours=(saved(scene, tmp_path / "t.obj"),))
    assert [each.volume_m3 < 1e-5 for each in loaded.tumours] == [True]
    assert any("'tumour'" in n and "'liver'" in n and "left out" in n for n in loaded.notices)


def test_a_piece_outside_beside_one_inside_is_dropped_and_all_outside_are_refused(tmp_path, liver):
    far_mm = CENTRE_MM + np.array([64.0, 30.0, 30.0])
    path = mask(tmp_path / "t.nii.gz", [(1, TUMOUR_MM, 11.0), (1, far_mm, 5.0)], half_mm=80.0)
    loaded = load(liver, tumours=(path,))
    assert len(loaded.tumours) == 1
    assert any("a tumour outside the organ was dropped" in notice for notice in loaded.notices)


@pytest.mark.parametrize(("offset_mm", "is_far"), [((0.0, 0.0, 90.0), False), ((0.0, -157.0, 0.0), True)])
def test_a_structure_far_from_the_organ_is_told_with_its_distance(tmp_path, liver, offset_mm, is_far):
    path = saved(ball_mm(10.0, CENTRE_MM + offset_mm), tmp_path / "gallbladder.stl")
    loaded = load(liver, keepouts=(path,))
    told = [notice for notice in loaded.notices if notice.startswith("gallbladder: lies")]
    assert len(told) == is_far
    if is_far:
        # 157 mm between the middles, less the radii of 55 and 10 mm.
        distance_mm = int(told[0].split()[2])
        assert distance_mm == pytest.approx(92, abs=2)  # by vertices some millimetres apart
        assert "mm from the organ, so no pose is kept away from it; check that both files" in told[0]


def test_a_structure_in_other_axes_is_told_by_where_it_would_lie(tmp_path, liver):
    path = saved(ball_mm(10.0, CENTRE_MM * [-1, -1, 1]), tmp_path / "vein.stl")
    (told,) = [notice for notice in load(liver, structures=(path,)).notices if "vein: lies" in notice]
    assert "turned from RAS to LPS axes, or back, it would lie 0 mm from it" in told
    assert not any("vein: lies" in n for n in load(liver, structures=(path,), frame="ras").notices)


def test_an_organ_too_small_to_press_on_is_refused_however_it_is_given(tmp_path):
    volume = mask(tmp_path / "liver.nii.gz", [(1, CENTRE_MM, 3.0)], spacing_mm=(0.3, 0.3, 0.3), half_mm=5.0)
    with pytest.raises(
        AnatomyError, match=r"is 6\.\d+ mm long, and must be from 30 to 2000 mm; .*`spacing_mm`"
    ):
        load(volume)
    with pytest.raises(MeshError, match=r"6 mm long, below 30 mm; if the file is in centimetres or inches"):
        load(saved(ball_mm(3.0), tmp_path / "liver.stl"))
    tiny = Solid(np.asarray(ball_mm(3.0).vertices) * 1e-3, np.asarray(ball_mm(3.0).faces))
    with pytest.raises(WorldError, match=r"6 mm long.*a surface in memory is in metres"):
        load_anatomy(CaseFiles(organ=tiny))


@pytest.mark.parametrize(
    ("name", "word"), [("kidney_left", "kidney_left"), ("Leber", "human liver"), ("case7", "if the organ")]
)
def test_sizes_are_judged_by_what_the_organ_is_called(tmp_path, name, word):
    def remarks(radius_mm):
        path = saved(ball_mm(radius_mm), tmp_path / f"{name}.stl")
        return [notice for notice in load(path).notices if "implausible" in notice]

    assert len(remarks(110.0)) == 1  # 5.6 litres are none of any organ's
    assert word in remarks(110.0)[0]
    # 113 ml are a kidney and no liver.
    assert [("liver" in each) for each in remarks(30.0)] == ([] if name.startswith("kidney") else [True])
    assert "tumour" not in " ".join(remarks(30.0))


def test_labels_asked_for_that_are_another_files_are_told(tmp_path, liver):
    path = mask(tmp_path / "t.nii.gz", [(1, TUMOUR_MM, 11.0), (4, CENTRE_MM - np.array([20, 0, 0]), 8.0)])
    loaded = load(liver, tumours=(path,), labels=LabelChoice(tumours=(7, 4)))
    assert len(loaded.tumours) == 1
    assert any("the label 1 is left out" in notice for notice in loaded.notices)


def test_an_organ_larger_than_half_a_person_is_refused(tmp_path):
    with pytest.raises(AnatomyError, match=r"has 87 litres, and no organ more than 30; check the unit"):
        load(saved(ball_mm(275.0, (0.0, 0.0, 0.0), 4), tmp_path / "liver.stl"))


def test_a_tumour_apart_is_refused_with_its_distance(tmp_path, liver):
    loaded = load(
        liver, tumours=(saved(ball_mm(10.0, CENTRE_MM + np.array([0, 0, 105])), tmp_path / "t.stl"),)
    )
    with pytest.raises(AnatomyError, match=r"only 0% of it.*must, and it lies (39|40) mm away"):
        build_anatomy(loaded.organ, loaded.tumours, name="x", rng=np.random.default_rng(0))


def test_an_outline_too_thin_to_draw_is_told(tmp_path):
    T, shape = grid()
    labels = np.zeros(shape, np.uint8)
    labels[5:-5, 5:-5, 20] = 1
    (told,) = [
        n for n in load(save_nifti(tmp_path / "s.nii.gz", labels, T)).notices if "surface encloses" in n
    ]
    assert "as it is thin next to them" in told
