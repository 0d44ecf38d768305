"""The surfaces of a run as files for other programs: what was mapped, beside the truth, in the organ file's frame.

STL is in millimetres, as scanners and 3D Slicer have it; glTF in metres, as its specification demands.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mapping.storage import replacing
from sim.record.run_record import RunRecord
from sim.world.solids.solid import Solid

from .findings import Findings

FOLDER = "surfaces"
SCENE = "mapped.glb"
MM_PER_M = 1e3
COLOURS = {"organ": (0.72, 0.55, 0.50, 0.25), "tumour": (0.84, 0.37, 0.0, 0.6), "mapped": (0.0, 0.45, 0.70, 1.0),
           "target": (0.80, 0.47, 0.65, 0.6), "mapped_target": (0.90, 0.62, 0.0, 1.0),
           "false": (0.35, 0.35, 0.35, 1.0), "structure": (0.33, 0.38, 0.43, 1.0),
           "keepout": (0.94, 0.89, 0.26, 1.0)}  # fmt: skip
"""Red, green, blue and opacity of each kind of surface."""


def write_surfaces(record: RunRecord, findings: Findings) -> list[Path]:
    """Write surfaces/mapped_*.stl, one for each finding, and surfaces/mapped.glb, which holds the truth as well.

    Returns:
        The files, the glTF file last; none where nothing was mapped.
    """
    mapped = {f"mapped_tumour_{each.tumour}": each.surface for each in findings.tumours if each.surface}
    mapped |= {f"mapped_false_{each.finding}": each.surface for each in findings.false if each.surface}
    truth = {f"tumour_{i + 1}": solid for i, solid in enumerate(record.anatomy.tumours)}
    if findings.target is not None and record.target is not None:
        own = findings.target
        mapped |= {f"mapped_target_{each.tumour}": each.surface for each in own.tumours if each.surface}
        mapped |= {f"mapped_target_false_{each.finding}": each.surface for each in own.false if each.surface}
        truth |= {f"target_{i + 1}": solid for i, solid in enumerate(record.target.anatomy.tumours)}
    if not mapped:
        return []
    folder = record.folder / FOLDER
    folder.mkdir(exist_ok=True)
    T_organ_world = np.linalg.inv(record.T_world_organ)
    files = []
    for name, solid in mapped.items():
        mesh = solid.transformed(T_organ_world).to_trimesh()
        mesh.apply_scale(MM_PER_M)
        files.append(_write(folder / f"{name}.stl", mesh.export(file_type="stl")))
    others = {
        f"{'keepout' if structure.is_keepout else 'structure'}_{i + 1}": structure.solid
        for i, structure in enumerate(record.anatomy.structures)
    }
    scene = trimesh.Scene()
    for name, solid in ({"organ": record.anatomy.organ} | others | truth | mapped).items():
        scene.add_geometry(_coloured(solid.transformed(T_organ_world), name), node_name=name, geom_name=name)
    return [*files, _write(folder / SCENE, scene.export(file_type="glb"))]


def _coloured(solid: Solid, name: str) -> trimesh.Trimesh:
    kind = "mapped_target" if name.startswith("mapped_target") else name.split("_")[0]
    kind = "false" if "false" in name else kind
    colour = COLOURS[kind]
    mesh = solid.to_trimesh()
    material = PBRMaterial(
        name=kind, baseColorFactor=np.array(colour), alphaMode="OPAQUE" if colour[3] == 1 else "BLEND",
        roughnessFactor=0.9, metallicFactor=0.0, doubleSided=True,
    )  # fmt: skip
    mesh.visual = TextureVisuals(material=material)
    return mesh


def _write(path: Path, content: Any) -> Path:
    with replacing(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)
    return path
