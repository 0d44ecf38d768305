"""Real organs, where a folder of them is at hand: SOUNDING_DATA names the folder that holds `livers/`."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sim.world.anatomy_files import load_anatomy
from sim.world.surface import upper_surface_workspace

ROOT = Path(__file__).resolve().parents[1]
LIVERS = Path(os.environ.get("SOUNDING_DATA", ROOT.parent / "shared" / "data")) / "livers"
CASES = sorted(path.parent for path in LIVERS.glob("*/liver.stl"))

pytestmark = pytest.mark.skipif(
    not CASES, reason=f"no livers in {LIVERS}; set SOUNDING_DATA to a folder with livers/"
)


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.name)
def test_a_real_case_loads_is_placed_and_has_a_workspace(case):
    tumours = sorted(case.glob("tumour_*.stl"))
    rng = np.random.default_rng(0)
    anatomy, placed = load_anatomy(case / "liver.stl", tumours, rng=rng)
    facts = json.loads((case / "case.json").read_text())
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
