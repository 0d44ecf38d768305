"""Reading a probe's file as MuJoCo reads it, into one rigid body.

The file's own frame is that of the flange: its origin is the mount, and its +z points away from the arm. Bodies and
geoms stand as they do there, and all are rigid.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from sim.world.arms.mujoco_messages import MUJOCO_ERRORS, caught_warnings, whole_message
from sim.world.arms.reading import MISSING, check_is_file
from sim.world.frames import quaternion_matrix

from .checks import check_extent, check_rigid, check_tip
from .errors import ProbeError
from .rigid_probe import FACE, KINDS, TIP, Array, Inertia, ProbeGeom, RigidProbe, Shape

SUFFIXES = (".xml", ".urdf")
"""How the names of a probe's files end."""
MESHES = (".stl", ".obj", ".ply", ".glb", ".gltf", ".msh", ".dae")
"""How the names of files end that hold a shape and no probe."""
DRAWN, HIDDEN = 2, 3
"""Geom groups of a scene in which arm and probe are drawn, and in which they only collide."""
LEAST_KG = 1e-9
"""A probe that weighs less than this has no mass."""
MOMENT_SLACK = 1e-9
"""Moments are raised by this share of the largest, so that rounding does not make a thin body impossible."""


def load_probe(path: Path) -> RigidProbe:
    """The probe of a file.

    Args:
        path: An MJCF file with a site `tip`, or a URDF file with a link of that name.

    Raises:
        ProbeError: The file is missing or broken, or holds no probe that can be used.
    """
    _check_is_probe_file(path)
    with caught_warnings() as said:
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            # Links that no joint moves keep their names, so that the tip can be one.
            spec.compiler.fusestatic = False
            model = spec.compile()
        except MUJOCO_ERRORS as error:
            raise _refused(path, error) from error
        check_rigid(model, path)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        tip = _tip(model, data, path)
        remarks = check_extent(model, data, tip, path) + check_tip(model, data, tip, path)
    notices = [f"{path.name}: {text}" for text in (*(f"MuJoCo says: {text}." for text in said), *remarks)]
    return RigidProbe(
        geoms=_geoms(model, data),
        tip=tip,
        face=_face(model, data, path),
        inertia=_inertia(model, data),
        notices=tuple(dict.fromkeys(notices)),
    )


def _refused(path: Path, error: Exception) -> ProbeError:
    said = whole_message(error)
    remedy = (
        " Put it there, or name its folder as meshdir in the file's <compiler>." if MISSING in said else ""
    )
    return ProbeError(f"{path}: MuJoCo cannot compile this probe: {said}.{remedy}")


def _check_is_probe_file(path: Path) -> None:
    check_is_file(path, part="probe", formats="MJCF", error=ProbeError)
    if path.suffix.lower() in MESHES:
        raise ProbeError(
            f"{path}: this is a mesh, which has no tip. Give `probe` an MJCF file that has the mesh as a geom, and a "
            "site named tip."
        )
    if path.suffix not in SUFFIXES:
        raise ProbeError(
            f"{path}: MuJoCo tells files by their names, and reads probes from {' and '.join(SUFFIXES)}."
        )


def _tip(model: mujoco.MjModel, data: mujoco.MjData, path: Path) -> Shape:
    """The frame of the tip: that of the site, or else of the body, named so."""
    small = np.array([0.002, 0.002, 0.002])
    sphere = int(mujoco.mjtGeom.mjGEOM_SPHERE)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, TIP)
    if site >= 0:
        return Shape(sphere, small, data.site_xpos[site].copy(), _quaternion(data.site_xmat[site]))
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, TIP)
    if body >= 0:
        return Shape(sphere, small, data.xpos[body].copy(), data.xquat[body].copy())
    sites = ", ".join(name for i in range(model.nsite) if (name := model.site(i).name)) or "none"
    raise ProbeError(
        f'{path}: no site named tip (sites: {sites}). Add <site name="tip"/> where the probe touches, its +z along '
        "the beam, out of the probe."
    )


def _face(model: mujoco.MjModel, data: mujoco.MjData, path: Path) -> Shape | None:
    """The region of the site `face`; None where there is no such site."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, FACE)
    if site < 0:
        return None
    if KINDS.get(int(model.site_type[site]), "mesh") == "mesh":
        raise ProbeError(f"{path}: the site face must be a sphere, capsule, ellipsoid, cylinder or box.")
    place = data.site_xpos[site].copy(), _quaternion(data.site_xmat[site])
    return Shape(int(model.site_type[site]), model.site_size[site].copy(), *place)


def _geoms(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[ProbeGeom, ...]:
    """All geoms in the file's frame, each with a name."""
    taken = {model.geom(i).name for i in range(model.ngeom)}
    is_drawn = np.array([int(group) != HIDDEN for group in model.geom_group])
    geoms = []
    for geom in range(model.ngeom):
        name = model.geom(geom).name or f"geom{geom}"
        while not model.geom(geom).name and name in taken:
            name += "_"
        material = int(model.geom_matid[geom])
        vertices_m, faces = _mesh(model, geom)
        geoms.append(
            ProbeGeom(
                name=name,
                shape=Shape(
                    int(model.geom_type[geom]),
                    model.geom_size[geom].copy(),
                    data.geom_xpos[geom].copy(),
                    _quaternion(data.geom_xmat[geom]),
                ),
                rgba=(model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).astype(float),
                # Where all geoms are hidden, these are what there is to see.
                group=HIDDEN if is_drawn.any() and not is_drawn[geom] else DRAWN,
                collides=bool(model.geom_contype[geom] or model.geom_conaffinity[geom]),
                vertices_m=vertices_m,
                faces=faces,
            )
        )
    return tuple(geoms)


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[Array | None, np.ndarray | None]:
    """Vertices [m] and faces of a mesh geom in its frame; None for another."""
    mesh = int(model.geom_dataid[geom])
    if KINDS[int(model.geom_type[geom])] != "mesh" or mesh < 0:
        return None, None
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices_m = model.mesh_vert[first : first + count].astype(np.float64)
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return vertices_m, model.mesh_face[first : first + count].astype(np.int64)


def _inertia(model: mujoco.MjModel, data: mujoco.MjData) -> Inertia | None:
    """Mass and moments of all bodies together (Steiner's theorem); None where they weigh nothing."""
    mass_kg = float(model.body_mass.sum())
    if mass_kg < LEAST_KG:
        return None
    mujoco.mj_comPos(model, data)
    centre_m = model.body_mass @ data.xipos / mass_kg
    about = np.zeros((3, 3))
    for body in range(1, model.nbody):
        R, away_m = data.ximat[body].reshape(3, 3), data.xipos[body] - centre_m
        about += R @ np.diag(model.body_inertia[body]) @ R.T
        about += model.body_mass[body] * (away_m @ away_m * np.eye(3) - np.outer(away_m, away_m))
    moments, axes = np.linalg.eigh(about)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    moments = np.maximum(moments, 0.0) + MOMENT_SLACK * max(float(moments.max()), LEAST_KG)
    return Inertia(mass_kg, centre_m, _quaternion(axes), moments)


def _quaternion(matrix: Array) -> Array:
    """The wxyz quaternion of a rotation, shape (4,)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix, dtype=np.float64).ravel())
    assert np.allclose(quaternion_matrix(quaternion), np.asarray(matrix).reshape(3, 3), atol=1e-6)
    return quaternion
