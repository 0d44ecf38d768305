"""Runs side by side: one page with the views of two to four episodes, which one slider moves, and their curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mapping.storage import replacing
from sim.bound.limit import LIMIT, limit_of_run, other_case
from sim.campaign.campaign_folder import STUDY
from sim.errors import FieldError, UsageError
from sim.findings.account import Account, account
from sim.findings.findings import Findings
from sim.findings.results import findings_of
from sim.findings.tables import finding_summary
from sim.record.ownership import MANIFEST
from sim.record.run_record import RunRecord, load_run
from sim.report.chapters import STATUS, classes, command, key_figures, lede, readings
from sim.report.packing import Pack
from sim.report.page import REPORT, environment, json_text, scripts
from sim.report.progress import progress
from sim.report.view_data import view_data
from sim.tables import write_csv
from sim.world.solids.solid import Solid

from .side_by_side import link
from .trial_groups import shortest_names

COLOURS = ("c6", "c3", "c4", "c5")
"""Classes of the runs' colours: those that stand for truth, map and probe in the views are left out."""
CURVE_HEIGHT = 150.0
TEMPLATES = Path(__file__).resolve().parent / "assets"


@dataclass(frozen=True, eq=False, kw_only=True)
class _Run:
    """A run as the page shows it."""

    name: str
    colour: str
    record: RunRecord
    findings: Findings

    @property
    def told(self) -> Account:
        record = self.record
        return account(record.summary, record.options, finding_summary(self.findings))


def are_runs(folders: Sequence[Path]) -> bool:
    """Whether folders are those of episodes, and not of campaigns.

    Raises:
        UsageError: Some are of the one kind and some of the other, or there are too few or too many runs.
    """
    runs = [folder for folder in folders if (folder / MANIFEST).is_file() and not (folder / STUDY).is_file()]
    others = [folder for folder in folders if folder not in runs]
    if not runs:
        return False
    if others:
        what = "a campaign" if (others[0] / STUDY).is_file() else "neither a run nor a campaign"
        raise UsageError(
            f"{runs[0]} holds a run of `sounding episode`, and {others[0]} {what}. Name runs alone, or campaigns alone."
        )
    n = len({folder.resolve() for folder in runs})
    if n < 2:
        raise UsageError(
            f"{runs[0]}: is one run. Name another run beside it; `sounding report {runs[0]}` makes the page of one."
        )
    if n > len(COLOURS):
        raise UsageError(f"{n} runs are too many to stand side by side. Name {len(COLOURS)} at most.")
    return True


def write_runs(folders: Sequence[Path], folder: Path, bounds: Sequence[Path] = ()) -> str:
    """Write report.html, compare.md and compare.csv for runs of episodes, and return the table as Markdown.

    Args:
        folders: Folders of two to four runs, finished or not.
        folder: The folder to write to, which is there.
        bounds: Folders that `sounding bound` wrote, beside whose limit the runs are shown.

    Raises:
        UsageError: A folder is not that of an episode, one of its files is broken, or no bound is of a run's case.
    """
    ends = shortest_names(folders)
    records = {path: _beside_limit(load_run(path), bounds) for path in ends}
    planners = [str(record.options["planner"]) for record in records.values()]
    runs = [
        _Run(
            name=planner if len(set(planners)) == len(planners) else f"{planner} ({ends[path]})",
            colour=colour,
            record=record,
            findings=findings_of(record),
        )
        for (path, record), planner, colour in zip(records.items(), planners, COLOURS, strict=False)
    ]
    rows = _rows(runs)
    header = ["", *(run.name for run in runs)]
    table = [header, ["---"] * len(header), *([name, *cells] for name, cells in rows)]
    text = (
        "\n".join(["\n".join(f"| {' | '.join(line)} |" for line in table), "", *_notes(runs)]).rstrip() + "\n"
    )
    with replacing(folder / "compare.md") as file:
        file.write(text.encode(errors="surrogateescape"))
    columns = [name for name, _ in rows]
    cells = [{"run": str(run.record.folder), "name": run.name} for run in runs]
    for name, values in rows:
        for row, value in zip(cells, values, strict=True):
            row[name] = value
    write_csv(folder / "compare.csv", cells, ["run", "name", *columns])
    with replacing(folder / REPORT) as file:
        file.write(_page(runs, rows, folder).encode(errors="surrogateescape"))
    return text


def _beside_limit(record: RunRecord, bounds: Sequence[Path]) -> RunRecord:
    """The record of a run whose summary tells of its limit; a run that was killed has no summary."""
    if not bounds or not record.summary:
        return record
    limit = limit_of_run(bounds, record.options)
    if limit is None:
        raise FieldError("bound", ", ".join(map(str, bounds)), other_case(record.folder, record.options))
    return replace(record, summary={**record.summary, LIMIT: limit})


def _page(runs: Sequence[_Run], rows: Sequence[tuple[str, list[str]]], folder: Path) -> str:
    records = [run.record for run in runs]
    return environment(TEMPLATES).get_template("runs.html.j2").render(
        title=" against ".join(run.name for run in runs),
        scenario=", ".join(dict.fromkeys(str(record.scenario["name"]) for record in records)),
        notes=_notes(runs),
        runs=[_shown(run, i, folder) for i, run in enumerate(runs)],
        rows=rows,
        progress=progress(records, [run.colour for run in runs], CURVE_HEIGHT),
        n_actions=max(record.n_steps for record in records),
        scripts=scripts(),
    )  # fmt: skip


def _shown(run: _Run, index: int, folder: Path) -> dict[str, Any]:
    """What the page's template shows of a run."""
    pack, record = Pack(), run.record
    data = {"view": view_data(record, pack), "n_steps": record.n_steps, "frames": []}
    page = record.folder / REPORT
    return {
        "number": f"-{index}" if index else "",
        "name": run.name,
        "colour": run.colour,
        "lede": lede(record),
        "status": STATUS.get(str(record.manifest.get("status")), ""),
        "ended": run.told.ended,
        "limit": run.told.limit,
        "report": link(page, folder) if page.is_file() else "",
        "classes": [
            {**each, "title": f"{each['title']}: {run.name}"} for each in classes(record, run.findings)
        ],
        "command": command(record),
        "data": json_text(data),
        "readings": json_text(readings(record)),
        "packed": pack.text(),
    }


def _rows(runs: Sequence[_Run]) -> list[tuple[str, list[str]]]:
    """The names of figures, and the value of each run: what was found, each tumour where all are the same, and more."""
    rows = [("found", [" ".join(run.told.found) for run in runs])]
    if _have_one_truth(runs):
        each = [list(run.told.lesions) for run in runs]
        for lesions in zip(*each, strict=True):
            cells = [", ".join(filter(None, (lesion.found, lesion.sensed))) or "–" for lesion in lesions]
            rows.append((f"{lesions[0].name}, {lesions[0].size}", cells))
    figures = [dict(key_figures(run.record)) for run in runs]
    rows.append(("sensing actions", [str(run.record.n_steps) for run in runs]))
    names = dict.fromkeys(name for each in figures for name in each)
    return rows + [(name, [each.get(name, "–") for each in figures]) for name in names]


def _have_one_truth(runs: Sequence[_Run]) -> bool:
    """Whether organ and tumours are the same in all runs, and lie in the same place."""
    first, *others = [(run.record.anatomy.organ, *run.record.anatomy.tumours) for run in runs]
    return all(
        len(other) == len(first) and all(_is_same(a, b) for a, b in zip(first, other, strict=True))
        for other in others
    )


def _is_same(one: Solid, other: Solid) -> bool:
    a, b = one.vertices_m, other.vertices_m
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=0.0, atol=1e-6))


def _notes(runs: Sequence[_Run]) -> list[str]:
    """What a reader of the page should know."""
    notes = [] if _have_one_truth(runs) else [
        "The runs do not face the same tumours in the same place, so that their numbers say little about planners. "
        "Runs of one scenario and seed with one arm do."
    ]  # fmt: skip
    versions = {run.record.manifest.get("commit") or run.record.manifest.get("sounding") for run in runs}
    if len(versions) > 1:
        notes.append("The runs were made with different versions of Sounding.")
    return notes
