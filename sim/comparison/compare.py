"""The program behind `sounding compare`: it writes tables and figures from the folders of campaigns."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from mapping.storage import replacing
from sim.campaign.engines.local import LocalEngine
from sim.campaign.study import Trial
from sim.campaign.trial_result import TrialResult
from sim.errors import FieldError, UsageError
from sim.record.ownership import refuse_strangers
from sim.running.config import ALWAYS
from sim.running.fields import changed, config_of
from sim.tables import write_csv

from .comparison import Comparison, compare_groups
from .figures import draw_curves, draw_precision, draw_reached, draw_sensings
from .lesions.figures import draw_free_response, draw_mapped
from .lesions.tables import LESION_COLUMNS, lesion_rows
from .limits import limit_rows, load_limits
from .page import write_comparison_page
from .runs import are_runs, write_runs
from .tables import flat_rows, markdown
from .trial_groups import load_groups, notes_on

FIGURES: dict[str, Callable[[Path, Comparison, str], bool]] = {
    "sensings": draw_sensings,
    "reached": draw_reached,
    "auprc": draw_curves,
    "precision_recall": draw_precision,
    "lesions_mapped": draw_mapped,
    "free_response": draw_free_response,
}
"""What draws each figure of a case, by the figure's name."""


@dataclass(frozen=True)
class CompareSummary:
    """What a comparison wrote."""

    text: str
    """All tables as Markdown."""
    folder: Path
    figures: tuple[Path, ...]


def compare(
    folders: Sequence[Path | str],
    out: Path | str | None = None,
    *,
    seeds: Container[int] | None = None,
    reference: str | None = None,
    view_seed: int | None = None,
    jobs: int = 2,
    bound: Sequence[Path | str] = (),
) -> CompareSummary:
    """Compare campaigns and write compare.md, compare.csv, compare_lesions.csv, report.html and figures, or show runs
    on one page.

    Args:
        folders: One or more folders that `run_trials` or `sounding trials` wrote, or two to four folders of runs.
        out: Folder to write to; by default `compare` in the first of them, with the names of the others behind it.
        seeds: Seeds to look at; None for all.
        reference: Contender with which all others are paired; None for all pairs.
        view_seed: Seed of each contender to run again, to draw its map and poses from above and from the side.
        jobs: Number of processes that draw the views.
        bound: Folders that `sounding bound` wrote, each of one case, beside whose limit contenders or runs are shown.

    Raises:
        UsageError: A folder holds no campaign or no bound, a reference is unknown, or the output cannot be written.
    """
    campaigns = [Path(folder) for folder in folders]
    if are_runs(campaigns):
        for name, value in (
            ("seeds", seeds),
            ("reference", reference),
            ("view_seed", view_seed),
        ):
            if value is not None:
                raise UsageError(f"`{name}` goes only with campaigns, and {campaigns[0]} holds a single run.")
        folder = _own_folder(campaigns, out)
        return CompareSummary(write_runs(campaigns, folder, list(map(Path, bound))), folder, ())
    groups = load_groups(campaigns, seeds=seeds)
    contenders = list(dict.fromkeys(group.contender for group in groups))
    if reference is not None and reference not in contenders:
        raise FieldError("reference", reference, f"choose one of {'; '.join(contenders)}.")
    comparison = compare_groups(groups, reference=reference)
    notes = notes_on(campaigns)
    limits = load_limits([Path(each) for each in bound], comparison)
    text = markdown(comparison, notes, limits)
    folder = _own_folder(campaigns, out)
    with replacing(folder / "compare.md") as file:
        file.write(text.encode(errors="surrogateescape"))
    write_csv(folder / "compare.csv", [*flat_rows(comparison), *limit_rows(comparison, limits)])
    write_csv(folder / "compare_lesions.csv", lesion_rows(comparison), LESION_COLUMNS)
    figures = [
        path
        for case in comparison.cases
        for name, draw in FIGURES.items()
        if draw(path := folder / f"{name}-{slug(case)}.png", comparison, case)
    ]
    views = None if view_seed is None else folder / "views"
    if views is not None and view_seed is not None:
        figures += draw_views(view_trials(views, comparison, view_seed), jobs)
    write_comparison_page(folder, comparison, notes=notes, campaigns=campaigns, views=views, limits=limits)
    return CompareSummary(text, folder, tuple(figures))


def _own_folder(campaigns: Sequence[Path], out: Path | str | None) -> Path:
    """The folder to write to, made where it is not there."""
    folder = _default_folder(campaigns) if out is None else Path(out)
    if not (folder / "compare.csv").is_file():
        refuse_strangers(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _default_folder(campaigns: Sequence[Path]) -> Path:
    return campaigns[0] / "-".join(["compare", *(slug(path.resolve().name) for path in campaigns[1:])])


def view_trials(folder: Path, comparison: Comparison, seed: int) -> list[Trial]:
    """The trials of one seed, one of each contender, with the folders in which their episodes are to be written again.

    Raises:
        UsageError: No contender has that seed.
    """
    trials = []
    for group in comparison.groups:
        for entry in group.entries:
            if entry["settings"]["seed"] == seed:
                name = f"{slug(group.case)}-{slug(group.contender)}"
                config = changed(config_of(entry["settings"]), map=ALWAYS)
                trials.append(Trial(config, folder=folder.absolute() / name))
    if not trials:
        raise FieldError("view_seed", seed, "no trial has that seed.")
    return trials


def draw_views(trials: Sequence[Trial], n_jobs: int) -> list[Path]:
    """Run trials again, write their episode folders, and return the top and side views of their maps."""
    with LocalEngine(n_jobs, work=_write_folder) as engine, tqdm(total=len(trials), desc="views") as progress:
        for outcome in engine.outcomes(trials):
            progress.update(outcome is not None)
    return [trial.folder / f"map_{view}.png" for trial in trials for view in ("top", "side") if trial.folder]


def _write_folder(trial: Trial) -> TrialResult:
    """Write a trial's episode folder, in a process of the engine."""
    from sim.campaign.trial import write_trial_folder

    write_trial_folder(trial)
    return TrialResult({"status": "finished"})


def slug(text: str) -> str:
    """A text as part of a file's name."""
    return re.sub(r"[^\w.]+", "-", text).strip("-")
