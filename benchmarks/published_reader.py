"""Does the reader `published` err as published readers do? Many views of lesions, beside the figures of the sources.

    .venv/bin/python -m benchmarks.published_reader [--livers 40] [--views 60] [--first 1000]

Every view is a random pose on a generated liver with a clinical load of lesions. A lesion is in a view if the view has
at least 30 of its points, of some 16,000. Its Dice is over the points of the view, between the lesion and what the
reader drew about it, and of the lesions that were not missed. Intervals are from resampling livers.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
import tyro
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from mapping import MapSettings
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.episode.truth import make_truth
from sim.tables import markdown_table
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.errors.echogenicity import ECHOGENICITIES
from sim.world.sensing.errors.lesion_views import lesion_of, outlined
from sim.world.sensing.errors.published import PUBLISHED, PUBLISHED_DICE, PUBLISHED_MISSED_SHARE
from sim.world.sensing.sensor import SceneState

LEAST_POINTS = 30
"""A lesion is in a view that has this many of its points."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print the reader's figures beside those of the sources."""

    livers: int = 40
    views: int = 60
    """Views of each liver."""
    first: int = 1000
    """First seed."""


def lesion_views(seed: int, n_views: int) -> list[tuple[str, float, float | None]]:
    """How each lesion of each view looks, its diameter [m], and its Dice, None where it was missed."""
    setup = build_setup(replace(load_scenario("generated-liver"), organ_seed=seed), None, MapSettings())
    truth_rng, rng = np.random.default_rng(seed).spawn(2)
    scene = make_truth(setup, truth_rng).scene
    state = SceneState(scene, scene.new_data())
    sensor, found = ConeSensor(n_rays=400, n_points_per_ray=40), []
    for pose in rng.integers(setup.workspace.n_poses, size=n_views):
        setup.positioner.place(state.data, int(pose), is_lifted=False)
        reading = sensor.sense(state, rng)
        depths_m = (reading.points_m - state.T_world_probe[:3, 3]) @ state.T_world_probe[:3, 2]
        for solid in scene.anatomy.tumours:
            is_lesion = solid.contains(reading.points_m)
            if is_lesion.sum() < LEAST_POINTS:
                continue
            lesion = lesion_of(solid)
            drawn = outlined(lesion, reading.points_m, depths_m, PUBLISHED, rng)
            overlap = 2.0 * (drawn & is_lesion).sum() / (drawn.sum() + is_lesion.sum())
            found.append((lesion.looks.name, lesion.diameter_m, float(overlap) if drawn.any() else None))
    return found


def _mean(values: list[list[float]]) -> str:
    """The mean over all views with its interval, from resampling livers."""
    kept = [each for each in values if each]
    if not kept:
        return "-"
    sums, counts = np.array([sum(each) for each in kept]), np.array([len(each) for each in kept])
    chosen = np.random.default_rng(0).integers(len(kept), size=(2000, len(kept)))
    low, high = np.quantile(sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1), (0.025, 0.975))
    return f"{sums.sum() / counts.sum():.3f} [{low:.3f}, {high:.3f}]"


def main(options: Options) -> None:
    """Print the table."""
    dice: dict[str, list[list[float]]] = defaultdict(list)
    missed: dict[str, list[list[float]]] = defaultdict(list)
    with threadpool_limits(1):
        for seed in tqdm(range(options.first, options.first + options.livers)):
            views = lesion_views(seed, options.views)
            for name in (*(each.name for each in ECHOGENICITIES), "all"):
                own = [(size, score) for looks, size, score in views if name in (looks, "all")]
                dice[name].append([score for _, score in own if score is not None])
                missed[name].append([float(score is None) for _, score in own])
            for low, high in ((0.0, 10.0), (10.0, 20.0), (20.0, np.inf)):
                own = [score for _, size, score in views if low <= 1e3 * size < high]
                name = f"{low:g} mm and more" if np.isinf(high) else f"{low:g}-{high:g} mm"
                dice[name].append([score for score in own if score is not None])
                missed[name].append([float(score is None) for score in own])
    published = {each.name: (f"{each.published_dice:.2f}", "") for each in ECHOGENICITIES}
    published["all"] = (f"{PUBLISHED_DICE:.2f}", f"{PUBLISHED_MISSED_SHARE:.2f}")
    rows = []
    for name in dice:
        of_dice, of_missed = published.get(name, ("", ""))
        n_views = sum(len(each) for each in missed[name])
        rows.append([name, str(n_views), _mean(dice[name]), of_dice, _mean(missed[name]), of_missed])
    print(markdown_table(["lesions", "views", "Dice", "published", "missed", "published"], rows))


if __name__ == "__main__":
    main(tyro.cli(Options))
