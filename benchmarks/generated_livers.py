"""Generated livers against what is published of LiTS, and a sheet of them to look at.

    python -m benchmarks.generated_livers --count 16

Prints volumes, extents, shape and tumour loads as planted, and draws docs/figures/generated_livers.png. LiTS: 1,586
+- 447 ml (Bilic et al. 2023); volume over that of the convex hull 0.775 +- 0.05 and sphericity 0.73, as measured on 92
of its outlines.
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
from sim.figures import save
from sim.inspection_figure import draw_view
from sim.options import EpisodeOptions
from sim.stage import build_stage
from sim.truth import make_truth
from sim.world.anatomy_files import LoadedAnatomy

PAGE_FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "generated_livers.png"
N_DRAWN = 6


@dataclass(frozen=True, kw_only=True)
class SheetOptions:
    """Make livers and compare them with LiTS."""

    count: int = 16
    first: int = 0
    """First seed."""
    out: Path = PAGE_FIGURE


def main() -> None:
    """Make the livers, print their statistics, and draw the first ones."""
    options = tyro.cli(SheetOptions, description=__doc__)
    rows, drawn, n_poses = [], [], []
    for seed in tqdm(range(options.first, options.first + options.count), unit="liver"):
        scenario = EpisodeOptions(scenario="generated-liver", seed=seed).make_scenario()
        stage = build_stage(scenario, None, MapSettings())
        anatomy = make_truth(stage, np.random.default_rng(seed).spawn(3)[0]).anatomy
        organ, volumes_ml = anatomy.organ, anatomy.tumour_volumes_m3 * 1e6
        n_poses.append(stage.workspace.n_poses)
        assert organ.to_trimesh().is_watertight
        hull_m3 = float(ConvexHull(organ.vertices_m).volume)
        sphericity = np.cbrt(np.pi) * (6.0 * organ.volume_m3) ** (2 / 3) / organ.area_m2
        shape = (organ.volume_m3 / hull_m3, sphericity)
        load = (len(volumes_ml), volumes_ml.sum())
        rows.append((organ.volume_m3 * 1e6, *(organ.extents_m[[0, 2, 1]] * 1e3), *shape, *load))
        if len(drawn) < N_DRAWN:
            T = np.linalg.inv(stage.T_world_organ)
            tumours = tuple(each.transformed(T) for each in anatomy.tumours)
            drawn.append(LoadedAnatomy(organ=organ.transformed(T), tumours=tumours))
    print(f"{len(rows)} livers, each closed and with poses on it: {min(n_poses)} at least")
    names = (
        "volume [ml]",
        "left-right [mm]",
        "front-back [mm]",
        "foot-head [mm]",
        "volume / hull",
        "sphericity",
    )
    for name, values in zip(names, np.array(rows).T, strict=False):
        print(f"{name}: {values.mean():.4g} +- {values.std():.2g}, {values.min():.4g} to {values.max():.4g}")
    proportions = np.array([np.array(row[1:4]) / np.cbrt(row[0]) for row in rows])
    variation = proportions.std(axis=0) / proportions.mean(axis=0)
    print("extents over the cube root of the volume vary by", *(f"{each:.1%}" for each in variation))
    for name, values in zip(("tumours", "tumour volume [ml]"), np.array(rows).T[6:], strict=True):
        print(
            f"{name}: quartiles {' / '.join(f'{each:.3g}' for each in np.percentile(values, [25, 50, 75]))}"
        )
    figure = Figure(figsize=(3.0 * N_DRAWN, 5.6), layout="constrained")
    for index, axes in enumerate(figure.subplots(2, len(drawn)).T):
        draw_view(axes[0], drawn[index], 0)
        draw_view(axes[1], drawn[index], 2)
        axes[0].set_title(f"seed {options.first + index}, from the front", loc="left", fontsize=10)
    save(figure, options.out)


if __name__ == "__main__":
    main()
