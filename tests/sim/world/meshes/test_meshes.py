import numpy as np
import pytest
import trimesh

from sim.world.errors import MeshError
from sim.world.meshes.meshes import load_mesh
from sim.world.meshes.topology import signed_volume_m3


def ball_mm(radius=50.0, subdivisions=3):
    return trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)


def load(tmp_path, mesh, name="organ.stl", **options):
    path = tmp_path / name
    mesh.export(path)
    return load_mesh(path, **options)


def assert_is_closed_and_outward(mesh):
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_each_format_gives_the_same_ball_in_metres(tmp_path, suffix):
    loaded = load(tmp_path, ball_mm(), f"organ.{suffix}")
    assert_is_closed_and_outward(loaded.mesh)
    assert loaded.mesh.volume == pytest.approx(ball_mm().volume * 1e-9, rel=1e-5)  # files hold 7 digits
    assert loaded.mesh.extents == pytest.approx([0.1] * 3, rel=1e-3)
    assert loaded.notices == ()


def test_metres_are_taken_as_they_are(tmp_path):
    loaded = load(tmp_path, ball_mm(0.05), unit="m")
    assert loaded.mesh.extents == pytest.approx([0.1] * 3, rel=1e-3)


def test_an_ascii_file_and_an_upper_case_suffix_are_read(tmp_path):
    path = tmp_path / "ORGAN.STL"
    path.write_text(trimesh.exchange.stl.export_stl_ascii(ball_mm()))
    assert_is_closed_and_outward(load_mesh(path).mesh)


def test_an_inverted_mesh_is_turned_and_said_so(tmp_path):
    mesh = ball_mm()
    mesh.invert()
    loaded = load(tmp_path, mesh)
    assert_is_closed_and_outward(loaded.mesh)
    assert loaded.notices == ("organ.stl: the surface was inside out and the winding was reversed",)


def test_some_flipped_triangles_are_turned_and_counted(tmp_path):
    mesh = ball_mm()
    faces = mesh.faces.copy()
    faces[::10] = faces[::10, ::-1]
    loaded = load(tmp_path, trimesh.Trimesh(mesh.vertices, faces, process=False))
    assert_is_closed_and_outward(loaded.mesh)
    assert loaded.mesh.volume == pytest.approx(mesh.volume * 1e-9, rel=1e-5)
    assert loaded.notices == (f"organ.stl: {len(faces[::10])} triangles faced the wrong way and were turned",)


def test_a_small_hole_is_filled_and_said_so(tmp_path):
    mesh = ball_mm()
    mesh.update_faces(np.linalg.norm(mesh.triangles_center - [0, 0, 50], axis=1) > 8.0)
    assert not mesh.is_watertight
    loaded = load(tmp_path, mesh)
    assert_is_closed_and_outward(loaded.mesh)
    # The lost cap of radius 8-12 mm holds at most pi h^2 (R - h / 3) = 0.6 ml of 519.
    assert loaded.mesh.volume == pytest.approx(ball_mm().volume * 1e-9, rel=2e-3)
    assert loaded.notices == ("organ.stl: the surface was open: 1 small hole was filled",)


def test_holes_are_filled_even_if_the_triangles_around_them_disagree(tmp_path):
    mesh = ball_mm()
    keeps = np.linalg.norm(mesh.triangles_center - [0, 0, 50], axis=1) > 8.0
    faces = mesh.faces[keeps]
    faces[::3] = faces[::3, ::-1]
    loaded = load(tmp_path, trimesh.Trimesh(mesh.vertices, faces, process=False))
    assert_is_closed_and_outward(loaded.mesh)
    assert len(loaded.notices) == 2


def test_a_gap_along_a_seam_is_closed_by_merging(tmp_path):
    mesh = ball_mm()
    soup = mesh.triangles + np.random.default_rng(0).uniform(-1e-5, 1e-5, size=mesh.triangles.shape)
    loaded = load(
        tmp_path,
        trimesh.Trimesh(soup.reshape(-1, 3), np.arange(soup.size // 3).reshape(-1, 3), process=False),
    )
    assert_is_closed_and_outward(loaded.mesh)
    assert len(loaded.mesh.faces) == len(mesh.faces)


def test_half_a_ball_is_open(tmp_path):
    mesh = ball_mm()
    mesh.update_faces(mesh.triangles_center[:, 2] > 0)
    with pytest.raises(MeshError, match=r"organ\.stl: the surface is open: \d+ edges .* close it"):
        load(tmp_path, mesh)


def test_doubled_triangles_are_dropped(tmp_path):
    mesh = ball_mm()
    doubled = trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:100]]), process=False)
    loaded = load(tmp_path, doubled)
    assert_is_closed_and_outward(loaded.mesh)
    assert loaded.notices == ("organ.stl: 100 doubled triangles were dropped",)


def test_a_wholly_doubled_mesh_loads_once(tmp_path):
    mesh = ball_mm()
    loaded = load(tmp_path, trimesh.Trimesh(mesh.vertices, np.tile(mesh.faces, (2, 1)), process=False))
    assert loaded.mesh.volume == pytest.approx(mesh.volume * 1e-9, rel=1e-5)


def test_debris_beside_the_surface_is_dropped_and_counted(tmp_path):
    scrap = trimesh.Trimesh(
        [[80, 0, 0], [82, 0, 0], [80, 40, 0], [82, 40, 1]], [[0, 1, 2], [1, 3, 2]], process=False
    )
    loaded = load(tmp_path, trimesh.util.concatenate([ball_mm(), scrap]))
    # The rim of the scrap, 84 mm, is longer than a hole that would be filled.
    assert loaded.notices == ("organ.stl: 2 stray triangles beside the surface were dropped",)
    assert loaded.mesh.extents == pytest.approx([0.1] * 3, rel=1e-3)


def test_two_boxes_that_share_an_edge_load(tmp_path):
    one, other = trimesh.creation.box((60, 60, 60)), trimesh.creation.box((60, 60, 60))
    other.apply_translation([60, 60, 0])
    loaded = load(tmp_path, trimesh.util.concatenate([one, other]))
    assert loaded.solid.volume_m3 == pytest.approx(2 * 0.06**3, rel=1e-6)
    assert loaded.notices == ()


def test_a_cavity_stays_a_cavity(tmp_path):
    cavity = ball_mm(20.0)
    cavity.invert()
    loaded = load(tmp_path, trimesh.util.concatenate([ball_mm(), cavity]))
    assert loaded.mesh.volume == pytest.approx((ball_mm().volume - ball_mm(20.0).volume) * 1e-9, rel=1e-5)
    assert loaded.notices == ()


def test_overlapping_bodies_are_allowed_and_remarked_on(tmp_path):
    other = ball_mm()
    other.apply_translation([30.0, 1.0, 2.0])
    loaded = load(tmp_path, trimesh.util.concatenate([ball_mm(), other]))
    assert len(loaded.notices) == 1
    share, rest = loaded.notices[0].removeprefix("organ.stl: ").split("%")
    # Two balls of radius R at distance d share pi (4 R + d) (2 R - d)^2 / 12: 295 ml of a union of 752 ml.
    # A lattice of 32^3 points holds 10,000 in the union: 2 % is four standard errors.
    assert float(share) == pytest.approx(39, abs=2)
    assert rest == " of the volume is covered more than once and counts as inside"


def test_a_surface_that_turns_itself_inside_out_is_refused(tmp_path):
    # A ball pinched at z = -20 mm and mirrored below: a figure of eight whose small lobe is inside out.
    mesh = ball_mm()
    vertices = mesh.vertices.copy()
    vertices[:, :2] *= np.tanh((vertices[:, 2:] + 20.0) / 10.0)
    vertices[:, 1] = np.where(vertices[:, 2] < -20.0, -vertices[:, 1], vertices[:, 1])
    with pytest.raises(MeshError, match=r"crosses itself so that \d+% of its volume is inside out; remesh"):
        load(tmp_path, trimesh.Trimesh(vertices, mesh.faces, process=False))


def test_a_moebius_strip_thickened_by_nothing_is_refused(tmp_path):
    n = 40
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    across = np.array([-10.0, 10.0])
    radius = 50 + across[None] * np.cos(angle / 2)[:, None]
    points = np.stack(
        [
            radius * np.cos(angle)[:, None],
            radius * np.sin(angle)[:, None],
            across[None] * np.sin(angle / 2)[:, None],
        ],
        -1,
    ).reshape(-1, 3)
    faces = []
    for i in range(n):
        a, b = 2 * i, 2 * i + 1
        c, d = (2 * i + 2, 2 * i + 3) if i < n - 1 else (1, 0)
        faces += [[a, b, c], [b, d, c]]
    with pytest.raises(MeshError, match="open"):
        load(tmp_path, trimesh.Trimesh(points, faces, process=False))


def test_millimetres_taken_for_metres_are_named_with_the_remedy(tmp_path):
    with pytest.raises(MeshError, match=r"bounding box of 100 m .* pass `unit` mm"):
        load(tmp_path, ball_mm(), unit="m")


def test_metres_taken_for_millimetres_are_named_with_the_remedy(tmp_path):
    with pytest.raises(MeshError, match=r"organ is 0\.1 mm long, below 30 mm; .*pass `unit` m$"):
        load(tmp_path, ball_mm(0.05))


def test_a_tumour_may_be_small_and_an_organ_of_odd_size_is_remarked_on(tmp_path):
    assert load(tmp_path, ball_mm(1.5), "tumour.stl", role="tumour").notices == ()
    notices = load(tmp_path, ball_mm(20.0)).notices
    assert len(notices) == 1
    assert "0.0332 litres is implausible if the organ is a human liver" in notices[0]


def test_a_flat_closed_sheet_encloses_nothing(tmp_path):
    mesh = ball_mm()
    mesh.vertices[:, 2] *= 1e-6
    with pytest.raises(MeshError, match="encloses no volume"):
        load(tmp_path, mesh, "organ.ply")


def test_vertices_that_are_not_finite_are_counted(tmp_path):
    mesh = ball_mm()
    vertices = np.array(mesh.vertices)
    vertices[:3] = np.nan
    path = tmp_path / "organ.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    path.write_text("\n".join(lines))
    with pytest.raises(MeshError, match=r"3 of 642 vertices are NaN or infinite"):
        load_mesh(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("short.stl", b"\0" * 83),
        ("words.stl", b"this is not a mesh"),
        ("noise.stl", bytes(np.random.default_rng(0).integers(0, 256, 5000, dtype=np.uint8))),
        ("noise.obj", bytes(np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8))),
        ("noise.ply", bytes(np.random.default_rng(2).integers(0, 256, 5000, dtype=np.uint8))),
        ("header.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("index.obj", b"v 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 90\nf 1 2 9\nf 1 2 3\nf 1 2 4\nf 2 3 4\n"),
        ("solid.stl", b"solid x\nendsolid x\n"),
        ("plane.obj", b"v 0 0\nv 90 0\nv 0 90\nv 90 90\nf 1 2 3\nf 2 3 4\n"),
    ],
)
def test_files_that_hold_no_mesh_give_an_error_that_names_them(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MeshError, match=name.replace(".", r"\.")):
        load_mesh(path)


def test_the_readers_own_tracebacks_do_not_reach_the_user(tmp_path, caplog):
    path = tmp_path / "organ.stl"
    text = trimesh.exchange.stl.export_stl_ascii(ball_mm())
    path.write_text(text.replace("normal ", "normal x", 1))
    assert_is_closed_and_outward(load_mesh(path).mesh)
    assert caplog.records == []


def test_truncated_and_flipped_files_never_give_another_error(tmp_path):
    rng = np.random.default_rng(3)
    for suffix in ("stl", "obj", "ply", "glb"):
        path = tmp_path / f"organ.{suffix}"
        ball_mm(subdivisions=1).export(path)
        content = path.read_bytes()
        outcomes = {"loaded": 0, "refused": 0}
        for trial in range(60):
            damaged = bytearray(content[: rng.integers(len(content))] if trial % 2 else content)
            for _ in range(rng.integers(1, 6)):
                if damaged:
                    damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
            path.write_bytes(bytes(damaged))
            try:
                assert load_mesh(path).mesh.volume > 0
                outcomes["loaded"] += 1
            except MeshError:
                outcomes["refused"] += 1
        assert outcomes["refused"] > 10  # truncations at least


def test_a_missing_file_a_folder_and_another_format_are_refused(tmp_path):
    with pytest.raises(MeshError, match="no such file"):
        load_mesh(tmp_path / "absent.stl")
    with pytest.raises(MeshError, match="is a folder; name the file in it"):
        load_mesh(tmp_path)
    (tmp_path / "organ.step").write_text("x")
    with pytest.raises(
        MeshError, match=r"format '\.step' is not read; convert to one of \.stl, \.obj, \.ply, \.glb, \.gltf"
    ):
        load_mesh(tmp_path / "organ.step")


def test_an_unknown_unit_or_role_lists_the_known_ones(tmp_path):
    with pytest.raises(MeshError, match="unit 'inch' is not known; use one of mm, m"):
        load(tmp_path, ball_mm(), unit="inch")
    with pytest.raises(MeshError, match="role 'bone' is not known; use one of organ, tumour"):
        load(tmp_path, ball_mm(), role="bone")


def test_a_surface_turned_inside_out_has_a_negative_volume_wherever_it_lies():
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    far_m = np.asarray(box.vertices) + np.array([5.0, -3.0, 2.0])
    assert signed_volume_m3(far_m, box.faces) == pytest.approx(0.006, rel=1e-12)
    assert signed_volume_m3(far_m, box.faces[:, ::-1]) == pytest.approx(-0.006, rel=1e-12)
