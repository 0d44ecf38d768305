"""Actions against the arm's travel, from the campaign of the study `travel`.

Run it by `.venv/bin/python -m benchmarks.travel --help`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sim.comparison.estimates import mean_estimate
from sim.comparison.tables import interval_text
from sim.comparison.trial_groups import TrialGroup, load_groups
from sim.pictures.figures import BLUE, GRID, VERMILION
from sim.tables import markdown_table

ROOT = Path(__file__).resolve().parents[1]
MEASURES = {
    "n_sensings": "actions",
    "tip_path_m": "tip path [m]",
    "joint_travel_rad": "joint travel [rad]",
    "procedure_s": "procedure [s]",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print the table and draw the curve."""

    campaign: Path = Path("renders/travel")
    """Folder of the campaign."""
    figure: Path = ROOT / "docs" / "figures" / "travel.png"
    """Picture of the curve to write."""


def label_of(group: TrialGroup) -> str:
    """The setting by which the group differs from others."""
    batch = group.setting("batch")
    return f"batch {batch}" if batch > 1 else f"weight {group.setting('travel_weight'):g}"


def main(options: Options) -> None:
    """Print the table and draw the curve."""
    groups = load_groups([options.campaign])
    rows, means = [], []
    for group in groups:
        estimates = [mean_estimate(group.values(key)) for key in MEASURES]
        means.append([estimate.mean for estimate in estimates])
        cells = [f"{each.mean:.1f} {interval_text(each.interval, '{:.1f}')}" for each in estimates]
        rows.append((label_of(group), str(len(group.entries)), *cells))
    print(markdown_table(("setting", "seeds", *MEASURES.values()), rows))
    draw(options.figure, [label_of(group) for group in groups], np.array(means))


def draw(path: Path, labels: list[str], means: np.ndarray) -> None:
    """Draw mean actions against mean tip path and joint travel, with a point per setting."""
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, column, name in zip(figure.subplots(1, 2), (1, 2), list(MEASURES.values())[1:3], strict=True):
        is_batch = np.array([label.startswith("batch") for label in labels])
        axes.plot(means[~is_batch, column], means[~is_batch, 0], "o-", color=BLUE, label="travel weight")
        axes.plot(means[is_batch, column], means[is_batch, 0], "s", color=VERMILION, label="tour of a batch")
        for label, mean in zip(labels, means, strict=True):
            axes.annotate(
                label.split()[1], (mean[column], mean[0]), xytext=(5, 4), textcoords="offset points"
            )
        axes.set(xlabel=name, ylabel="actions to 95 %")
        axes.grid(color=GRID)
        axes.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(tyro.cli(Options))
