"""Every patient's liver at hand: it is loaded, laid before the arm, and sensed 30 times.

    .venv/bin/python -m benchmarks.patients --write

It prints a table and, with --write, puts it into docs/organs.md. Patients are the folders of $SOUNDING_DATA/livers that
hold a label volume or a mesh; those without tumours are given generated ones.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from mapping.storage import replacing
from sim.episode.setup import build_setup
from sim.running.fields import config_of, recorded
from sim.running.output import output_of
from sim.running.parts import make_parts
from sim.running.run_episode import record_episode

PAGE = Path(__file__).resolve().parents[1] / "docs" / "organs.md"
BEGIN, END = "<!-- table of patients: begin -->", "<!-- table of patients: end -->"
N_GENERATED = 3
N_REACH = 300
"""Poses of the workspace by which the reached share is judged: to 3 % of it."""


@dataclass(frozen=True, kw_only=True)
class PatientsOptions:
    """Run an episode on every liver at hand."""

    steps: int = 30
    planner: str = "find-and-outline"
    seed: int = 0
    only: str = ""
    """Run only patients whose name holds this."""
    write: bool = False
    """Put the table into docs/organs.md."""


def cases(only: str = "") -> list[tuple[str, dict[str, Any]]]:
    """The name and the files of each patient: the label volume where there is one, the meshes where there is none."""
    folder = Path(os.environ.get("SOUNDING_DATA", "../shared/data")) / "livers"
    found = []
    for case in sorted(path for path in folder.glob("*") if only in path.name):
        volume, mesh = case / "segmentation.nii.gz", case / "liver.stl"
        if volume.is_file():
            found.append((f"{case.name} (labels)", {"organ": volume}))
        if mesh.is_file() and not volume.is_file():
            files: dict[str, Any] = {"organ": mesh, "tumour": tuple(sorted(case.glob("tumour_*.stl")))}
            structures = (case / f"{name}.stl" for name in ("artery", "hepatic_veins", "portal_vein"))
            files["structure"] = tuple(path for path in structures if path.is_file())
            files["keepout"] = tuple(case.glob("gallbladder.stl"))
            found.append((f"{case.name} (meshes)", files))
    return found


def run_case(files: dict[str, Any], options: PatientsOptions, out: Path) -> dict[str, Any]:
    """The row of one patient."""
    config = config_of(
        **files,
        n_tumours=N_GENERATED,
        steps=options.steps,
        planner=options.planner,
        seed=options.seed,
        out=out,
    )
    start_s = perf_counter()
    parts = make_parts(config)
    setup = build_setup(parts.scenario, parts.arm, parts.map_settings)
    summary = record_episode(
        parts, output_of(config, parts, recorded(config)), setup=setup, show_progress=False
    )
    seconds = perf_counter() - start_s
    with np.load(out / "anatomy.npz") as arrays:
        n_tumours = sum(name.startswith("tumour") and name.endswith("_faces") for name in arrays.files)
    poses = np.random.default_rng(0).permutation(setup.workspace.n_poses)[:N_REACH]
    setup.positioner.prepare(poses.tolist())
    return {
        "volume_ml": setup.organ.volume_m3 * 1e6,
        "tumours": f"{n_tumours}{'' if setup.given_tumours else ' generated'}",
        "reached": np.mean([setup.positioner.reach(int(pose)).is_reached for pose in poses]),
        "auprc": summary["auprc"],
        "sensed": summary["sensed_fraction"],
        "attainable": summary["attainable_fraction"],
        "seconds": seconds,
    }


def table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """The rows in Markdown."""
    lines = [
        "| case | organ [ml] | tumours | poses reached | AUPRC | sensed | could be sensed | seconds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {row['volume_ml']:.0f} | {row['tumours']} | {row['reached']:.0%} | {row['auprc']:.2f} "
        f"| {row['sensed']:.0%} | {row['attainable']:.0%} | {row['seconds']:.0f} |"
        for name, row in rows
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the cases and print the table."""
    options = tyro.cli(PatientsOptions, description=__doc__)
    out = Path(tempfile.mkdtemp())
    try:
        rows = [
            (name, run_case(files, options, out / name.split()[0]))
            for name, files in tqdm(cases(options.only), unit="case")
        ]
    finally:
        shutil.rmtree(out)
    print(text := table(rows))
    if options.write:
        page = PAGE.read_text(encoding="utf-8")
        before, rest = page.split(BEGIN)
        with replacing(PAGE) as file:
            file.write(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}".encode())


if __name__ == "__main__":
    main()
