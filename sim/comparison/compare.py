"""The program behind `sounding compare`: tables and figures from the folders of campaigns."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from sim.campaign.engines.local import LocalEngine
from sim.campaign.study import Trial, options_of
from sim.campaign.tables import replacing
from sim.campaign.trial_result import TrialResult
from sim.cli.trials_options import CompareOptions
from sim.errors import UsageError

from .comparison import Comparison, compare_groups
from .figures import draw_curves, draw_precision, draw_reached, draw_sensings
from .page import write_comparison_page
from .tables import flat_rows, markdown
from .trial_groups import load_groups, notes_on

FIGURES: dict[str, Callable[[Path, Comparison, str], bool]] = {
    "sensings": draw_sensings,
    "reached": draw_reached,
    "auprc": draw_curves,
    "precision_recall": draw_precision,
}


@dataclass(frozen=True)
class CompareSummary:
    """What a comparison wrote."""

    text: str
    """All tables as Markdown."""
    folder: Path
    figures: tuple[Path, ...]


def run_compare(options: CompareOptions) -> CompareSummary:
    """Compare campaigns and write compare.md, compare.csv, report.html and figures.

    Raises:
        UsageError: A folder holds no campaign, a reference is unknown, or the output cannot be written.
    """
    groups = load_groups(options.folders, seeds=options.seed_range())
    contenders = list(dict.fromkeys(group.contender for group in groups))
    if options.reference is not None and options.reference not in contenders:
        raise UsageError(f"--reference {options.reference}: choose one of {'; '.join(contenders)}.")
    comparison = compare_groups(groups, reference=options.reference)
    notes = notes_on(options.folders)
    text = markdown(comparison, notes)
    folder = options.out_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / "compare.md") as file:
        file.write(text.encode())
    _write_csv(folder / "compare.csv", flat_rows(comparison))
    figures = [
        path
        for case in comparison.cases
        for name, draw in FIGURES.items()
        if draw(path := folder / f"{name}-{slug(case)}.png", comparison, case)
    ]
    if options.view_seed is not None:
        figures += draw_views(folder / "views", comparison, options.view_seed, options.jobs)
    views = folder / "views" if options.view_seed is not None else None
    write_comparison_page(folder, comparison, notes=notes, campaigns=options.folders, views=views)
    return CompareSummary(text, folder, tuple(figures))


def draw_views(folder: Path, comparison: Comparison, seed: int, n_jobs: int) -> list[Path]:
    """Run one seed of each contender again and write its episode folder, with top and side views of its map.

    Raises:
        UsageError: No contender has that seed.
    """
    trials = []
    for group in comparison.groups:
        for entry in group.entries:
            if entry["settings"]["seed"] == seed:
                name = f"{slug(group.case)}-{slug(group.contender)}"
                options = dataclasses.replace(options_of(entry["settings"]), map="always")
                trials.append(Trial(options, folder=folder.absolute() / name))
    if not trials:
        raise UsageError(f"--view-seed {seed}: no trial has that seed.")
    with LocalEngine(n_jobs, work=_write_folder) as engine, tqdm(total=len(trials), desc="views") as progress:
        for outcome in engine.outcomes(trials):
            progress.update(outcome is not None)
    return [trial.folder / f"map_{view}.png" for trial in trials for view in ("top", "side") if trial.folder]


def _write_folder(trial: Trial) -> TrialResult:
    """Write a trial's episode folder, in a process of the engine."""
    from sim.campaign.trial import write_trial_folder

    write_trial_folder(trial.run_options)
    return TrialResult({"status": "finished"})


def slug(text: str) -> str:
    """A text as part of a file's name."""
    return re.sub(r"[^\w.]+", "-", text).strip("-")


def _write_csv(path: Path, rows: Sequence[dict[str, object]]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    with replacing(path) as file:
        file.write(text.getvalue().encode())
