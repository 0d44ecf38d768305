"""The figures at the end of a run: the paper's curves and views, from an episode and its steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import precision_recall_curve

from .episode import Episode, Step
from .figures import draw_precision_recall, draw_progress
from .map_views import MapPicture, draw_map_view
from .world.solid import Solid


def draw_run_figures(folder: Path, episode: Episode, steps: Sequence[Step]) -> None:
    """Write precision_recall.png, auprc.png, map_top.png and map_side.png to a run folder.

    Args:
        folder: Where to write.
        episode: The episode after its last step.
        steps: Its steps, at least one.
    """
    draw_progress(
        folder / "auprc.png",
        auprc=[np.nan if step.auprc is None else step.auprc for step in steps],
        sensed_fraction=[np.nan if step.sensed_fraction is None else step.sensed_fraction for step in steps],
    )
    if episode.prediction is None:
        return
    _draw_precision_recall(folder / "precision_recall.png", episode, steps[-1].auprc)
    picture = _map_picture(episode)
    draw_map_view(folder / "map_top.png", picture, view="top")
    draw_map_view(folder / "map_side.png", picture, view="side")


def _draw_precision_recall(path: Path, episode: Episode, auprc: float | None) -> None:
    truth = episode.truth.is_tumour
    recall = precision = np.zeros(1)
    if auprc is not None and episode.prediction is not None:
        curve = precision_recall_curve(episode.prediction.score, truth)
        recall, precision = curve.recall, curve.precision
    draw_precision_recall(
        path, recall=recall, precision=precision, auprc=auprc, prevalence=float(truth.mean())
    )


def _map_picture(episode: Episode) -> MapPicture:
    stage, prediction = episode.stage, episode.prediction
    assert prediction is not None
    shape, is_inside = stage.query.shape, stage.is_inside
    probability, is_tumour = np.full(is_inside.shape, np.nan), np.zeros(is_inside.shape, dtype=bool)
    probability[is_inside], is_tumour[is_inside] = prediction.probability, episode.truth.is_tumour
    return MapPicture(
        axes_m=stage.query.axes_m,
        probability=probability.reshape(shape),
        is_tumour=is_tumour.reshape(shape),
        is_inside=is_inside.reshape(shape),
        poses_m=stage.workspace.positions_m[episode.sensed],
        organ_triangles_m=_triangles(stage.organ),
        tumour_triangles_m=_all_triangles(episode.truth.anatomy.tumours),
    )


def _triangles(solid: Solid) -> NDArray[np.float64]:
    return solid.vertices_m[solid.faces]


def _all_triangles(solids: Sequence[Solid]) -> NDArray[np.float64] | None:
    return np.concatenate([_triangles(solid) for solid in solids]) if solids else None
