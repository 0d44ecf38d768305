"""The arm's links as meshes, and where each was at every sensing action."""

from __future__ import annotations

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from ..replay import Recording, set_state
from ..world.scene import Group

MOST_FACES = 3000
"""A part of more triangles is drawn by its convex hull."""
SECTIONS = 32


def arm_parts(recording: Recording) -> list[tuple[str, NDArray[np.float64], trimesh.Trimesh]]:
    """The bodies of arm and probe that can be seen: name, colour of its largest part (3,), mesh in its own frame."""
    model = recording.scene.model
    parts = []
    for body in range(model.nbody):
        name = model.body(body).name
        if not name.startswith(("arm_", "probe_")):
            continue
        geoms = [g for g in np.flatnonzero(model.geom_bodyid == body) if model.geom_group[g] == Group.ARM]
        meshes = [mesh for g in geoms if (mesh := _geom_mesh(model, int(g))) is not None]
        for colour in sorted({tuple(np.round(model.geom_rgba[g][:3], 2)) for g in geoms}):
            same = [m for g, m in zip(geoms, meshes, strict=True)
                    if tuple(np.round(model.geom_rgba[g][:3], 2)) == colour]  # fmt: skip
            parts.append((name, np.array(colour), trimesh.util.concatenate(same)))
    return parts


def body_poses(recording: Recording, names: list[str]) -> NDArray[np.float32]:
    """Position and wxyz quaternion of bodies at the start and at the end of each motion.

    Args:
        recording: The run's states.
        names: The bodies.

    Returns:
        Shape (1 + number of motions, number of bodies, 7), world frame [m]; the first is where the run began.
    """
    scene = recording.scene
    data = scene.new_data()
    ids = [scene.model.body(name).id for name in names]
    motions = list(recording.motions.values())
    states = [motions[0].states[0], *(motion.states[-1] for motion in motions)]
    poses = np.empty((len(states), len(ids), 7), dtype=np.float32)
    for row, state in zip(poses, states, strict=True):
        set_state(scene, data, state)
        row[:, :3], row[:, 3:] = data.xpos[ids], data.xquat[ids]
    return poses


def _geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """A geom as a mesh in the frame of its body."""
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
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[geom])
    T[:3, :3], T[:3, 3] = R.reshape(3, 3), model.geom_pos[geom]
    mesh.apply_transform(T)
    return mesh


def _mesh_of(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    first_vertex, n_vertices = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    first_face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first_vertex : first_vertex + n_vertices]
    faces = model.mesh_face[first_face : first_face + n_faces]
    part = trimesh.Trimesh(vertices.astype(np.float64), faces, process=False)
    return part.convex_hull if len(faces) > MOST_FACES else part
