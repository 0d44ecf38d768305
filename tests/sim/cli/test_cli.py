"""The command as a stranger runs it: whole processes, real files, one clear line for each mistake."""

from __future__ import annotations

import csv
import json
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from shared_runs import ARM_BASE_M, ARM_RUN, N_ARM_ACTIONS

from sim.cli.command_line import main
from sim.running.fields import field_names

COMMAND = [sys.executable, "-m", "sim.cli"]
ROOT = Path(__file__).resolve().parents[3]


def sounding(*arguments: object, **more) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=600, cwd=ROOT, **more
    )


def read_steps(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "steps.csv").open()))


def test_a_run_folder_holds_all_that_was_promised(arm_run) -> None:
    summary = json.loads((arm_run / "summary.json").read_text())
    for key in (
        "n_sensings",
        "sensings_to_95",
        "sensed_fraction",
        "auprc",
        "log_loss",
        "n_skipped_poses",
        "wall_s",
    ):
        assert key in summary
    assert (summary["n_sensings"], summary["status"]) == (N_ARM_ACTIONS, "finished")
    manifest = json.loads((arm_run / "manifest.json").read_text())
    assert (manifest["status"], manifest["seed"]) == ("finished", 1)
    assert manifest["blas_threads"] == [1]
    steps = read_steps(arm_run)
    assert [row["step"] for row in steps] == ["1", "2", "3", "4"]
    wanted = "pose_index position_error_m angle_error_rad n_points n_occupied sensed_fraction auprc"
    wanted += " plan_s ik_s sense_s update_s"
    assert set(wanted.split()) <= set(steps[0])
    assert all(float(row["position_error_m"]) < 1e-3 for row in steps)
    for name in ("precision_recall.png", "auprc.png", "map_top.png", "map_side.png"):
        assert min(Image.open(arm_run / name).size) > 300


def test_the_command_says_where_the_run_is_and_how_far_it_got(arm_run) -> None:
    assert str(arm_run) in arm_run.with_suffix(".stdout").read_text()
    assert "sensing" in arm_run.with_suffix(".stderr").read_text()  # the progress bar


def test_the_map_file_agrees_with_the_summary(arm_run) -> None:
    arrays = np.load(arm_run / "map.npz", allow_pickle=False)
    shape = tuple(arrays[axis].size for axis in ("x_m", "y_m", "z_m"))
    assert arrays["probability"].shape == arrays["latent_variance"].shape == shape == (22, 22, 13)
    inside = arrays["is_inside"]
    assert np.array_equal(np.isfinite(arrays["probability"]), inside)
    summary = json.loads((arm_run / "summary.json").read_text())
    assert summary["n_points"] == inside.sum()
    assert summary["n_points_per_tumour"] == [int(arrays["is_tumour"].sum())]


def test_there_is_a_frame_per_action_and_each_shows_another_state(arm_run) -> None:
    frames = sorted((arm_run / "frames").iterdir())
    assert [frame.name for frame in frames] == [f"{step:04d}.png" for step in range(1, N_ARM_ACTIONS + 1)]
    pictures = [np.asarray(Image.open(frame)) for frame in frames]
    assert all(picture.shape == (720, 960, 3) for picture in pictures)
    assert (pictures[0] != pictures[1]).any(axis=-1).mean() > 0.01


def test_joint_states_bring_the_tip_to_the_recorded_pose(arm_run) -> None:
    """A replay from states alone, in a model of its own."""
    import mujoco

    from sim.world.scene.arm import MODELS_DIR

    spec = mujoco.MjSpec.from_file(str(MODELS_DIR / "arm.xml"))
    for key in list(spec.keys):
        spec.delete(key)
    probe = mujoco.MjSpec.from_file(str(MODELS_DIR / "probe.xml"))
    spec.attach(probe, prefix="probe_", site=spec.site("flange"))
    model = spec.compile()
    data = mujoco.MjData(model)
    contacts = [row for row in csv.DictReader((arm_run / "states.csv").open()) if row["phase"] == "contact"]
    for state, step in zip(contacts, read_steps(arm_run), strict=True):
        data.qpos[:] = [float(state[f"joint{i}_rad"]) for i in range(1, 8)]
        mujoco.mj_kinematics(model, data)
        wanted_m = [float(step[f"position_{axis}_m"]) for axis in "xyz"]
        x_m, y_m, z_m = data.site("probe_tip").xpos
        tip_m = ARM_BASE_M + np.array([y_m, -x_m, z_m])  # the arm's file is turned by a quarter, to the right
        gap_m = np.linalg.norm(tip_m - wanted_m)
        assert gap_m == pytest.approx(float(step["position_error_m"]), abs=1e-9)


def test_the_same_seed_gives_the_same_bytes_but_for_the_seconds(arm_run, tmp_path) -> None:
    """The other run is of this process, which has run other tests before."""
    assert main([*ARM_RUN, "--no-report", "--out", str(tmp_path / "again")]) == 0
    timed = ("plan_s", "ik_s", "move_s", "sense_s", "update_s")

    def without_seconds(folder: Path) -> list[dict[str, str]]:
        return [{key: text for key, text in row.items() if key not in timed} for row in read_steps(folder)]

    assert without_seconds(arm_run) == without_seconds(tmp_path / "again")
    for name in (
        "states.csv",
        "anatomy.npz",
        *(f"motion/{step:05d}.npz" for step in range(1, N_ARM_ACTIONS + 1)),
    ):
        assert (arm_run / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_a_second_run_into_the_folder_is_refused(arm_run, capsys) -> None:
    before = (arm_run / "steps.csv").read_bytes()
    assert main(["episode", "--scenario", "sphere", "--steps", "1", "--out", str(arm_run)]) == 2
    assert "already holds a run" in capsys.readouterr().err
    assert (arm_run / "steps.csv").read_bytes() == before


def wait_for_rows(process: subprocess.Popen, folder: Path, n: int) -> None:
    deadline_s = time.monotonic() + 300
    while time.monotonic() < deadline_s and process.poll() is None:
        if (folder / "steps.csv").exists() and len(read_steps(folder)) >= n:
            return
        time.sleep(0.05)
    raise AssertionError(f"the run ended or stalled before {n} rows: {process.poll()}")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_an_end_at_any_moment_keeps_what_was_done(
    small_ball, no_figures, tmp_path, how: signal.Signals
) -> None:
    out = tmp_path / "run"
    arguments = ["episode", "--scenario", str(small_ball), "--arm", "none", "--out", str(out)]
    process = subprocess.Popen(
        [*COMMAND, *arguments, "--steps", "2000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    )
    wait_for_rows(process, out, 3)
    process.send_signal(how)
    process.communicate(timeout=300)
    rows = read_steps(out)
    assert [int(row["step"]) for row in rows] == list(range(1, len(rows) + 1))
    assert len(rows) >= 3
    status = json.loads((out / "manifest.json").read_text())["status"]
    assert np.isfinite(np.load(out / "map.npz")["probability"]).any()
    if how is signal.SIGKILL:
        assert status == "unfinished"
    else:
        assert process.returncode == 130
        assert status == "interrupted"
        assert json.loads((out / "summary.json").read_text())["n_sensings"] == len(rows)
    assert main([*arguments, "--steps", "1", "--no-report", "--overwrite"]) == 0
    assert len(read_steps(out)) == 1


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> Path:
    """A folder of good and bad meshes, millimetres."""
    folder = tmp_path_factory.mktemp("meshes")
    for name, scale in (("organ", 1000.0), ("in_metres_already", 100_000.0), ("small", 150.0)):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=0.07).apply_scale(scale)
        ball.export(folder / f"{name}.stl")
    half_open = trimesh.creation.icosphere(subdivisions=3, radius=70.0)
    half_open.update_faces(half_open.triangles_center[:, 2] < 0)
    half_open.export(folder / "open.stl")
    outside = trimesh.creation.icosphere(subdivisions=2, radius=8.0)
    outside.apply_translation([300.0, 0, 0])
    outside.export(folder / "outside.stl")
    (folder / "garbage.stl").write_bytes(bytes(range(256)) * 4)
    (folder / "empty.stl").write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--organ", "{m}/open.stl"], "open.stl"),
        (["--organ", "{m}/garbage.stl"], "garbage.stl"),
        (["--organ", "{m}/empty.stl"], "empty.stl"),
        (["--organ", "{m}/nowhere.stl"], "nowhere.stl"),
        (["--organ", "{m}/organ.stl", "--unit", "m"], "--unit mm"),
        (["--organ", "{m}/organ.stl", "--tumour", "{m}/outside.stl"], "outside.stl"),
        (["--tumour", "{m}/small.stl"], "--organ"),
        (["--scenario", "kidney"], "sphere, spheres, liver"),
        (["--planner", "oracle"], "expected-improvement"),
        (["--steps", "0"], "--steps 0"),
        (["--seed", "-1"], "--seed -1"),
        (["--until-sensed", "1.5"], "--until-sensed 1.5"),
        (["--cone-half-angle-deg", "95"], "--cone-half-angle-deg 95.0: must be from 1 to 80 degrees"),
        (["--prior-prevalence", "1.5"], "1.5"),
        (["--arm", "{m}/no_arm.xml"], "no_arm.xml: no such arm file"),
        (["--arm", "default", "--flange", "hand"], "no site or body named 'hand'.*flange"),
    ],
)
def test_bad_input_is_one_clear_line_and_nothing_is_written(
    meshes, coarse, tmp_path, capsys, arguments, message: str
) -> None:
    filled = [argument.format(m=meshes) for argument in arguments]
    base = ["episode", "--frames", "none", "--out", str(tmp_path / "out")]
    base += [] if "--scenario" in filled else ["--scenario", str(coarse)]
    base += [] if "--arm" in filled else ["--arm", "none"]
    assert main([*base, *filled]) == 2
    printed = capsys.readouterr().err
    assert re.search(message, printed), printed
    assert printed.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_error_is_not_a_traceback_in_a_real_process(tmp_path) -> None:
    run = sounding("episode", "--scenario", "kidney", "--out", tmp_path / "out")
    assert run.returncode == 2
    assert run.stderr.startswith("sounding: ")
    assert "Traceback" not in run.stderr


def test_an_organ_without_tumours_runs_and_has_no_auprc(meshes, coarse, tmp_path) -> None:
    out = tmp_path / "out"
    options = ["--scenario", str(coarse), "--planner", "random", "--steps", "2", "--arm", "none"]
    options += ["--out", str(out)]
    assert main(["episode", "--organ", str(meshes / "organ.stl"), *options]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["auprc"] is None
    assert summary["sensed_fraction"] is None
    assert summary["log_loss"] > 0


@pytest.mark.parametrize(
    "case", [pytest.param("default_hra_male_3tum", marks=pytest.mark.slow), "unc_p2_HCC_031"]
)
def test_a_real_patients_organ_runs_with_the_arm(livers_dir, tmp_path, case: str) -> None:
    folder = livers_dir / case
    tumours = sorted(folder.glob("tumour_*.stl"))
    if not (folder / "liver.stl").exists():
        pytest.skip(f"{case} is not among the real organs here")
    files = ["--organ", str(folder / "liver.stl"), "--tumour", *map(str, tumours)]
    options = ["--planner", "random", "--steps", "2", "--out", str(tmp_path / "o")]
    assert main(["episode", *files, *options]) == 0
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert len(summary["n_points_per_tumour"]) == len(tumours)
    assert summary["attainable_fraction"] > 0


def test_help_explains_every_option(monkeypatch, capsys) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")
    with pytest.raises(SystemExit) as ended:
        main(["episode", "--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    for name in field_names():
        assert re.search(rf"--{name.replace('_', '-')}[ ,]", said), name


def test_help_fills_its_lines_and_names_other_options_by_their_flags(monkeypatch, capsys) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    with pytest.raises(SystemExit):
        main(["episode", "--help"])
    # Of a box, the lines of an option's text are indented; its frame takes two characters on either side.
    lines = [line[2:-2] for line in capsys.readouterr().out.splitlines() if len(line) == 80]
    texts = [line.rstrip() if line.startswith(" " * 6) else "" for line in lines]
    assert sum(bool(text) for text in texts) > 100
    for text, following in pairwise(texts):
        if text and following:
            # Docstrings break their lines elsewhere: here a line ends only where the next word has no room.
            assert len(text) + 1 + len(following.split()[0]) > 76, text
    printed = " ".join(text.strip() for text in texts)
    assert "whose share --until-sensed means" in printed
    assert not any(f"`{name}`" in printed for name in field_names())
