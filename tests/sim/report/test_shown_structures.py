"""Vessels and no-press zones after the run: kept in its folder, and shown by everything that is made of it."""

from __future__ import annotations

import dataclasses
import json
import shutil

import numpy as np
import pytest
import trimesh
from opened_page import Opened
from shared_runs import without_figures

from sim.cli.command_line import main
from sim.findings.results import write_results
from sim.record.recording import read_recording
from sim.record.run_record import load_run
from sim.record.trajectories import read_anatomy
from sim.report.mesh_thinning import LEAST_FACES
from sim.report.packing import Pack
from sim.report.view_data import MOST_STRUCTURE_FACES, view_data
from sim.world.scene.scene import Group
from sim.world.solids.solid import Solid


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run on a ball with a vessel that is open at both ends and a gallbladder to keep away from."""
    folder = tmp_path_factory.mktemp("structures")
    trimesh.creation.icosphere(subdivisions=4, radius=60.0).export(folder / "organ.stl")
    trimesh.creation.icosphere(subdivisions=3, radius=14.0).export(folder / "tumour.stl")
    vessel = trimesh.creation.cylinder(radius=5.0, height=90.0, sections=48).subdivide()
    vessel.update_faces(np.abs(vessel.face_normals[:, 2]) < 0.5)
    vessel.export(folder / "portal <vein>.stl")
    bladder = trimesh.creation.icosphere(subdivisions=3, radius=12.0)
    bladder.apply_translation([0.0, -55.0, 20.0])
    bladder.export(folder / "gallbladder.stl")
    files = ["--organ", "organ.stl", "--tumour", "tumour.stl", "--structure", "portal <vein>.stl",
             "--keepout", "gallbladder.stl"]  # fmt: skip
    arguments = [str(folder / word) if word.endswith(".stl") else word for word in files]
    more = ["--planner", "random", "--steps", "2", "--arm", "none", "--out", str(folder / "run")]
    with without_figures():
        assert main(["episode", *arguments, *more]) == 0
    return folder / "run"


@pytest.fixture
def run(recorded, tmp_path):
    return shutil.copytree(recorded, tmp_path / "run")


def forget_structures(run) -> None:
    """Make of a run one of before structures were kept."""
    with np.load(run / "anatomy.npz") as arrays:
        kept = {key: arrays[key] for key in arrays.files if not key.startswith("structure")}
    np.savez(run / "anatomy.npz", **kept)


def test_a_run_keeps_its_structures_where_they_lay(recorded) -> None:
    anatomy = read_anatomy(recorded)
    vessel, bladder = anatomy.structures
    assert [(each.name, each.is_keepout) for each in anatomy.structures] == [
        ("portal <vein>", False), ("gallbladder", True),
    ]  # fmt: skip
    T = np.array(json.loads((recorded / "config.json").read_text())["T_world_organ"])
    np.testing.assert_allclose(vessel.solid.bounds_m.mean(axis=0), T[:3, 3], atol=1e-6)
    middle_m = bladder.solid.bounds_m.mean(axis=0)
    np.testing.assert_allclose(middle_m, T[:3, :3] @ [0.0, -0.055, 0.02] + T[:3, 3], atol=1e-6)
    assert len(anatomy.tumours) == 1


def test_a_replay_sees_them(recorded) -> None:
    model = read_recording(recorded).scene.model
    shown = [model.geom(i).name for i in np.flatnonzero(model.geom_group == Group.SCENERY)]
    assert sum(name.startswith("structure") for name in shown) == 2


def test_the_scene_for_other_programs_holds_them(run) -> None:
    write_results(load_run(run))
    scene = trimesh.load(run / "surfaces" / "mapped.glb")
    assert {"structure_1", "keepout_2"} <= set(scene.geometry)


def test_large_ones_are_thinned_for_the_page(recorded) -> None:
    record = load_run(recorded)
    fine = trimesh.creation.icosphere(subdivisions=5, radius=0.03)  # 20,480 triangles
    many = tuple(
        dataclasses.replace(record.anatomy.structures[1], solid=Solid.from_trimesh(fine)) for _ in range(3)
    )
    crowded = dataclasses.replace(
        record, anatomy=dataclasses.replace(record.anatomy, structures=(*record.anatomy.structures, *many))
    )
    shown = view_data(crowded, Pack())["structures"]
    assert len(shown) == 5
    n_faces = sum(mesh["faces"]["n"] // 3 for mesh in shown)
    assert n_faces <= 1.01 * MOST_STRUCTURE_FACES + 2 * LEAST_FACES
    assert shown[0]["faces"]["n"] // 3 >= 0.7 * min(
        LEAST_FACES, len(record.anatomy.structures[0].solid.faces)
    )


def test_a_run_of_before_they_were_kept_still_opens(run) -> None:
    forget_structures(run)
    assert read_anatomy(run).structures == ()
    assert main(["report", str(run)]) == 0
    assert main(["replay", str(run)]) == 0


def test_a_rerun_recording_holds_them(run, tmp_path) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'sounding[rerun]'")
    sizes = []
    for name in ("with", "without"):
        path = tmp_path / f"{name}.rrd"
        assert main(["view", str(run), "--rerun", str(path)]) == 0
        sizes.append(path.stat().st_size)
        forget_structures(run)
    assert sizes[0] > sizes[1] + 20_000


def test_the_page_shows_them_and_hides_them_one_kind_at_a_time(browser, recorded) -> None:
    opened = Opened(browser, recorded / "report.html", viewport={"width": 1280, "height": 900})
    page = opened.ready()
    pictures = [page.locator("#view").screenshot()]
    for name in ("structures", "keepouts"):
        page.locator(f"input[name={name}]").uncheck()
        page.wait_for_timeout(150)
        pictures.append(page.locator("#view").screenshot())
    assert len(set(pictures)) == 3
    assert page.locator("label:has(input[name=structures])").get_attribute("title") == "portal <vein>"
    assert opened.complaints == []
    opened.context.close()


def test_a_page_without_them_has_no_toggle(browser, run) -> None:
    forget_structures(run)
    assert main(["report", str(run)]) == 0
    opened = Opened(browser, run / "report.html")
    page = opened.ready()
    assert page.locator("input[name=organ]").count() == 1
    assert page.locator("input[name=structures], input[name=keepouts]").count() == 0
    assert opened.complaints == []
    opened.context.close()
