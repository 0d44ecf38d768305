"""The arm's links as meshes, and where each was at every sensing action."""

from __future__ import annotations

from collections.abc import Container

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.record.recording import Recording, set_state
from sim.world.frames import quaternion_matrix
from sim.world.scene.scene import Group

from .mesh_thinning import thinned

MOST_FACES = 3000
"""A part of more triangles is thinned out."""
SECTIONS = 32
"""Sides of a cylinder."""


Part = tuple[str, NDArray[np.float64], trimesh.Trimesh]
"""A body's name, the colour of a part of it, shape (3,), and that part as a mesh in the body's frame."""


def arm_parts(recording: Recording) -> list[Part]:
    """The visible parts of arm and probe, one for each body and colour."""
    return _parts(recording.scene.model, ("arm_", "probe_"), {Group.ARM})


def table_parts(recording: Recording) -> list[Part]:
    """The parts of the operating table, one for each colour; its body does not move."""
    return _parts(recording.scene.model, ("table",), {Group.SCENERY})


def _parts(model: mujoco.MjModel, begins: tuple[str, ...], groups: Container[int]) -> list[Part]:
    """The parts, in some groups of geoms, of the bodies whose names begin so."""
    parts = []
    for body in range(model.nbody):
        name = model.body(body).name
        if not name.startswith(begins):
            continue
        geoms = [g for g in np.flatnonzero(model.geom_bodyid == body) if model.geom_group[g] in groups]
        meshes = [_geom_mesh(model, int(g)) for g in geoms]
        colours = [_colour(model, int(g)) for g in geoms]
        for colour in sorted(set(colours)):
            same = [
                mesh for own, mesh in zip(colours, meshes, strict=True) if own == colour and mesh is not None
            ]
            if same:
                parts.append((name, np.array(colour), trimesh.util.concatenate(same)))
    return parts


def body_poses(recording: Recording, names: list[str]) -> NDArray[np.float32]:
    """The position and the wxyz quaternion of bodies where the run began and at the end of each motion.

    Args:
        recording: The run's states.
        names: The bodies.

    Returns:
        Shape (1 + number of motions, number of bodies, 7) [m], in the world where the organ lies as planned; the first
        is where the run began.
    """
    scene = recording.scene
    data = scene.new_data()
    ids = [scene.model.body(name).id for name in names]
    steps = list(recording.motions)
    moments = [(steps[0], 0), *((step, -1) for step in steps)]
    poses = np.empty((len(moments), len(ids), 7), dtype=np.float32)
    for row, (step, index) in zip(poses, moments, strict=True):
        set_state(scene, data, recording.motions[step].states[index])
        row[:] = _from_the_organ(recording, step, index, data.xpos[ids], data.xquat[ids])
    return poses


def body_ways(recording: Recording, names: list[str], n: int) -> NDArray[np.float64]:
    """The position and the wxyz quaternion of bodies at `n` moments, evenly spaced, of each motion.

    Args:
        recording: The run's states.
        names: The bodies.
        n: Number of moments, the first and the last of a motion among them.

    Returns:
        Shape (number of motions, n, number of bodies, 7) [m], in the world where the organ lies as planned.
    """
    scene = recording.scene
    data = scene.new_data()
    ids = [scene.model.body(name).id for name in names]
    ways = np.empty((len(recording.motions), n, len(ids), 7))
    for way, (step, motion) in zip(ways, recording.motions.items(), strict=True):
        moments_s = np.linspace(motion.time_s[0], motion.time_s[-1], n)
        for row, at in zip(way, np.searchsorted(motion.time_s, moments_s - 1e-9), strict=True):
            index = min(int(at), len(motion.states) - 1)
            set_state(scene, data, motion.states[index])
            row[:] = _from_the_organ(recording, step, index, data.xpos[ids], data.xquat[ids])
    return ways


def _from_the_organ(
    recording: Recording,
    step: int,
    index: int,
    positions_m: NDArray[np.float64],
    quaternions: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Bodies as seen from the organ where it was at a state of a motion: positions [m], quaternions, shape (B, 7)."""
    place = recording.places.get(step)
    if place is not None:
        T = place.T_world_rest[index]
        positions_m = (positions_m - T[:3, 3]) @ T[:3, :3]
        turned = Rotation.from_matrix(T[:3, :3].T) * Rotation.from_quat(quaternions, scalar_first=True)
        quaternions = turned.as_quat(scalar_first=True)
    return np.hstack([positions_m, quaternions])


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, float, float]:
    """The red, green and blue of a geom, or of its material where it has one."""
    material = int(model.geom_matid[geom])
    red, green, blue, _ = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return round(float(red), 2), round(float(green), 2), round(float(blue), 2)


def _geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """A geom as a mesh in the frame of its body; None for a kind that is not drawn."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=[SECTIONS, 12])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    elif kind == kinds.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=SECTIONS)
    elif kind == kinds.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * size)
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        mesh = trimesh.creation.icosphere(subdivisions=2)
        mesh.apply_scale(size if kind == kinds.mjGEOM_ELLIPSOID else size[0])
    elif kind == kinds.mjGEOM_MESH:
        mesh = _mesh_of(model, int(model.geom_dataid[geom]))
    else:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = quaternion_matrix(model.geom_quat[geom]), model.geom_pos[geom]
    mesh.apply_transform(T)
    return mesh


def _mesh_of(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    first_vertex, n_vertices = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    first_face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first_vertex : first_vertex + n_vertices]
    faces = model.mesh_face[first_face : first_face + n_faces]
    return trimesh.Trimesh(
        *thinned(vertices.astype(np.float64), faces.astype(np.int64), MOST_FACES), process=False
    )
