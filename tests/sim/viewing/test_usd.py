"""The USD stage of a run, read back with Pixar's library: who was where at which time, and what the map held then."""

import resource

import numpy as np
import pytest
import trimesh
from scipy.special import expit

import sounding
from sim.cli.command_line import main
from sim.record.map_field import called_from
from sim.record.recording import read_recording, set_state
from sim.record.run_record import load_run

pytest.importorskip("pxr", reason="needs pip install 'sounding[usd]'")
from pxr import Usd, UsdGeom, UsdShade

FREE = {"scenario": "sphere", "arm": "none", "report": False, "show_progress": False}


def stage_of(run, file):
    assert main(["view", str(run), "--usd", str(file)]) == 0
    return Usd.Stage.Open(str(file))


@pytest.fixture(scope="module")
def stage(arm_run, tmp_path_factory):
    """The arm's run."""
    return stage_of(arm_run, tmp_path_factory.mktemp("usd") / "deep" / "run.usdc")


@pytest.fixture(scope="module")
def recording(arm_run):
    return read_recording(arm_run)


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """Stage, recording and record of a run in an organ that breathes and is not where it was planned."""
    run = tmp_path_factory.mktemp("moving") / "run"
    wrong = {"breathing_mm": 8.0, "registration_mm": 5.0}
    options = FREE | {"scenario": "spheres", "motion": "none", "planner": "find-and-outline", "steps": 5}
    sounding.run_episode(**options, **wrong, out=str(run))
    return stage_of(run, run.with_suffix(".usda")), read_recording(run), load_run(run)


def T_world(stage, path, time_s):
    """A prim's place in the world at a time of the procedure, shape (4, 4)."""
    prim = stage.GetPrimAtPath(path)
    assert prim, path
    code = Usd.TimeCode(time_s * stage.GetTimeCodesPerSecond())
    # The library multiplies rows by matrices.
    return np.array(UsdGeom.XformCache(code).GetLocalToWorldTransform(prim)).T


def surface(stage, path, time_s):
    """A mesh at a time of the procedure, in its own frame; None where it has no triangles."""
    mesh, code = UsdGeom.Mesh(stage.GetPrimAtPath(path)), Usd.TimeCode(time_s * stage.GetTimeCodesPerSecond())
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get(code)).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(code))
    assert (counts == 3).all()
    assert len(counts) == len(faces)
    # Corners at an edge are vertices of their own, which are joined again.
    points = np.array(mesh.GetPointsAttr().Get(code))
    return trimesh.Trimesh(points.reshape(-1, 3), faces, process=True) if len(faces) else None


def ends_s(recording):
    motions = recording.motions
    return [begin_s + motions[step].motion_s for step, begin_s in recording.begins_s.items()]


def test_units_and_time_are_told(stage, recording) -> None:
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetEndTimeCode() / stage.GetTimeCodesPerSecond() == pytest.approx(recording.duration_s)
    assert stage.GetDefaultPrim().GetPath() == "/World"


def test_arm_and_tip_are_where_the_run_had_them(stage, recording) -> None:
    scene, data = recording.scene, recording.scene.new_data()
    bodies = [prim.GetName() for prim in stage.GetPrimAtPath("/World/Arm").GetChildren()]
    assert len(bodies) >= 8
    for step, motion in recording.motions.items():
        for row in np.linspace(0, len(motion.states) - 1, 5).astype(int):
            set_state(scene, data, motion.states[row])
            time_s = recording.begins_s[step] + motion.time_s[row]
            if row == 0 and step != min(recording.motions):
                time_s += 1e-4  # the moment before belongs to the action before
            for name in bodies:
                T, body = T_world(stage, f"/World/Arm/{name}", time_s), data.body(name)
                np.testing.assert_allclose(T[:3, 3], body.xpos, atol=1e-4)
                np.testing.assert_allclose(T[:3, :3], body.xmat.reshape(3, 3), atol=1e-3)
            tip = data.site(scene.tip_site)
            T = T_world(stage, "/World/Tip", time_s)
            np.testing.assert_allclose(T[:3, 3], tip.xpos, atol=1e-4)
            np.testing.assert_allclose(T[:3, :3], tip.xmat.reshape(3, 3), atol=1e-3)


def test_what_is_drawn_of_the_arm_is_near_its_bodies(stage, recording) -> None:
    """The meshes hang below the bodies that carry them, in metres."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode(0.0), ["default"])
    box = cache.ComputeWorldBound(stage.GetPrimAtPath("/World/Arm")).ComputeAlignedRange()
    base_m = recording.scene.T_world_base[:3, 3]
    assert np.linalg.norm(np.array(box.GetMidpoint()) - base_m) < 1.0
    assert 0.5 < max(np.array(box.GetSize())) < 1.8


def test_the_map_grows_with_the_actions(moving) -> None:
    stage, recording, record = moving
    assert surface(stage, "/World/Patient/Map", 0.0) is None
    cell_m3 = float(np.prod(record.field.cell_m))
    level, arrivals, n_bodies = called_from(record.config["map"]["prior_prevalence"]), ends_s(recording), 0
    for step, arrived_s in enumerate(arrivals, start=1):
        n_called = int((expit(record.history[step].astype(float)) > level).sum())
        body = surface(stage, "/World/Patient/Map", arrived_s + recording.sensing_s + 1e-6)
        assert (body is None) == (n_called == 0)
        if body is None:
            continue
        n_bodies += 1
        # A surface between points holds less than the cells of those within, the less the fewer they are.
        assert body.is_watertight
        assert 0.1 * n_called * cell_m3 < body.volume < 1.5 * n_called * cell_m3
        if step < len(arrivals):  # it is held until the next
            assert surface(stage, "/World/Patient/Map", arrivals[step]).volume == pytest.approx(body.volume)
    assert n_bodies > 0


def test_organ_and_tumours_are_those_of_the_run(stage, arm_run) -> None:
    anatomy = load_run(arm_run).anatomy
    organ = surface(stage, "/World/Patient/Organ/organ", 0.0)
    np.testing.assert_allclose(organ.bounds, anatomy.organ.to_trimesh().bounds, atol=1e-6)
    assert organ.volume == pytest.approx(anatomy.organ.to_trimesh().volume, rel=1e-4)
    tumours = stage.GetPrimAtPath("/World/Patient/Tumours").GetChildren()
    assert len(tumours) == len(anatomy.tumours)
    for prim in tumours:
        look, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader, _, _ = look.ComputeSurfaceSource()
        assert 0.0 < shader.GetInput("opacity").Get() < 1.0


def test_the_cone_shows_while_it_senses_and_marks_stay(stage, recording) -> None:
    def shown(path, time_s):
        code = Usd.TimeCode(time_s * stage.GetTimeCodesPerSecond())
        return UsdGeom.Imageable(stage.GetPrimAtPath(path)).ComputeVisibility(code) != "invisible"

    for action, arrived_s in enumerate(ends_s(recording), start=1):
        assert not shown("/World/Tip/Cone", arrived_s - 0.1)
        assert shown("/World/Tip/Cone", arrived_s + 0.5 * recording.sensing_s)
        mark = f"/World/Patient/Sensed/action_{action:04d}"
        assert not shown(mark, arrived_s)
        assert shown(mark, arrived_s + recording.sensing_s + 1e-6)
        place_m = np.array(UsdGeom.Points(stage.GetPrimAtPath(mark)).GetPointsAttr().Get())
        np.testing.assert_allclose(place_m, recording.sensed_m[action - 1 : action], atol=1e-3)


def test_measures_are_numbers_in_time(stage, arm_run, recording) -> None:
    record, world = load_run(arm_run), stage.GetDefaultPrim()
    for name in ("auprc", "sensed_fraction"):
        curve = world.GetAttribute(f"sounding:{name}")
        values = [curve.Get(code) for code in curve.GetTimeSamples()]
        np.testing.assert_allclose(values, record.numbers(name))
    done = world.GetAttribute("sounding:action")
    assert done.Get(stage.GetEndTimeCode()) == len(recording.motions)


def test_the_camera_has_the_organ_in_its_picture(stage, arm_run) -> None:
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera")).GetCamera(Usd.TimeCode(0.0))
    box = UsdGeom.BBoxCache(Usd.TimeCode(0.0), ["default"])
    organ = box.ComputeWorldBound(stage.GetPrimAtPath("/World/Patient/Organ"))
    assert camera.frustum.Intersects(organ)
    seen = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    for corner in load_run(arm_run).anatomy.organ.vertices_m[::50]:
        assert (np.abs(np.array(seen.Transform(tuple(corner.tolist())))[:2]) <= 1.0).all()


def test_a_patient_who_breathes_moves_with_all_that_is_in_it(moving) -> None:
    stage, recording, _ = moving
    for step, motion in recording.motions.items():
        time_s = recording.begins_s[step] + motion.time_s[-1]
        T = T_world(stage, "/World/Patient/Organ/organ", time_s)
        np.testing.assert_allclose(T, recording.places[step].T_world_rest[-1], atol=1e-5)
        # So the mark of the pose lies where the tip truly was.
        mark = UsdGeom.Points(stage.GetPrimAtPath(f"/World/Patient/Sensed/action_{step:04d}"))
        place_m = np.append(np.array(mark.GetPointsAttr().Get())[0], 1.0)
        np.testing.assert_allclose((T @ place_m)[:3], T_world(stage, "/World/Tip", time_s)[:3, 3], atol=1e-4)


def test_a_sweep_leaves_its_trace(sweep_run, tmp_path) -> None:
    stage, recording = stage_of(sweep_run, tmp_path / "run.usd"), read_recording(sweep_run)
    pieces_m = recording.trace().pieces_m
    lines = [UsdGeom.BasisCurves(prim) for prim in stage.GetPrimAtPath("/World/Patient/Trace").GetChildren()]
    drawn_m = np.concatenate([np.array(each.GetPointsAttr().Get()).reshape(-1, 2, 3) for each in lines])
    np.testing.assert_allclose(drawn_m, pieces_m, atol=1e-6)
    n_colours = [len(each.GetDisplayColorAttr().Get()) for each in lines]
    assert sum(n_colours) == len(pieces_m)
    marks = stage.GetPrimAtPath("/World/Patient/Sensed").GetChildren()
    n_marks = sum(len(UsdGeom.Points(each).GetPointsAttr().Get()) for each in marks)
    assert n_marks == len(recording.readings.steps)


def test_a_package_for_phones_holds_the_same(arm_run, tmp_path) -> None:
    stage = stage_of(arm_run, tmp_path / "run.usdz")
    assert stage.GetPrimAtPath("/World/Patient/Organ/organ")
    # Nothing is left beside it.
    assert [path.name for path in tmp_path.iterdir()] == ["run.usdz"]


@pytest.mark.parametrize("name", ["run.usdc", "run.usda", "run.usdz"])
def test_a_disk_that_is_full_is_told_and_leaves_nothing(arm_run, tmp_path, capsys, name) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, limits[1]))
    try:
        assert main(["view", str(arm_run), "--usd", str(tmp_path / name)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "disk is full" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_bad_options_and_a_missing_extra_are_told(arm_run, tmp_path, capsys, monkeypatch) -> None:
    assert main(["view", str(arm_run), "--usd", str(tmp_path / "run.glb")]) == 2
    assert "must end with .usdc" in capsys.readouterr().err
    both = ["--usd", str(tmp_path / "run.usdc"), "--mcap", str(tmp_path / "run.mcap")]
    assert main(["view", str(arm_run), *both]) == 2
    assert "a call of its own" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "pxr.Usd", None)
    assert main(["view", str(arm_run), *both[:2]]) == 2
    assert "[usd]'" in capsys.readouterr().err
