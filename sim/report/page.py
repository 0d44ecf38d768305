"""The page of a run: `report.html`, a file that needs no other."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import jinja2

from mapping.storage import replacing
from sim.episode.scenario import PAPER_ORGAN
from sim.findings.findings import Findings
from sim.findings.results import write_results
from sim.record.run_record import RunRecord, load_run

from .chapters import chapters
from .frames import frame_images
from .packing import Pack
from .view_data import view_data

REPORT = "report.html"
ASSETS = Path(__file__).resolve().parent / "assets"
SCRIPTS = ("three.min.js", "surface_nets.js", "view.js", "slices.js", "page.js")
MOST_BYTES = 15_000_000
"""A report is never larger: pictures are made smaller until it fits."""


def write_report(folder: Path, findings: Findings | None = None) -> Path:
    """Write the report of a run, finished or not, from what its folder holds, and return the file.

    Args:
        folder: The run's folder.
        findings: What the run's last map found; by default that is worked out here, and its files are written.

    Raises:
        UsageError: The folder is not that of an episode, or one of its files is broken.
    """
    record = load_run(folder)
    text = page(record, findings or write_results(record))
    path = folder / REPORT
    with replacing(path) as file:
        file.write(text.encode(errors="surrogateescape"))
    return path


def page(record: RunRecord, findings: Findings) -> str:
    """The text of the page."""
    pack = Pack()
    view = view_data(record, pack)
    packed = pack.text()
    room = MOST_BYTES - _script_bytes() - len(packed) - 500_000
    bmodes = frame_images(record.folder / "ultrasound", most_bytes=room // 2)
    frames = frame_images(record.folder / "frames", most_bytes=room - sum(map(len, bmodes.values())))
    data = {"view": view, "n_steps": record.n_steps, "frames": sorted(frames)}
    if bmodes:
        data["bmodes"] = sorted(bmodes)
    shown = chapters(record, findings)
    return environment().get_template("run.html.j2").render(
        **shown, n_actions=record.n_steps, has_slices=view["map"] is not None, slices_frame=_slices_frame(record),
        data=json_text(data),
        readings_json=json_text(shown["readings"]), packed=packed, frames=frames, bmodes=bmodes, scripts=scripts(),
    )  # fmt: skip


def _slices_frame(record: RunRecord) -> str:
    """What the axes of the slices are called."""
    if record.scenario["organ"] == PAPER_ORGAN:
        return "the frame of the organ"
    return "the patient’s frame (x to the left, y to the back, z to the head, in millimetres)"


@lru_cache(maxsize=2)
def environment(*more_templates: Path) -> jinja2.Environment:
    """The templates of the assets and of other folders; values that they show are escaped."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([ASSETS, *more_templates]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


@lru_cache(maxsize=1)
def scripts() -> tuple[str, ...]:
    """The scripts of a run's page."""
    return tuple((ASSETS / name).read_text(encoding="utf-8") for name in SCRIPTS)


def _script_bytes() -> int:
    return sum(len(script.encode()) for script in scripts())


def json_text(data: Any) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
