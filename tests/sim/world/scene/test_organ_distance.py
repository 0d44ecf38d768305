"""The distance between a geom and the organ: against FCL, another engine, which holds triangle against triangle."""

import mujoco
import numpy as np
import pytest
import trimesh

from sim.world.frames import quaternion_matrix
from sim.world.scene.geom_shapes import (
    MAX_SHORTFALL_M,
    GeomSurface,
    SphereCover,
    axis_spheres,
    geom_triangles,
)
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid
from sim.world.solids.surface_tree import TOLERANCE_M, TOLERANCE_SHARE

GEOMS = {
    "box": '<geom type="box" size="0.03 0.05 0.15"/>',
    "plate": '<geom type="box" size="0.002 0.1 0.2"/>',
    "cylinder": '<geom type="cylinder" size="0.05 0.16"/>',
    "ellipsoid": '<geom type="ellipsoid" size="0.04 0.07 0.14"/>',
    "mesh": '<geom type="mesh" mesh="bracket"/>',
}
_PARTS = (
    trimesh.creation.box((0.02, 0.06, 0.30)),
    trimesh.creation.box((0.20, 0.06, 0.02), trimesh.transformations.translation_matrix((0.1, 0, 0.15))),
    trimesh.creation.box((0.20, 0.06, 0.02), trimesh.transformations.translation_matrix((0.1, 0, -0.15))),
)
BRACKET = trimesh.Trimesh(
    np.concatenate([part.triangles for part in _PARTS]).reshape(-1, 3), np.arange(108).reshape(-1, 3)
)
"""Two arms on a back: its convex hull holds all the room between them."""
GRID_ERROR_M = 0.0015
"""What `DistanceGrid` may err by between its nodes at sharp margins."""
N_PLACES = 150


@pytest.fixture(scope="module")
def organ() -> Solid:
    """A lumpy body of 14 cm with creases."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.06)
    x, y, z = (ball.vertices / 0.06).T
    lumps = 1.0 + 0.25 * np.abs(np.sin(3.0 * x + y)) * np.cos(2.0 * y) + 0.2 * np.abs(z)
    return Solid(ball.vertices * lumps[:, None] * [1.1, 0.9, 0.8], ball.faces)


@pytest.fixture(scope="module")
def grid(organ: Solid) -> DistanceGrid:
    return DistanceGrid.from_solid(organ)


def surface(geom: str) -> GeomSurface:
    return GeomSurface(_model(geom), 0)


def _model(geom: str) -> mujoco.MjModel:
    vertices, faces = (" ".join(map(str, array.ravel())) for array in (BRACKET.vertices, BRACKET.faces))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="bracket" vertex="{vertices}" face="{faces}" inertia="shell"/></asset>'
        f"<worldbody>{geom}</worldbody></mujoco>"
    )


def places(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Places about an organ at the origin, near it for the most part."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return directions * rng.uniform(0.08, 0.25, (n, 1)), np.stack([quaternion_matrix(each) for each in quats])


def from_mesh_geom(model: mujoco.MjModel, at_m: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the bracket as it was drawn stands, whose frame MuJoCo moves to its centre and axes of inertia."""
    R_geom_file = quaternion_matrix(model.mesh_quat[0]).T
    return at_m - R @ R_geom_file @ model.mesh_pos[0], R @ R_geom_file


@pytest.mark.parametrize("kind", GEOMS)
def test_distances_are_those_of_another_engine(kind: str, organ: Solid, grid: DistanceGrid) -> None:
    fcl = pytest.importorskip("fcl", reason="python-fcl is not installed; it comes with sounding[dev]")
    model = _model(GEOMS[kind])
    drawn = {
        "box": trimesh.creation.box((0.06, 0.10, 0.30)),
        "plate": trimesh.creation.box((0.004, 0.2, 0.4)),
        "cylinder": trimesh.creation.cylinder(0.05, 0.32, sections=96),
        "ellipsoid": trimesh.creation.icosphere(subdivisions=4, radius=1.0).apply_scale((0.04, 0.07, 0.14)),
        "mesh": BRACKET,
    }[kind]
    at_m, R = places(N_PLACES)
    measured_m = GeomSurface(model, 0).distances_m(grid, at_m, R)
    drawn_at_m, drawn_R = from_mesh_geom(model, at_m, R) if kind == "mesh" else (at_m, R)
    geom, body = _bvh(fcl, drawn.vertices, drawn.faces), _bvh(fcl, organ.vertices_m, organ.faces)
    organ_object = fcl.CollisionObject(body)
    n_touching = 0
    for row in range(N_PLACES):
        placed = fcl.CollisionObject(geom, fcl.Transform(drawn_R[row], drawn_at_m[row]))
        if fcl.collide(placed, organ_object):
            n_touching += 1
            assert measured_m[row] < GRID_ERROR_M
        else:
            distance_m = fcl.distance(placed, organ_object)
            assert measured_m[row] < distance_m + GRID_ERROR_M
            # What stands off from a round body, and what flat faces of FCL's cut off it, come on top.
            slack_m = GRID_ERROR_M + TOLERANCE_M + TOLERANCE_SHARE * distance_m + 5e-4
            # Beyond the grid, whose margin is 40 mm, a lower bound is all that there is.
            assert distance_m > 0.04 or measured_m[row] > distance_m - slack_m
    assert 0.1 * N_PLACES < n_touching < 0.9 * N_PLACES


def _bvh(fcl, vertices: np.ndarray, faces: np.ndarray):
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    model.endModel()
    return model


def test_no_part_of_a_large_flat_face_is_missed(grid: DistanceGrid) -> None:
    """A link of a box, or a mesh of few large triangles, once had no sample near the organ that it stood in."""
    place = np.array([[0.0, 0.0, 0.0]])
    distances_m = surface(GEOMS["plate"]).distances_m(grid, place, np.eye(3)[None])
    assert distances_m[0] < -0.03


def test_room_between_the_arms_of_a_mesh_is_room(organ: Solid, grid: DistanceGrid) -> None:
    """MuJoCo collides the hull of a mesh, in which this organ would lie as a whole."""
    small = Solid(organ.vertices_m * 0.4, organ.faces)
    small_grid = DistanceGrid.from_solid(small, spacing_m=0.002)
    model = _model(GEOMS["mesh"])
    at_m, R = _standing_drawn(model, np.array([-0.1, 0.0, 0.0]))
    assert GeomSurface(model, 0).distances_m(small_grid, at_m, R)[0] > 0.03


def _standing_drawn(model: mujoco.MjModel, at_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    R = quaternion_matrix(model.mesh_quat[0])
    return (at_m + model.mesh_pos[0])[None], R[None]


def test_an_organ_that_lies_within_a_geom_is_entered(organ: Solid) -> None:
    small = Solid(organ.vertices_m * 0.2, organ.faces)
    small_grid = DistanceGrid.from_solid(small, spacing_m=0.002)
    big = surface('<geom type="box" size="0.1 0.1 0.1"/>')
    at_m = np.array([[0.0, 0.02, 0.0], [0.0, 0.13, 0.0]])
    distances_m = big.distances_m(small_grid, at_m, np.stack([np.eye(3)] * 2))
    assert distances_m[0] < 0.0 < distances_m[1]


@pytest.mark.parametrize("kind", ["box", "cylinder", "ellipsoid", "capsule", "sphere"])
def test_triangles_enclose_the_body_closely(kind: str) -> None:
    text = f'<geom type="{kind}" size="0.05 0.08 0.03"/>'
    model = _model(text)
    triangles_m = geom_triangles(model, 0)
    hull = trimesh.convex.convex_hull(triangles_m.reshape(-1, 3))
    a, b, c = model.geom_size[0]
    volume_m3 = {
        "box": 8 * a * b * c,
        "cylinder": 2 * np.pi * a**2 * b,
        "ellipsoid": 4 / 3 * np.pi * a * b * c,
        "capsule": 2 * np.pi * a**2 * b + 4 / 3 * np.pi * a**3,
        "sphere": 4 / 3 * np.pi * a**3,
    }[kind]
    # 0.4 mm, the most that it stands off, on some 4 cm is 3 % in volume.
    assert volume_m3 * (1.0 - 1e-9) <= hull.volume < 1.03 * volume_m3


def test_spheres_along_a_thick_capsule_miss_little_of_it() -> None:
    model = _model('<geom type="capsule" size="0.15 0.3"/>')
    cover = SphereCover(*axis_spheres(model, 0))
    between_m = np.array([[0.15, 0.0, float(cover.centres_m[:2, 2].mean())]])
    missed_m = np.linalg.norm(between_m - cover.centres_m, axis=1).min() - 0.15
    assert missed_m < MAX_SHORTFALL_M
