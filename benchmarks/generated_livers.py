"""Generated livers against what is published of LiTS, and a sheet of them to look at.

    .venv/bin/python -m benchmarks.generated_livers --count 200

It prints volumes, extents and shapes, and for the first seeds the tumour loads as planted, and draws
docs/figures/generated_livers.png. The livers of LiTS have 1,586 +- 447 ml (Bilic et al. 2023); on 92 of their outlines,
volume over that of the convex hull is 0.775 +- 0.05, and sphericity 0.73.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull
from tqdm import tqdm

from mapping import MapSettings
from sim.episode.scenario import Scenario
from sim.episode.setup import build_setup, make_workspace, placed_organ
from sim.episode.truth import make_truth
from sim.pictures.figures import save
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.viewing.inspection_figure import draw_view
from sim.world.anatomy.loading import LoadedAnatomy
from sim.world.meshes.topology import is_closed
from sim.world.solids.solid import Solid

PAGE_FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "generated_livers.png"
N_DRAWN = 6
EXTENTS = ("left-right", "front-back", "foot-head")


@dataclass(frozen=True, kw_only=True)
class SheetOptions:
    """Make livers and compare them with LiTS."""

    count: int = 200
    first: int = 0
    """First seed."""
    loads: int = 16
    """In so many of them tumours are planted too, which takes longer."""
    out: Path = PAGE_FIGURE


def main() -> None:
    """Make the livers, print their statistics, and draw the first ones."""
    options = tyro.cli(SheetOptions, description=__doc__)
    organs, n_poses = [], []
    for seed in tqdm(range(options.first, options.first + options.count), unit="liver"):
        scenario = scenario_of_seed(seed)
        placed, _ = placed_organ(scenario, None)
        assert is_closed(placed.organ.faces), seed
        organs.append(placed.organ)
        n_poses.append(make_workspace(scenario, placed).n_poses)
    print(f"{len(organs)} livers, each closed, with {min(n_poses):,} to {max(n_poses):,} poses")
    print_shapes(organs)
    planted = [plant(seed) for seed in tqdm(range(options.first, options.first + options.loads), unit="load")]
    for name, values in {
        "tumours": [len(each.tumours) for each in planted],
        "tumour volume [ml]": [sum(tumour.volume_m3 for tumour in each.tumours) * 1e6 for each in planted],
    }.items():
        quartiles = " / ".join(f"{each:.3g}" for each in np.percentile(values, [25, 50, 75]))
        print(f"{name}: quartiles {quartiles} of {len(planted)}")
    draw(planted[:N_DRAWN], options)


def scenario_of_seed(seed: int) -> Scenario:
    """The scenario of a seed."""
    return scenario_of(config_of(scenario="generated-liver", seed=seed))


def plant(seed: int) -> LoadedAnatomy:
    """The liver of a seed with its tumours, in patient axes."""
    setup = build_setup(scenario_of_seed(seed), None, MapSettings())
    anatomy = make_truth(setup, np.random.default_rng(seed).spawn(3)[0]).anatomy
    T = np.linalg.inv(setup.T_world_organ)
    tumours = tuple(each.transformed(T) for each in anatomy.tumours)
    return LoadedAnatomy(organ=anatomy.organ.transformed(T), tumours=tumours)


def print_shapes(organs: list[Solid]) -> None:
    """Print mean, deviation and range of what tells the shape of a liver."""
    volumes_m3 = np.array([organ.volume_m3 for organ in organs])
    extents_m = np.array([organ.extents_m[[0, 2, 1]] for organ in organs])
    hulls_m3 = np.array([ConvexHull(organ.vertices_m).volume for organ in organs])
    areas_m2 = np.array([organ.area_m2 for organ in organs])
    columns = {"volume [ml]": volumes_m3 * 1e6}
    columns |= {f"{name} [mm]": extents_m[:, i] * 1e3 for i, name in enumerate(EXTENTS)}
    columns["volume / hull"] = volumes_m3 / hulls_m3
    columns["sphericity"] = np.cbrt(np.pi) * (6.0 * volumes_m3) ** (2 / 3) / areas_m2
    for name, values in columns.items():
        print(f"{name}: {values.mean():.4g} +- {values.std():.3g}, {values.min():.4g} to {values.max():.4g}")
    proportions = extents_m / np.cbrt(volumes_m3)[:, None]
    variation = proportions.std(axis=0) / proportions.mean(axis=0)
    print("extents over the cube root of the volume vary by", *(f"{each:.1%}" for each in variation))


def draw(planted: list[LoadedAnatomy], options: SheetOptions) -> None:
    """Draw livers from the front and from the feet."""
    figure = Figure(figsize=(3.0 * len(planted), 5.6), layout="constrained")
    for index, axes in enumerate(figure.subplots(2, len(planted), squeeze=False).T):
        draw_view(axes[0], planted[index], 0)
        draw_view(axes[1], planted[index], 2)
        axes[0].set_title(f"seed {options.first + index}, from the front", loc="left", fontsize=10)
    save(figure, options.out)


if __name__ == "__main__":
    main()
