"""Options about a patient's files: the same in all commands, and what organs they refuse."""

import dataclasses

import pytest
import trimesh

from sim.cli.command_line import main
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.world.errors import AnatomyError


def ball_file(tmp_path, radius_mm=50.0):
    path = tmp_path / "kidney.stl"
    trimesh.creation.icosphere(subdivisions=4, radius=radius_mm).export(path)
    return path


def test_one_pose_is_explained_over_a_patients_organ_with_its_notices(tmp_path, capsys):
    organ = ball_file(tmp_path)
    far = tmp_path / "vein.stl"
    trimesh.creation.icosphere(radius=5.0).apply_translation([300.0, 0.0, 0.0]).export(far)
    # The ball lies on the table, 0.5 m before the arm: its top is 100 mm up.
    pose = ["--position-mm", "500", "0", "100", "--organ", str(organ), "--structure", str(far)]
    assert main(["ik", *pose]) == 0
    said = capsys.readouterr()
    assert "on the organ's surface" in said.out
    assert "vein: lies 245 mm from the organ" in said.err
    assert "--mesh-frame" in said.err
    # Turned on its side by nothing but a pose of its own, it is elsewhere.
    assert main(["ik", *pose, "--organ-pose", "500", "0", "90", "1", "0", "0", "0"]) == 1
    assert "inside the organ" in capsys.readouterr().out


def test_every_command_about_a_patients_organ_takes_the_same_options_about_its_files():
    from sim.cli import ik, inspection, reach
    from sim.running.case import AnatomyConfig, CaseConfig
    from sim.running.config import EpisodeConfig

    for options in (EpisodeConfig, ik.Options, reach.Options, inspection.Options):
        assert "case" in {field.name for field in dataclasses.fields(options)}
    for options in (EpisodeConfig, ik.Options, reach.Options):
        kinds = {field.name: field.type for field in dataclasses.fields(options)}
        assert str(kinds["case"]).endswith(CaseConfig.__name__)
        assert str(kinds["anatomy"]).endswith(AnatomyConfig.__name__)


def test_an_organ_with_next_to_no_points_to_score_is_refused(tmp_path):
    organ = ball_file(tmp_path, radius_mm=16.0)
    (tmp_path / "coarse.toml").write_text(f'organ = "{organ}"\nscore_spacing_m = 0.02\n')
    with pytest.raises(AnatomyError, match=r"only \d points of the lattice of 20 mm.*`score_spacing_m`"):
        build_setup(load_scenario(str(tmp_path / "coarse.toml")))


def test_an_organ_thinner_than_the_lattice_is_refused(tmp_path):
    trimesh.creation.box((160.0, 2.0, 120.0)).subdivide_to_size(10.0).export(tmp_path / "leaf.stl")
    with pytest.raises(AnatomyError, match="thinner than the lattice of 3 mm"):
        build_setup(scenario_of(config_of(organ=tmp_path / "leaf.stl")))
