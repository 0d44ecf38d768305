"""The paper's tables and figures beside its numbers: `make paper`, or `.venv/bin/python -m benchmarks.paper --help`.

It takes the campaign of the study `paper`, and rewrites the part of docs/results.md between its markers.
"""

from __future__ import annotations

import itertools
import shutil
from dataclasses import dataclass
from pathlib import Path

import tyro

from sim.comparison.compare import FIGURES, compare, draw_views, slug, view_trials
from sim.comparison.comparison import Comparison, compare_groups
from sim.comparison.tables import interval_text, pair_table
from sim.comparison.trial_groups import load_groups
from sim.tables import markdown_table

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- begin: written by make paper -->", "<!-- end: written by make paper -->"
PLANNERS = ("expected-improvement", "random", "multi-resolution")
PAPER_SENSINGS = {
    "expected-improvement": "25.5 ± 9.0",
    "random": "258.8 ± 156.7",
    "multi-resolution": "172.2 ± 84.7",
}
PAPER_AUPRC = {"spheres": (50, "0.88"), "liver": (30, "0.84 on its own patient")}
SPHERE, SPHERE_ARM = "sphere, arm none", "sphere, arm default"
VIEWS = ((SPHERE, 0), ("spheres, arm none", 4), ("liver, arm none", 4))
"""Cases and seeds of the views: the paper shows its first and its fifth trial."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write the results of the study `paper`."""

    campaign: Path = Path("renders/paper")
    """Folder of the study's campaign."""
    figures: Path = ROOT / "renders" / "curated" / "paper"
    """Folder for the figures that the page shows."""
    page: Path = ROOT / "docs" / "results.md"
    """The page whose part between the markers is rewritten."""
    views: bool = True
    """Run one seed of each method again as well, for the views of its map."""
    jobs: int = 2
    """Number of processes that draw the views."""


def main(options: Options) -> None:
    """Compare the campaign's planners, draw the figures, and write the page."""
    compare((options.campaign,))
    everything = compare_groups(load_groups([options.campaign]))
    ten = compare_groups(load_groups([options.campaign], seeds=range(10)))
    shutil.rmtree(options.figures, ignore_errors=True)
    options.figures.mkdir(parents=True)
    sections = [scenario_1(ten, everything), *(accuracy(everything, name) for name in PAPER_AUPRC)]
    draw_figures(options, ten, everything)
    if options.views:
        write_views(options, everything)
        sections.append(views_section(options))
    text = "\n\n".join(sections)
    page = options.page.read_text(encoding="utf-8")
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    options.page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")
    print(text)
    print(f"\nwritten to {options.page} and {options.figures}; all tables are in {options.campaign}/compare")


def draw_figures(options: Options, ten: Comparison, everything: Comparison) -> None:
    """Draw those figures of the comparison that the page shows."""
    FIGURES["sensings"](options.figures / "sensings-ten.png", ten, SPHERE)
    for name in ("sensings", "reached"):
        FIGURES[name](options.figures / f"{name}-{slug(SPHERE)}.png", everything, SPHERE)
    for scenario, arm in itertools.product(PAPER_AUPRC, ("none", "default")):
        case = f"{scenario}, arm {arm}"
        for name in ("auprc", "precision_recall"):
            FIGURES[name](options.figures / f"{name}-{slug(case)}.png", everything, case)


def image(name: str, caption: str) -> str:
    """The text by which the page shows a figure."""
    return f"![{caption}](../renders/curated/paper/{name}.png)"


def scenario_1(ten: Comparison, everything: Comparison) -> str:
    """The section about sensings until 95 %: its table, the pairs and the figures."""
    rows = []
    for planner in PLANNERS:
        cells = [sensings_text(part, case, planner) for part, case in ((ten, SPHERE), (everything, SPHERE))]
        rows.append((planner, PAPER_SENSINGS[planner], *cells, sensings_text(ten, SPHERE_ARM, planner)))
    head = ("method", "paper, 10 trials", "here, seeds 0-9", "here, seeds 0-99", "with the arm, seeds 0-9")
    pairs = [p for p in everything.pairings if p.case == SPHERE and p.measure.key == "sensings_to_95"]
    return "\n\n".join(
        [
            "### Scenario 1: sensing actions until 95 % of the tumour was sensed",
            "Mean ± standard deviation, [95 % interval of the mean], median.",
            markdown_table(head, rows),
            "Pairs on the same 100 tumours, first minus second:",
            pair_table(pairs),
            image("sensings-ten", "Ten trials; a bar is a mean, a dot a trial"),
            image(f"sensings-{slug(SPHERE)}", "A hundred trials"),
            image(f"reached-{slug(SPHERE)}", "Share of the trials that had got to 95 % by then"),
        ]
    )


def sensings_text(comparison: Comparison, case: str, planner: str) -> str:
    """The cell of a method."""
    score = comparison.score(case, planner, "sensings_to_95")
    if score is None:
        return "–"
    estimate = score.estimate
    never = f", {score.n_never} never" if score.n_never else ""
    spread = f"{estimate.mean:.1f} ± {estimate.deviation:.1f} {interval_text(estimate.interval, '{:.1f}')}"
    return f"{spread}, median {score.median:g}{never}"


def accuracy(comparison: Comparison, scenario: str) -> str:
    """The section about the AUPRC at the end of a scenario: its table, the pairs and the figures."""
    n_actions, paper = PAPER_AUPRC[scenario]
    rows = []
    for planner in PLANNERS:
        cells = []
        for arm in ("none", "default"):
            score = comparison.score(f"{scenario}, arm {arm}", planner, "auprc")
            interval = interval_text(score.estimate.interval, "{:.3f}") if score else ""
            cells.append(
                f"{score.estimate.mean:.3f} ± {score.estimate.deviation:.3f} {interval}" if score else "–"
            )
        rows.append((planner, paper if planner == "expected-improvement" else "–", *cells))
    name = {"spheres": "Scenario 2", "liver": "The liver"}[scenario]
    pairs = [p for p in comparison.pairings if p.case == f"{scenario}, arm none" and p.measure.key == "auprc"]
    return "\n\n".join(
        [
            f"### {name}: AUPRC after {n_actions} sensing actions",
            "Mean ± standard deviation over 10 seeds, [95 % interval of the mean].",
            markdown_table(("method", "paper", "here, free probe", "here, with the arm"), rows),
            "Pairs on the same tumours, without the arm:",
            pair_table(pairs),
            image(f"auprc-{slug(f'{scenario}, arm none')}", "AUPRC against sensing actions, free probe"),
            image(f"auprc-{slug(f'{scenario}, arm default')}", "The same with the arm"),
            image(f"precision_recall-{slug(f'{scenario}, arm none')}", "Precision and recall, free probe"),
            image(f"precision_recall-{slug(f'{scenario}, arm default')}", "The same with the arm"),
        ]
    )


def views_section(options: Options) -> str:
    """The section of the views that were drawn, case by case."""
    parts = ["### Maps and poses"]
    for case, seed in VIEWS:
        parts.append(f"{case}, seed {seed}: from above and from the side, the poses numbered in their order.")
        found = sorted(options.figures.glob(f"map_*-{slug(case)}-*.png"))
        parts += [image(path.stem, path.stem.replace("-", " ").replace("_", " ")) for path in found]
    return "\n\n".join(parts)


def write_views(options: Options, comparison: Comparison) -> None:
    """Draw top and side views of the final maps of one seed per case."""
    trials = []
    for case, seed in VIEWS:
        groups = [g for g in comparison.groups_of(case) if case == SPHERE or g.contender == PLANNERS[0]]
        trials += view_trials(options.campaign / "views", Comparison(tuple(groups), (), ()), seed)
    # The longest first, so that no core waits for the last.
    for path in draw_views(trials[::-1], options.jobs):
        shutil.copyfile(path, options.figures / f"{path.stem}-{path.parent.name}.png")


if __name__ == "__main__":
    main(tyro.cli(Options))
