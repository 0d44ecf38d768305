"""The rigid probe: what a probe's file holds as one body in the flange's frame, and as an MJCF text that needs no file.

That text is what a scene is made of, and what a run keeps, so that its replay does not ask for the user's files again.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BODY, TIP, FACE = "probe", "tip", "face"
"""Names in the text: of the one body, of the tip's site, and of the site or geom that may touch the organ."""
TIP_GROUP = 5
"""Sites of this group are not drawn."""
KINDS = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}
"""The shapes that a probe may have, as MJCF calls them."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A geom, or a site that has a size, in the flange's frame."""

    kind: int
    """One of `KINDS`."""
    size_m: Array
    """As MuJoCo has it, shape (3,)."""
    at_m: Array
    """Shape (3,)."""
    quaternion: Array
    """wxyz, shape (4,)."""


@dataclass(frozen=True, eq=False)
class ProbeGeom:
    """A geom of a probe."""

    name: str
    shape: Shape
    rgba: Array
    """Shape (4,)."""
    group: int
    collides: bool
    """Whether it takes part in contacts; it is only drawn where not."""
    vertices_m: Array | None = None
    """Of a mesh, in the geom's frame, shape (V, 3)."""
    faces: NDArray[np.int64] | None = None
    """Of a mesh, shape (F, 3)."""


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass and moments of the whole probe."""

    mass_kg: float
    at_m: Array
    """The centre of mass in the flange's frame, shape (3,)."""
    quaternion: Array
    """The principal axes, wxyz, shape (4,)."""
    moments_kg_m2: Array
    """Shape (3,)."""


@dataclass(frozen=True, eq=False)
class RigidProbe:
    """A probe in the flange's frame, whose +z points away from the arm."""

    geoms: tuple[ProbeGeom, ...]
    tip: Shape
    face: Shape | None
    """The region whose part of the probe may touch the organ; None where a geom has that name, or nothing has."""
    inertia: Inertia | None
    """None for a probe without mass."""
    notices: tuple[str, ...] = ()
    """What is unusual about the file, a sentence each."""

    def mjcf(self) -> str:
        """The probe as an MJCF text, its meshes within it."""
        root = ET.Element("mujoco", model=BODY)
        ET.SubElement(root, "compiler", angle="radian", autolimits="true")
        asset, world = ET.SubElement(root, "asset"), ET.SubElement(root, "worldbody")
        body = ET.SubElement(world, "body", name=BODY, gravcomp="1")
        if self.inertia is not None:
            ET.SubElement(body, "inertial", _inertial(self.inertia))
        for index, geom in enumerate(self.geoms):
            values = {"name": geom.name, **_placed(geom.shape), "rgba": _text(geom.rgba)}
            flag = "1" if geom.collides else "0"
            values |= {"group": str(geom.group), "contype": flag, "conaffinity": flag, "mass": "0"}
            if geom.vertices_m is not None and geom.faces is not None:
                del values["size"]
                values["mesh"] = f"mesh{index}"
                # A surface that is not closed has no volume, and its inertia is not asked for.
                mesh = {"name": values["mesh"], "inertia": "shell", "vertex": _text(geom.vertices_m)}
                ET.SubElement(asset, "mesh", {**mesh, "face": " ".join(map(str, geom.faces.ravel()))})
            ET.SubElement(body, "geom", values)
        ET.SubElement(body, "site", {"name": TIP, "group": str(TIP_GROUP), **_placed(self.tip)})
        if self.face is not None:
            ET.SubElement(body, "site", {"name": FACE, "group": str(TIP_GROUP), **_placed(self.face)})
        ET.indent(root)
        return ET.tostring(root, encoding="unicode") + "\n"


def _placed(shape: Shape) -> dict[str, str]:
    return {
        "type": KINDS[shape.kind],
        "size": _text(shape.size_m),
        "pos": _text(shape.at_m),
        "quat": _text(shape.quaternion),
    }


def _inertial(inertia: Inertia) -> dict[str, str]:
    return {
        "mass": repr(inertia.mass_kg),
        "pos": _text(inertia.at_m),
        "quat": _text(inertia.quaternion),
        "diaginertia": _text(inertia.moments_kg_m2),
    }


def _text(values: Array) -> str:
    """Numbers as text that is read as the same numbers."""
    return " ".join(map(repr, np.asarray(values, dtype=np.float64).ravel().tolist()))
