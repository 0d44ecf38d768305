"""How an organ lies: as the pose says, or as the cones see most of it."""

import numpy as np
import pytest
import trimesh

from planner import Cone, visible_points
from sim.episode.best_turn import best_turn_rad
from sim.episode.setup import make_workspace, placed_organ
from sim.errors import UsageError
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.world.anatomy.placement import pose_matrix, turned
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
