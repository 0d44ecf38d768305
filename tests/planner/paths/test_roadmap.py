"""The roadmap: its lengths against exact geodesics, its edges against the surface, and where readings fall on a way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from planner import PlannerError, Workspace
from planner.paths.roadmap import Roadmap, along_m, read_at

RADIUS_M = 0.08


def ball_poses(n: int = 3000) -> Workspace:
    """Poses spread evenly over a whole sphere, by Fibonacci's spiral."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * i
    outward = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return Workspace(RADIUS_M * outward, -outward)


def great_circle_m(workspace: Workspace, start: int) -> np.ndarray:
    """The exact geodesics of a sphere, R arctan2(|a x b|, a . b)."""
    a, b = workspace.normals[start], workspace.normals
    return RADIUS_M * np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), b @ a)


def test_ways_on_a_sphere_are_its_great_circles() -> None:
    workspace = ball_poses()
    roadmap = Roadmap.of_surface(workspace)
    rng = np.random.default_rng(5)
    for start in rng.integers(0, workspace.n_poses, 5):
        exact_m = great_circle_m(workspace, int(start))
        ratio = np.delete(roadmap.ways_from(int(start)).lengths_m / np.maximum(exact_m, 1e-12), start)
        # Edges are arcs, so no way is shorter; a graph's ways turn, by at most half the angle between its edges.
        assert ratio.min() >= 1.0 - 1e-9
        assert ratio.max() <= 1.08
        assert np.median(ratio) <= 1.03


def test_ways_on_a_square_grid_are_longer_than_straight_ones_by_no_more_than_knights_moves_allow() -> None:
    n = 41
    x, y = np.meshgrid(0.002 * np.arange(n), 0.002 * np.arange(n), indexing="ij")
    positions_m = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    roadmap = Roadmap.of_surface(Workspace(positions_m, np.tile([0.0, 0.0, -1.0], (n * n, 1))))
    exact_m = np.linalg.norm(positions_m - positions_m[0], axis=1)[1:]
    ratio = roadmap.ways_from(0).lengths_m[1:] / exact_m
    # Between two directions of edges that are t apart, the detour is at most 1 / cos(t / 2); t is arctan(1 / 2).
    assert ratio.min() >= 1.0 - 1e-12
    assert ratio.max() <= 1.0 / np.cos(np.arctan(0.5) / 2.0) + 1e-9


def test_a_way_is_a_chain_of_edges_whose_lengths_add_up() -> None:
    workspace = ball_poses(800)
    roadmap = Roadmap.of_surface(workspace)
    ways = roadmap.ways_from(3)
    path = ways.to(600)
    assert (path[0], path[-1]) == (3, 600)
    assert along_m(workspace, path)[-1] == pytest.approx(ways.lengths_m[600])
    edges = {tuple(pair) for pair in roadmap.pairs.tolist()}
    assert all(tuple(sorted(step)) in edges for step in pairwise(path))


def test_no_edge_leads_through_a_thin_sheet_from_one_side_to_the_other() -> None:
    n = 20
    x, y = np.meshgrid(0.003 * np.arange(n), 0.003 * np.arange(n), indexing="ij")
    top_m = np.column_stack([x.ravel(), y.ravel(), np.full(n * n, 0.001)])
    positions_m = np.vstack([top_m, top_m * [1.0, 1.0, -1.0]])
    normals = np.repeat([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], n * n, axis=0)
    roadmap = Roadmap.of_surface(Workspace(positions_m, normals))
    assert set(roadmap.islands[: n * n]) == {0}
    assert set(roadmap.islands[n * n :]) == {1}
    assert roadmap.ways_from(0).to(n * n) == ()


def test_readings_fall_at_their_distance_and_at_the_end() -> None:
    along = np.arange(0.0, 0.0505, 0.001)
    for every_m in (0.01, 0.0075, 0.2):
        rows = read_at(along, every_m)
        assert rows[-1] == len(along) - 1
        assert rows[0] > 0
        gaps_m = np.diff(np.concatenate([[0.0], along[rows]]))
        # The last gap may be shorter or longer by half, so that the way ends with a reading.
        assert (gaps_m[:-1] >= every_m - 1e-9).all()
        assert gaps_m.max() <= max(1.5 * every_m + 1e-3, 0.05)
    assert read_at(np.zeros(1), 0.01).size == 0


def test_edges_that_mean_nothing_are_refused() -> None:
    workspace = ball_poses(50)
    with pytest.raises(PlannerError, match="names a pose that is none of 0 .. 49"):
        Roadmap(workspace, np.array([[0, 50]]), np.array([0.01]))
    with pytest.raises(PlannerError, match="length must be above 0"):
        Roadmap(workspace, np.array([[0, 1]]), np.array([0.0]))
