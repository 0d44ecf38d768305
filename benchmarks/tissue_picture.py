"""The picture of docs/tissue.md: a section of the embedded liver with tumours, at rest and under the probe's face.

    .venv/bin/python -m benchmarks.tissue_picture [--out docs/figures/tissue.png]

The lines are 10 mm apart in the tissue at rest, and move with it. Every place of the pressed section is asked where it
lay at rest, which is how a sensor finds out what it sees.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np

from sim.colours import INK, ORGAN, PROBE, TRUTH
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.episode.truth import make_truth
from sim.world.frames import frames_along
from sim.world.tissue.elastic_organ import build_elastic_organ

SEED = 1003
DEPTH_M, FACE_M = 0.010, 0.004
STEP_M, HALF_WIDTH_M, ABOVE_M, BELOW_M = 0.0004, 0.05, 0.025, 0.06


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/figures/tissue.png"))
    out = parser.parse_args().out
    setup = build_setup(load_scenario("liver"))
    tumours = make_truth(setup, np.random.default_rng(SEED)).anatomy.tumours
    position_m, normal, shallowest = over_a_tumour(setup.workspace, tumours)
    organ = build_elastic_organ(setup.organ, tumours=tumours)
    pressed = organ.press(position_m, normal, depth_m=DEPTH_M, face_radius_m=FACE_M)
    frame = frames_along(normal[None])[0]
    sections = [(section, setup.organ, tumours) for section in (None, pressed)]
    draw(sections, frame, position_m, pressed, out)
    moved_mm = 1e3 * np.linalg.norm(pressed.displacement_m(shallowest.vertices_m), axis=1)
    print(
        f"written to {out}: {pressed.force_n:.2f} N hold the face at {1e3 * pressed.depth_m:.0f} mm; the tumour below "
        f"it moves by {moved_mm.min():.1f} to {moved_mm.max():.1f} mm"
    )


def over_a_tumour(workspace, tumours):
    """The pose with a tumour nearest below it, its normal, and the tumour."""
    found = []
    for tumour in tumours:
        offset_m = tumour.vertices_m.mean(axis=0) - workspace.positions_m
        depth_m = np.einsum("ij,ij->i", offset_m, workspace.normals)
        beside_m = np.linalg.norm(offset_m - depth_m[:, None] * workspace.normals, axis=1)
        cost = np.where(depth_m > 0.0, depth_m + 2.0 * np.abs(beside_m - 0.006), np.inf)
        found.append((cost.min(), int(cost.argmin()), tumour))
    _, pose, tumour = min(found, key=lambda each: each[0])
    return workspace.positions_m[pose], workspace.normals[pose], tumour


def draw(sections, frame, position_m, pressed, path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8, 3.9), layout="constrained", sharey=True)
    across = np.arange(-HALF_WIDTH_M, HALF_WIDTH_M, STEP_M)
    height = np.arange(-BELOW_M, ABOVE_M, STEP_M)
    x_m, up_m = np.meshgrid(across, height)
    places = position_m + np.stack([x_m.ravel(), 0.0 * x_m.ravel(), -up_m.ravel()], axis=1) @ frame.T
    for axis, (state, organ, tumours) in zip(axes, sections, strict=True):
        rest = places if state is None else state.rest_of(places)
        is_organ = organ.contains(rest).reshape(x_m.shape)
        is_tumour = (
            np.any([tumour.contains(rest) for tumour in tumours], axis=0).reshape(x_m.shape) & is_organ
        )
        local = (rest - position_m) @ frame
        mm = 1e3 * across, 1e3 * height
        axis.contourf(*mm, is_organ, levels=[0.5, 1.5], colors=[ORGAN], alpha=0.45)
        axis.contourf(*mm, is_tumour, levels=[0.5, 1.5], colors=[TRUTH])
        for component in (0, 2):
            lines = np.ma.masked_where(~is_organ, local[:, component].reshape(x_m.shape))
            axis.contour(
                *mm,
                1e3 * lines,
                levels=np.arange(-95, 96, 10),
                colors=[INK],
                linewidths=0.4,
                linestyles="solid",
            )
        tip_mm = 0.0 if state is None else -1e3 * pressed.depth_m
        face_mm = 1e3 * FACE_M
        axis.fill([-face_mm, face_mm, face_mm, -face_mm], [tip_mm, tip_mm, 40, 40], color=PROBE)
        title = (
            "at rest"
            if state is None
            else f"pressed in by {1e3 * pressed.depth_m:.0f} mm, {pressed.force_n:.2f} N"
        )
        axis.set(xlabel="across [mm]", title=title, aspect="equal", ylim=(-1e3 * BELOW_M, 1e3 * ABOVE_M))
    axes[0].set_ylabel("above the face at rest [mm]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
