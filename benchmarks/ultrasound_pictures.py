"""Three B-mode pictures for docs/sensing.md: a lesion among vessels, a cyst and a calcification, a rib.

    .venv/bin/python -m benchmarks.ultrasound_pictures [--out docs/figures/ultrasound.png]
    .venv/bin/python -m benchmarks.ultrasound_pictures --read --out docs/figures/image_reader.png

The embedded liver has no vessels, so that a tree of tubes is put into it, for the pictures only. With --read, what the
reader of images takes for lesion is outlined; it looks at the planes on both sides too, as it does in a sweep.
"""

from __future__ import annotations

import dataclasses
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np
import trimesh

from sim.episode.positioner import FreePositioner
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.episode.truth import make_truth
from sim.pictures.bmode import bmode_panel
from sim.pictures.captions import CAPTION_PX
from sim.pictures.png import png_bytes
from sim.world.anatomy.anatomy import Anatomy
from sim.world.anatomy.structures import Structure
from sim.world.frames import frames_along
from sim.world.scene.scene import build_scene
from sim.world.sensing.image_reader.reading_sensor import ReadingSensor
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.ultrasound.ultrasound_sensor import TissueChoice, UltrasoundSensor
from sim.world.solids.solid import Solid

SEED = 1003
HEIGHT_PX = 420
TRUNK_M, TWIG_M = 0.0042, 0.0010
"""Radius of the trunk and of the last twigs [m]."""


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/figures/ultrasound.png"))
    parser.add_argument("--read", action="store_true")
    options = parser.parse_args()
    out, is_read = options.out, options.read
    pixels = np.hstack([panel(*each, is_read=is_read) for each in scenes()])
    out.write_bytes(png_bytes(pixels if is_read else pixels[..., 0], compression=9))
    print(f"written to {out}")


def scenes():
    """The anatomies with the pose and the tissue of the tumours of each picture."""
    setup = build_setup(load_scenario("liver"))
    truth = make_truth(setup, np.random.default_rng(SEED))
    pose = pose_over(setup, truth.scene)
    frame = frames_along(setup.workspace.normals[pose][None])[0]

    def at(x_m: float, z_m: float):
        return setup.workspace.positions_m[pose] + frame @ [x_m, 0.0, z_m]

    vessels = tuple(tree(at(0.03, 0.10), frame, np.random.default_rng(4)))
    cyst, stone = ball("cyst", at(-0.02, 0.045), 0.009), ball("calcification", at(0.025, 0.05), 0.003)
    rib = ball("rib", at(-0.004, 0.015), 0.005)
    for structures, tissue in (
        (vessels, "hypoechoic"),
        ((*vessels, cyst, stone), "hyperechoic"),
        ((*vessels, rib), "isoechoic"),
    ):
        yield setup, dataclasses.replace(truth.anatomy, structures=structures), pose, tissue


def panel(setup, anatomy: Anatomy, pose: int, tissue: str, *, is_read: bool = False):
    """The picture of one plane."""
    scene = build_scene(dataclasses.replace(anatomy, structures=()), setup.cone, arm=None)
    data = scene.new_data()
    FreePositioner(scene, setup.workspace).place(data, pose, is_lifted=False)
    sensor = UltrasoundSensor(n_planes=1, tissues=TissueChoice(tumour=tissue))
    if is_read:
        gap_rad = 2.0 * setup.cone.half_angle_rad / (UltrasoundSensor.n_planes - 1)
        sensor = ReadingSensor(ultrasound=dataclasses.replace(sensor, n_planes=3, half_sweep_rad=gap_rad))
    state = SceneState(dataclasses.replace(scene, anatomy=anatomy), data)
    sweep = sensor.sense(state, np.random.default_rng(0)).images
    return bmode_panel(sweep, HEIGHT_PX)[CAPTION_PX:-40]


def pose_over(setup, scene) -> int:
    """Of the poses whose beams pass near the middle of a tumour, the one that sees most."""
    workspace, found = setup.workspace, {}
    sensor, data = UltrasoundSensor(n_planes=1, n_points=400), scene.new_data()
    positioner = FreePositioner(scene, workspace)
    for tumour in scene.anatomy.tumours:
        offset_m = tumour.vertices_m.mean(axis=0) - workspace.positions_m
        depth_m = np.einsum("ij,ij->i", offset_m, workspace.normals)
        beside_m = np.linalg.norm(offset_m - depth_m[:, None] * workspace.normals, axis=1)
        for pose in np.argsort(np.where((depth_m > 0.03) & (depth_m < 0.09), beside_m, np.inf))[:25]:
            positioner.place(data, int(pose), is_lifted=False)
            reading = sensor.sense(SceneState(scene, data), np.random.default_rng(0))
            found[int(pose)] = len(reading.points_m) + 4 * int(reading.is_occupied.sum())
    return max(found, key=lambda pose: found[pose])


def ball(name: str, centre_m, radius_m: float) -> Structure:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius_m)
    mesh.apply_translation(centre_m)
    return Structure(name=name, solid=Solid.from_trimesh(mesh))


def tree(root_m, frame, rng: np.random.Generator, *, n_generations: int = 7):
    """A tree of vessels near a plane: each branches into two, thinner by Murray's law, until it is a twig."""
    branches = [(root_m, frame @ unit(np.array([x, 0.0, -1.0])), TRUNK_M) for x in (-1.2, 0.1)]
    for _ in range(n_generations):
        ahead = []
        for start_m, direction, radius_m in branches:
            if radius_m < TWIG_M:
                continue
            for _ in range(4):
                direction = unit(direction + frame @ (rng.normal(size=3) * [0.16, 0.05, 0.16]))
                end_m = start_m + direction * 1.4 * radius_m
                yield tube(start_m, end_m, radius_m)
                start_m = end_m
            for side in (-1.0, 1.0):
                across = frame @ unit(rng.normal(size=3) * [1.0, 0.3, 1.0])
                ahead.append((start_m, unit(direction + side * 0.7 * across), radius_m * 0.5 ** (1.0 / 3.0)))
        branches = ahead


def tube(start_m, end_m, radius_m: float) -> Structure:
    length_m = float(np.linalg.norm(end_m - start_m))
    mesh = trimesh.creation.capsule(height=length_m, radius=radius_m, count=(16, 16))
    mesh.apply_translation(
        [0.0, 0.0, -0.5 * length_m] if mesh.bounds[0, 2] >= -1.01 * radius_m else [0, 0, 0]
    )
    mesh.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], (end_m - start_m) / length_m))
    mesh.apply_translation(0.5 * (start_m + end_m))
    return Structure(name="vessel", solid=Solid.from_trimesh(mesh))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


if __name__ == "__main__":
    main()
