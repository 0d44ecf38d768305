"""Runs with a probe of one's own: they are kept, replayed without its file, and told apart in studies."""

from __future__ import annotations

import json

import numpy as np
import pytest
from geom_surface import geom_triangles, least_signed_distances_m
from probe_files import bent, bent_mesh

import sounding
from sim.campaign.campaign_folder import CampaignFolder
from sim.campaign.study import make_study
from sim.campaign.study_file import load_study
from sim.cli.command_line import main
from sim.errors import UsageError
from sim.record.recording import read_recording, set_state
from sim.report.arm_parts import arm_parts
from sim.viewing.joint_path import joint_path
from sim.world.solids.surface_distance import SurfaceDistance


@pytest.fixture(scope="module")
def run(tmp_path_factory, coarse):
    """The folder of a run whose probe's file and meshes are gone."""
    folder = tmp_path_factory.mktemp("own-probe")
    probe = bent_mesh(folder)
    out = folder / "run"
    summary = sounding.run_episode(
        scenario=str(coarse),
        probe=str(probe),
        steps=2,
        seed=1,
        out=out,
        planner="random",
        show_progress=False,
    )
    assert summary["probe"] == str(probe)
    probe.unlink()
    for mesh in (folder / "meshes").iterdir():
        mesh.unlink()
    return out


def test_a_run_is_replayed_without_the_file_of_its_probe(run) -> None:
    recording = read_recording(run)
    model = recording.scene.model
    assert {model.geom(g).name for g in recording.scene.arm_geoms} >= {"probe_body", "probe_face"}
    data = recording.scene.new_data()
    for step, motion in recording.motions.items():
        set_state(recording.scene, data, motion.states[-1])
        tip = data.site(recording.scene.tip_site)
        # The tip that was recorded, with the probe as the folder keeps it; meshes play no part in it.
        np.testing.assert_allclose(tip.xpos, motion.tips_m[-1], atol=1e-9)
        assert np.linalg.norm(tip.xpos - recording.sensed_m[step - 1]) < 1e-3
    assert any(name == "probe_probe" for name, _, _ in arm_parts(recording))
    assert main(["replay", str(run)]) == 0


def test_nothing_but_the_face_of_the_probe_comes_into_the_organ_on_the_whole_way(run) -> None:
    """Against the true triangles of probe and organ, by a way of the test's own."""
    recording = read_recording(run)
    scene, data = recording.scene, recording.scene.new_data()
    exact = SurfaceDistance(scene.anatomy.organ)
    states = np.vstack([motion.states[::5] for motion in recording.motions.values()])
    geom = scene.model.geom("probe_body").id
    world_m = np.empty((len(states), *geom_triangles(scene.model, geom).shape))
    for row, state in enumerate(states):
        set_state(scene, data, state)
        R = data.geom_xmat[geom].reshape(3, 3)
        world_m[row] = data.geom_xpos[geom] + geom_triangles(scene.model, geom) @ R.T
    least_m = least_signed_distances_m(world_m, exact, ignored_at_m=np.zeros((len(states), 3)), ignored_m=0.0)
    assert least_m.min() > -5e-4  # the distance grid's error at a rim


def test_the_report_of_a_run_names_its_probe(run) -> None:
    assert main(["report", str(run)]) == 0
    assert "the probe of mesh_probe.xml" in (run / "report.html").read_text()


def test_the_kept_probe_serves_where_the_file_is_gone(run, tmp_path, capsys) -> None:
    again = ["episode", "--config", str(run / "config.json"), "--out", str(tmp_path / "again"), "--no-report"]
    assert main(again) == 2
    assert "no such probe file" in capsys.readouterr().err
    assert main([*again, "--probe", str(run / "probe.xml")]) == 0
    for name in ("poses.csv", "map.npz"):
        assert (tmp_path / "again" / name).is_file()
    ours, theirs = (joint_path(read_recording(folder)) for folder in (run, tmp_path / "again"))
    # The meshes went through a text once more, which moves them by some nanometres.
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-6)


def test_an_unknown_file_writes_nothing(tmp_path, capsys) -> None:
    assert main(["episode", "--probe", "gone.xml", "--out", str(tmp_path / "run")]) == 2
    assert "gone.xml: no such probe file. Give --probe" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_study_has_the_probe_as_a_key_and_an_axis(tmp_path) -> None:
    bent(tmp_path)
    (tmp_path / "study.toml").write_text(
        '[episode]\nscenario = "sphere"\narm = "none"\n[axes]\nprobe = ["default", "bent.xml"]\n'
    )
    first, second = load_study(str(tmp_path / "study.toml")).trials()
    assert (first.config.probe, second.config.probe) == ("default", str(tmp_path / "bent.xml"))
    assert "probe" not in first.settings  # so that the keys of older campaigns stay
    assert second.settings["probe"] == str(tmp_path / "bent.xml")
    with pytest.raises(UsageError, match="probe"):
        make_study(probe=3)


def test_a_campaign_knows_what_is_in_the_files_of_its_probes(tmp_path) -> None:
    probe, out = bent(tmp_path), tmp_path / "out"
    study = make_study(scenario="sphere", arm="none", probe=["default", str(probe)], seed=0)
    assert len({trial.key for trial in study.trials()}) == 2
    with CampaignFolder(out) as folder:
        folder.begin(study)
    probe.write_text(probe.read_text().replace("0.016", "0.017"))
    with (
        CampaignFolder(out) as folder,
        pytest.raises(UsageError, match=r"begun with another file .*bent\.xml"),
    ):
        folder.begin(study)


def test_ik_and_reach_take_a_probe(tmp_path, small_ball, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    probe = str(bent(tmp_path))
    more = ["--scenario", str(small_ball), "--probe", probe]
    assert main(["ik", "--position-mm", "500", "0", "80", *more]) == 0
    straight = capsys.readouterr().out
    assert main(["ik", "--position-mm", "500", "0", "80", *more[:2]]) == 0
    assert straight != capsys.readouterr().out
    small = tmp_path / "few.toml"
    small.write_text(
        small_ball.read_text().replace("3000", "60").replace('"ball.stl"', f'"{small_ball.parent}/ball.stl"')
    )
    assert main(["reach", "--scenario", str(small), "--probe", probe, "--jobs", "1"]) == 0
    assert f"probe {probe}" in capsys.readouterr().out
    summary = json.loads((tmp_path / "renders" / "reach-few-bent" / "summary.json").read_text())
    assert summary["probe"] == probe
    assert summary["reached_fraction"] > 0.9
