"""Probes as files: a bent one, and a box of a mesh, for tests of probes that users bring."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

BENT = """<mujoco model="bent"><default><geom type="capsule" density="900"/></default><worldbody>{world}
<body name="handle" pos="0 0 0.004">
 <geom name="clamp" type="cylinder" size="0.03 0.008" pos="0 0 0.006"/>
 <geom name="grip" fromto="0 0 0.03 0 0 0.086" size="0.016"/>
 <body name="head" pos="0 0 0.086" euler="0 45 0">
  <geom name="neck" fromto="0 0 0 0 0 0.06" size="0.012"/>
  <geom name="nose" type="sphere" size="0.0125" pos="0 0 0.0675"/>{more}
  <site name="tip" pos="0 0 0.08"/></body></body></worldbody></mujoco>"""
"""A probe whose tip looks 45 degrees aside, towards the flange's +x."""
PLAIN = '<geom name="shaft" type="capsule" size="0.02" fromto="0 0 0 0 0 0.1"/>'
"""A straight shaft, whose end lies at 120 mm."""


def bent(folder: Path, *, more: str = "", world: str = "") -> Path:
    """The bent probe as a file; `more` goes into its head and `world` beside its handle."""
    path = folder / "bent.xml"
    path.write_text(BENT.format(more=more, world=world))
    return path


def probe_file(folder: Path, body: str, extra: str = "", name: str = "probe.xml") -> Path:
    """A probe with something in its world and something beside it."""
    path = folder / name
    path.write_text(f"<mujoco>{extra}<worldbody>{body}</worldbody></mujoco>")
    return path


def bent_mesh(folder: Path) -> Path:
    """A probe of two meshes in millimetres, in a folder beside it: a box along z, and one that leads aside from it."""
    (folder / "meshes").mkdir(exist_ok=True)
    upright = trimesh.creation.box((30.0, 20.0, 100.0))
    upright.apply_translation((0.0, 0.0, 50.0))
    aside = trimesh.creation.box((24.0, 16.0, 60.0))
    aside.apply_translation((0.0, 0.0, 30.0))
    aside.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4.0, (0.0, 1.0, 0.0)))
    aside.apply_translation((0.0, 0.0, 90.0))
    upright.export(folder / "meshes" / "upright.stl")
    aside.export(folder / "meshes" / "aside.stl")
    files = "".join(
        f'<mesh name="{name}" file="meshes/{name}.stl" scale="0.001 0.001 0.001"/>'
        for name in ("upright", "aside")
    )
    end_m = 0.06 * np.sqrt(0.5)
    return probe_file(
        folder,
        '<geom name="body" type="mesh" mesh="upright"/><geom name="face" type="mesh" mesh="aside"/>'
        f'<site name="tip" pos="{end_m} 0 {0.09 + end_m}" euler="0 45 0"/>',
        f"<asset>{files}</asset>",
        "mesh_probe.xml",
    )
