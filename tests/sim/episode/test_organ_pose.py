"""How an organ lies: as the pose says, or as the cones see most of it."""

import dataclasses

import numpy as np
import pytest
import trimesh

from planner import Cone, visible_points
from sim.episode import best_turn
from sim.episode.best_turn import best_turn_rad
from sim.episode.setup import make_workspace, placed_organ
from sim.errors import UsageError
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.world.anatomy.placement import pose_matrix, turned
from sim.world.anatomy.structures import Structure
from sim.world.solids.solid import Solid


def test_the_organ_lies_as_the_pose_says():
    turned_by = scenario_of(config_of(organ_pose=("90", "0", "0")))
    placed, _ = placed_organ(turned_by)
    # A quarter turn about the world's x brings the front (up) to -y, and the head (world y) up.
    assert placed.T_world_organ[:3, :3] @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert placed.organ.bounds_m[0, 2] == pytest.approx(0.0, abs=1e-12)
    at = scenario_of(config_of(organ_pose=("500", "10", "80", "1", "0", "0", "0")))
    assert placed_organ(at)[0].T_world_organ == pytest.approx(pose_matrix([0.5, 0.01, 0.08], [1, 0, 0, 0]))
    for words in (("up",), ("1", "2"), ("0", "0", "0", "0", "0", "0", "0"), ("nan", "0", "0")):
        with pytest.raises(UsageError, match="three angles"):
            scenario_of(config_of(organ_pose=words))


def seen_share(scenario):
    """The share of the organ that the cones of all poses see."""
    placed, _ = placed_organ(scenario, None)
    points_m = placed.organ.sample_inside(3000, np.random.default_rng(1))
    cone = Cone(scenario.cone_half_angle_rad, scenario.cone_depth_m)
    return visible_points(make_workspace(scenario, placed), cone, points_m).mean()


def test_the_best_pose_of_a_plate_on_edge_lets_the_cones_see_more(tmp_path):
    # Anterior up it stands on edge, 160 mm high, and the cones reach 130 mm; tilted they see it from its face too.
    box = trimesh.creation.box((40.0, 160.0, 120.0)).subdivide_to_size(20.0)
    box.export(tmp_path / "plate.stl")
    plain, best = (
        seen_share(scenario_of(config_of(organ=tmp_path / "plate.stl", organ_pose=words)))
        for words in ((), ("best",))
    )
    assert best > plain + 0.05


def test_where_no_turn_lets_the_cones_see_more_the_organ_stays_as_it_is(tmp_path):
    ball = Solid.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=0.05))
    assert best_turn_rad(ball, None, Cone(np.deg2rad(15.0), 0.13)) == (0.0, 0.0, 0.0)


def test_a_turn_by_nothing_is_anterior_up():
    assert turned((0.0, 0.0, 0.0)) @ [0.0, -1.0, 0.0] == pytest.approx([0.0, 0.0, 1.0])


@pytest.fixture
def few_turns(monkeypatch):
    """The six sides of a box, and few poses on each: trying more proves no more and takes long."""
    monkeypatch.setattr(best_turn, "TILT_STEPS_DEG", (-90.0, 0.0, 90.0, 180.0))
    monkeypatch.setattr(best_turn, "N_POSES", 150)
    monkeypatch.setattr(best_turn, "N_POINTS", 500)


def box(size_m, centre_m=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(size_m).subdivide_to_size(0.015)
    mesh.apply_translation(centre_m)
    return Solid.from_trimesh(mesh)


def test_the_best_pose_turns_away_from_what_must_not_be_pressed(few_turns):
    # A flat plate lies best on its back, since cones of 50 mm see little of it from its edges. LPS y looks to the back.
    plate, cone = box((0.12, 0.04, 0.10)), Cone(np.deg2rad(20.0), 0.05)
    assert best_turn_rad(plate, None, cone) == (0.0, 0.0, 0.0)
    lid = Structure(name="lid", solid=box((0.13, 0.004, 0.11), (0.0, -0.024, 0.0)), is_keepout=True)
    turn = best_turn_rad(plate, None, cone, structures=(lid,), keepout_m=0.005)
    # Its back is up now, which is as large and free.
    assert turned(turn) @ [0.0, 1.0, 0.0] == pytest.approx([0.0, 0.0, 1.0])
    # What may be pressed, and a zone that ends before the plate, turn nothing.
    vein = dataclasses.replace(lid, is_keepout=False)
    assert best_turn_rad(plate, None, cone, structures=(vein,), keepout_m=0.005) == (0.0, 0.0, 0.0)
    assert best_turn_rad(plate, None, cone, structures=(lid,), keepout_m=0.001) == (0.0, 0.0, 0.0)


def test_the_zones_of_a_scenario_reach_the_choice_of_the_best_pose(few_turns, tmp_path):
    for name, solid in (
        ("plate", box((0.12, 0.04, 0.10))),
        ("lid", box((0.13, 0.004, 0.11), (0, -0.024, 0))),
    ):
        solid.to_trimesh().export(tmp_path / f"{name}.stl")
    best = {"organ": tmp_path / "plate.stl", "unit": "m", "organ_pose": ("best",), "cone_depth_mm": 50.0}
    free = placed_organ(scenario_of(config_of(**best)))[0]
    lidded = placed_organ(scenario_of(config_of(**best, keepout=(tmp_path / "lid.stl",))))[0]
    front = [0.0, -1.0, 0.0]
    assert free.T_world_organ[:3, :3] @ front == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert (lidded.T_world_organ[:3, :3] @ front)[2] < 0.5
