"""Real organs, where a folder of them is at hand: SOUNDING_DATA names the folder that holds `livers/`."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.anatomy.placement import lay_on_table
from sim.world.anatomy.surface import upper_surface_workspace
from sim.world.volumes.label_coding import LabelChoice

ROOT = Path(__file__).resolve().parents[4]
LIVERS = Path(os.environ.get("SOUNDING_DATA", ROOT.parent / "shared" / "data")) / "livers"
MESHES = sorted(path.parent for path in LIVERS.glob("*/liver.stl"))
VOLUMES = sorted(path.parent for path in LIVERS.glob("*/segmentation.nii.gz"))

pytestmark = pytest.mark.skipif(
    not MESHES, reason=f"no livers in {LIVERS}; set SOUNDING_DATA to a folder with livers/"
)


def facts_of(case):
    return json.loads((case / "case.json").read_text())


@pytest.mark.parametrize("case", MESHES, ids=lambda path: path.name)
def test_a_real_case_loads_is_placed_and_has_a_workspace(case):
    tumours = sorted(case.glob("tumour_*.stl"))
    rng = np.random.default_rng(0)
    loaded = load_anatomy(CaseFiles(organ=str(case / "liver.stl"), tumours=tuple(map(str, tumours))))
    placed = lay_on_table(loaded.organ, loaded.tumours)
    anatomy = build_anatomy(placed.organ, placed.tumours, name=case.name, rng=rng)
    facts = facts_of(case)
    assert len(anatomy.tumours) == facts["n_tumours"] == len(tumours)
    # The volumes were stated from the same outlines before simplification.
    assert anatomy.organ.volume_m3 * 1e6 == pytest.approx(facts["liver"]["ml"], rel=0.01)
    left_right, back_front, foot_head = np.array(facts["liver"]["extents_mm"]) * 1e-3
    assert placed.organ.extents_m == pytest.approx([left_right, foot_head, back_front], rel=0.01)
    assert anatomy.organ.bounds_m[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert anatomy.is_inside_organ(anatomy.detection_points_m).all()
    assert len(anatomy.detection_points_m) == 500 * len(tumours)

    surface = upper_surface_workspace(anatomy.organ, 2000, rng=rng)
    assert surface.n_poses == pytest.approx(2000, rel=0.1)
    # A step along the inward normal leads into the organ, one back out of it, but at sharp margins and folds.
    assert anatomy.is_inside_organ(surface.positions_m + 0.003 * surface.normals).mean() > 0.97
    assert anatomy.is_inside_organ(surface.positions_m - 0.003 * surface.normals).mean() < 0.03


@pytest.mark.parametrize("case", VOLUMES, ids=lambda path: path.name)
def test_a_real_label_volume_has_the_volumes_and_places_that_its_case_states(case):
    loaded = load_anatomy(CaseFiles(organ=str(case / "segmentation.nii.gz")))
    facts = facts_of(case)
    assert len(loaded.tumours) == facts["n_tumours"]
    # Stated of smoothed outlines, which lose up to a hundredth against the voxels; small tumours more.
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(facts["liver"]["ml"], rel=0.005)
    # The blur of a voxel blunts the thin tip of a left lobe by up to two and a half voxels.
    assert loaded.organ.extents_m * 1e3 == pytest.approx(facts["liver"]["extents_mm"], abs=4.0)
    for tumour, stated in zip(loaded.tumours, facts["tumours"], strict=True):
        assert tumour.volume_m3 * 1e6 == pytest.approx(stated["ml"], rel=0.07)
        # Centres within a third of a voxel: the frame is right to the last half voxel.
        middle_mm = tumour.sample_inside(4000, np.random.default_rng(0)).mean(axis=0) * 1e3
        assert middle_mm == pytest.approx(stated["centre_lps_mm"], abs=0.5)


def test_a_label_volume_and_the_meshes_made_of_it_lie_at_one_place():
    case = LIVERS / "unc_p2_HCC_031"
    labels = LabelChoice(organ=(1, 2, 3, 4), tumours=(11, 12), structures=(2, 3, 4))
    volume = load_anatomy(CaseFiles(organ=str(case / "labels.nii.gz"), labels=labels))
    mesh = load_anatomy(CaseFiles(organ=str(case / "liver.stl")))
    assert volume.organ.bounds_m * 1e3 == pytest.approx(mesh.organ.bounds_m * 1e3, abs=1.5)
    assert [each.name for each in volume.structures] == ["label 2", "label 3", "label 4"]
