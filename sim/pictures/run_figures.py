"""The figures at the end of a run: the paper's curves and views, from an episode and its steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import Prediction, precision_recall_curve
from sim.episode.episode import Episode
from sim.episode.step import Step
from sim.tables import nan_for_none
from sim.world.solids.solid import Solid

from .figures import TargetCurves, draw_precision_recall, draw_progress
from .map_views import MapPicture, View, draw_map_view

VIEWS: tuple[View, ...] = ("top", "side")


def draw_run_figures(folder: Path, episode: Episode, steps: Sequence[Step]) -> None:
    """Write precision_recall.png, auprc.png, map_top.png and map_side.png to a run folder.

    A second class has its curves in the first two, and views of its map in map_target_top.png and map_target_side.png.

    Args:
        folder: The run's folder.
        episode: The episode after its last step.
        steps: Its steps, at least one.
    """
    target = _target_curves(episode, steps)
    draw_progress(
        folder / "auprc.png",
        auprc=nan_for_none([step.auprc for step in steps]),
        sensed_fraction=nan_for_none([step.sensed_fraction for step in steps]),
        target=target,
    )
    if episode.prediction is None:
        return
    _draw_precision_recall(folder / "precision_recall.png", episode, steps[-1].auprc, target)
    picture, own = _map_picture(episode), _target_picture(episode)
    for view in VIEWS:
        draw_map_view(folder / f"map_{view}.png", picture, view=view)
        if own is not None:
            draw_map_view(folder / f"map_target_{view}.png", own, view=view)


def _target_curves(episode: Episode, steps: Sequence[Step]) -> TargetCurves | None:
    """What the figures show of the second class; None without one."""
    target = episode.target
    if target is None:
        return None
    # With a second class every step has a score of it; the condition tells the type checker.
    scores = [step.target for step in steps if step.target is not None]
    recall, precision = _ranking(target.prediction, target.truth.is_target)
    return TargetCurves(
        name=target.name,
        auprc=nan_for_none([score.auprc for score in scores]),
        sensed_fraction=[score.sensed_fraction for score in scores],
        recall=recall,
        precision=precision,
    )


def _ranking(
    prediction: Prediction | None, truth: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The recall and the precision of a map, empty where they are not defined."""
    if prediction is None or not truth.any():
        return np.zeros(0), np.zeros(0)
    curve = precision_recall_curve(prediction.score, truth)
    return curve.recall, curve.precision


def _draw_precision_recall(
    path: Path, episode: Episode, auprc: float | None, target: TargetCurves | None
) -> None:
    truth = episode.truth.is_tumour
    recall, precision = _ranking(episode.prediction, truth)
    draw_precision_recall(
        path,
        recall=recall,
        precision=precision,
        auprc=auprc,
        prevalence=float(truth.mean()),
        target=target,
    )


def _map_picture(episode: Episode) -> MapPicture:
    assert episode.prediction is not None
    return _picture(episode, episode.prediction, episode.truth.is_tumour, episode.truth.anatomy.tumours)


def _target_picture(episode: Episode) -> MapPicture | None:
    """The second class's map; None without one."""
    target = episode.target
    if target is None or target.prediction is None:
        return None
    truth = target.truth
    return _picture(
        episode, target.prediction, truth.is_target, truth.anatomy.tumours, target_name=target.name
    )


def _picture(
    episode: Episode,
    prediction: Prediction,
    truth: NDArray[np.bool_],
    bodies: Sequence[Solid],
    *,
    target_name: str | None = None,
) -> MapPicture:
    setup = episode.setup
    return MapPicture(
        axes_m=setup.query.axes_m,
        probability=setup.on_lattice(prediction.probability, outside=np.nan),
        is_tumour=setup.on_lattice(truth, outside=False),
        is_inside=setup.is_inside.reshape(setup.query.shape),
        poses_m=setup.workspace.positions_m[episode.sensed],
        organ_triangles_m=_triangles(setup.organ),
        tumour_triangles_m=_all_triangles(bodies),
        target_name=target_name,
    )


def _triangles(solid: Solid) -> NDArray[np.float64]:
    return solid.vertices_m[solid.faces]


def _all_triangles(solids: Sequence[Solid]) -> NDArray[np.float64] | None:
    return np.concatenate([_triangles(solid) for solid in solids]) if solids else None
