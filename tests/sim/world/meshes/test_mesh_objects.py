"""Several objects or bodies in one mesh file: the organ is the one that is meant, and the rest is told."""

import numpy as np
import pytest
import trimesh

from sim.episode.scenario_file import load_scenario
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.errors import MeshError
from sim.world.meshes.meshes import load_bodies, load_mesh

ORGAN_MM, TUMOUR_MM = 55.0, 11.0


def ball(radius_mm, at_mm=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius_mm)
    mesh.apply_translation(at_mm)
    return mesh


def vein():
    """A tube that sticks out of the organ."""
    tube = trimesh.creation.cylinder(radius=6.0, height=90.0)
    tube.apply_translation([0.0, 0.0, 40.0])
    return tube


def case(names=("liver", "tumor", "portal_vein")):
    return dict(zip(names, (ball(ORGAN_MM), ball(TUMOUR_MM, (18.0, -10.0, 12.0)), vein()), strict=True))


def write_obj(path, meshes, kind="o"):
    lines, start = [], 1
    for name, mesh in meshes.items():
        lines.append(f"{kind} {name}")
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + start]
        start += len(mesh.vertices)
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def write_stl(path, meshes):
    parts = []
    for name, mesh in meshes.items():
        text = trimesh.exchange.stl.export_stl_ascii(mesh).split("\n", 1)[1]
        parts.append(f"solid {name}\n{text}".rstrip().replace("endsolid", "endsolid "))
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def write_glb(path, meshes):
    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=f"geometry_{len(scene.geometry)}")
    path.write_bytes(scene.export(file_type="glb"))
    return path


WRITERS = {
    "o.obj": write_obj,
    "g.obj": lambda path, meshes: write_obj(path, meshes, "g"),
    "usemtl.obj": lambda path, meshes: write_obj(path, meshes, "usemtl"),
    "all.stl": write_stl,
    "all.glb": write_glb,
}


def volume_ml(radius_mm):
    return ball(radius_mm).volume * 1e-3


def load(path, **options):
    return load_anatomy(CaseFiles(organ=str(path), **options))


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("names", [("liver", "tumor", "portal_vein"), ("Leber", "Läsion", "Gefäße")], ids=str)
def test_names_tell_what_each_object_is(tmp_path, name, names):
    loaded = load(WRITERS[name](tmp_path / name, case(names)))
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(ORGAN_MM), rel=1e-4)
    (tumour,) = loaded.tumours
    assert tumour.volume_m3 * 1e6 == pytest.approx(volume_ml(TUMOUR_MM), rel=1e-4)
    assert [structure.name for structure in loaded.structures] == [names[2]]
    (notice,) = loaded.notices
    for each in names:
        assert repr(each) in notice
    assert "about LPS 18 -10 12 mm" in notice


@pytest.mark.parametrize("name", WRITERS)
def test_without_telling_names_the_largest_is_the_organ_and_the_rest_is_told(tmp_path, name):
    loaded = load(WRITERS[name](tmp_path / name, case(("Mesh_0", "Mesh_1", "Mesh_2"))))
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(ORGAN_MM), rel=1e-4)
    assert not loaded.tumours
    assert not loaded.structures
    assert any("'Mesh_1'" in n and "left out" in n and "`organ_object`" in n for n in loaded.notices)


def test_the_organ_can_be_named_whatever_its_capitals_and_accents(tmp_path):
    path = write_obj(
        tmp_path / "all.obj", {"Niere links": ball(40.0), "Niere rechts": ball(38.0, (120.0, 0.0, 0.0))}
    )
    with pytest.raises(
        MeshError, match=r"which of its objects.*'Niere links' \(26\d ml.*'Niere rechts'.*`organ_object`"
    ):
        load(path)
    loaded = load(path, organ_object="niere RECHTS")
    assert loaded.organ.bounds_m.mean(axis=0) == pytest.approx([0.12, 0.0, 0.0], abs=1e-6)
    with pytest.raises(MeshError, match=r"no object 'Milz'; it holds 'Niere links'"):
        load(path, organ_object="Milz")


def test_tumours_stay_tumours_where_the_organ_is_named(tmp_path):
    meshes = case(("A", "tumor", "B")) | {"C": ball(50.0, (150.0, 0.0, 0.0))}
    loaded = load(write_obj(tmp_path / "all.obj", meshes), organ_object="A")
    assert len(loaded.tumours) == 1
    assert any("'B'" in notice and "'C'" in notice and "left out" in notice for notice in loaded.notices)


def test_a_tumour_by_name_outside_the_organ_is_dropped_and_said_so(tmp_path):
    meshes = {"liver": ball(ORGAN_MM), "tumor": ball(TUMOUR_MM, (200.0, 0.0, 0.0))}
    loaded = load(write_obj(tmp_path / "all.obj", meshes))
    assert not loaded.tumours
    assert any("outside the organ was dropped" in notice for notice in loaded.notices)


def test_a_surface_that_is_cut_into_groups_is_one_and_the_same_to_the_bit(tmp_path):
    mesh = ball(ORGAN_MM)
    is_up = mesh.triangles_center[:, 2] > 0.0
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices]
    faces = (
        [f"f {a} {b} {c}" for a, b, c in mesh.faces[is_up] + 1],
        [f"f {a} {b} {c}" for a, b, c in mesh.faces[~is_up] + 1],
    )
    (tmp_path / "cut.obj").write_text("\n".join([*lines, "g upper", *faces[0], "g lower", *faces[1]]))
    (tmp_path / "whole.obj").write_text("\n".join([*lines, *faces[0], *faces[1]]))
    cut, whole = load_mesh(tmp_path / "cut.obj"), load_mesh(tmp_path / "whole.obj")
    assert cut.notices == ()
    assert np.array_equal(cut.solid.vertices_m, whole.solid.vertices_m)
    assert np.array_equal(cut.solid.faces, whole.solid.faces)


def test_one_object_may_be_called_by_its_name(tmp_path):
    path = write_obj(tmp_path / "one.obj", {"liver": ball(ORGAN_MM)})
    assert load(path, organ_object="Liver").notices == ()
    with pytest.raises(MeshError, match="holds no object 'spleen'"):
        load(path, organ_object="spleen")


def test_an_island_far_away_is_no_part_of_the_organ_and_is_told(tmp_path):
    path = tmp_path / "liver.stl"
    trimesh.util.concatenate([ball(70.0), ball(25.0, (0.0, 0.0, 220.0))]).export(path)
    loaded = load(path)
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(70.0), rel=1e-5)
    (notice,) = loaded.notices
    # The balls' surfaces are 220 - 70 - 25 mm apart.
    assert (
        "an island was dropped beside the organ, 65 ml in all, 125 mm from it about LPS 0 0 220 mm" in notice
    )


def test_a_large_body_apart_is_asked_about_and_can_be_taken(tmp_path):
    path = tmp_path / "kidneys.stl"
    trimesh.util.concatenate([ball(40.0), ball(38.0, (150.0, 0.0, 0.0))]).export(path)
    with pytest.raises(
        MeshError, match=r"piece 1 \(26\d ml.*piece 2 \(22\d ml.*`organ_object` 'piece 1' or 'piece 2'"
    ):
        load(path)
    loaded = load(path, organ_object="piece 2")
    assert loaded.organ.bounds_m.mean(axis=0) == pytest.approx([0.15, 0.0, 0.0], abs=1e-5)
    assert any("an island was dropped" in notice for notice in loaded.notices)
    with pytest.raises(MeshError, match="holds no object 'piece 3'"):
        load(path, organ_object="piece 3")


def test_a_piece_close_by_is_kept_and_told(tmp_path):
    path = tmp_path / "liver.stl"
    trimesh.util.concatenate([ball(60.0), ball(30.0, (94.0, 0.0, 0.0))]).export(path)
    loaded = load(path)
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(60.0) + volume_ml(30.0), rel=1e-4)
    (notice,) = loaded.notices
    assert "2 separate pieces, all of which are kept" in notice
    assert "4.0 mm from the largest" in notice


def test_a_body_within_the_organ_is_told_and_a_cavity_stays(tmp_path):
    path, cavity = tmp_path / "liver.stl", ball(8.0, (-20.0, 0.0, 0.0))
    cavity.invert()
    trimesh.util.concatenate([ball(ORGAN_MM), ball(TUMOUR_MM, (20.0, 0.0, 0.0)), cavity]).export(path)
    loaded = load(path)
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(ORGAN_MM) - volume_ml(8.0), rel=1e-4)
    assert any("lies wholly inside the organ" in notice and "`tumour`" in notice for notice in loaded.notices)


def test_bodies_of_a_tumours_file_are_tumours_of_their_own(tmp_path):
    path = tmp_path / "tumours.stl"
    trimesh.util.concatenate([ball(8.0), ball(12.0, (40.0, 0.0, 0.0)), ball(1.0, (70.0, 0.0, 0.0))]).export(
        path
    )
    solids, notices = load_bodies(path)
    assert [each.volume_m3 * 1e6 for each in solids] == pytest.approx(
        [volume_ml(12.0), volume_ml(8.0)], rel=1e-4
    )
    assert any("2 separate bodies, each of which is a tumour" in notice for notice in notices)
    assert any("a body of 2 mm across was taken for noise" in notice for notice in notices)
    ball(1.4).export(path)
    solids, notices = load_bodies(path)
    assert solids == ()
    assert any("a body of 2.8 mm across was taken for noise" in notice for notice in notices)


def test_a_scenario_file_names_the_object_too(tmp_path):
    write_obj(tmp_path / "all.obj", case())
    path = tmp_path / "case.toml"
    path.write_text('organ = "all.obj"\norgan_object = "liver"\n')
    files = load_scenario(str(path)).case_files
    assert files.organ_object == "liver"
    assert load_anatomy(files).organ.volume_m3 * 1e6 == pytest.approx(volume_ml(ORGAN_MM), rel=1e-4)
