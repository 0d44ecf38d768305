"""The metrics of a map: how good it is against the truth at the points of a lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .prediction import Prediction


@dataclass(frozen=True, kw_only=True)
class MapMetrics:
    """Scores of a map; `auprc` and `dice` are better when they are higher, the others when they are lower."""

    n_points: int
    """Number of points scored."""
    n_occupied: int
    """How many of them are truly occupied."""
    auprc: float | None
    """Area under the precision-recall curve (average precision); None without an occupied point."""
    log_loss: float
    """Mean of -log P(true label) [nat]."""
    brier_score: float
    """Mean squared difference between probability and label."""
    expected_calibration_error: float
    """Mean gap between probability and observed share over bins of equally many points."""
    dice: float | None
    """Overlap 2 |A and B| / (|A| + |B|) of {probability > 0.5} and the truth; None when both are empty."""


@dataclass(frozen=True, eq=False)
class PrecisionRecallCurve:
    """Precision and recall at each distinct threshold, from the highest down, after a first entry of recall 0."""

    precision: NDArray[np.float64]
    """Share of true positives among the points called occupied; 1 in the first entry, where none is."""
    recall: NDArray[np.float64]
    """Share of true positives among the points that are occupied."""
    threshold: NDArray[np.float64]
    """Score from which a point is called occupied; infinite for the first entry."""


def evaluate_map(prediction: Prediction, is_occupied: ArrayLike) -> MapMetrics:
    """The scores of a prediction against the truth at the same points.

    Args:
        prediction: What a map says of N points.
        is_occupied: The truth, shape (N,).

    Raises:
        ValueError: If the truth is not one label per point, or a score is not finite.
    """
    truth = _check_truth(is_occupied, prediction.latent_mean)
    probability = prediction.probability
    return MapMetrics(
        n_points=truth.size,
        n_occupied=int(truth.sum()),
        auprc=average_precision(prediction.score, truth),
        log_loss=log_loss(prediction.score, truth),
        brier_score=float(np.mean((probability - truth) ** 2)),
        expected_calibration_error=expected_calibration_error(probability, truth),
        dice=dice(probability > 0.5, truth),
    )


def precision_recall_curve(score: ArrayLike, is_occupied: ArrayLike) -> PrecisionRecallCurve:
    """The precision-recall curve of a ranking; points of equal score enter together.

    Args:
        score: Anything that ranks the points, shape (N,); use the latent score, since probabilities
            saturate into ties.
        is_occupied: The truth, shape (N,), with at least one occupied point.

    Raises:
        ValueError: If shapes differ, a score is not finite, or no point is occupied (recall is then
            undefined).
    """
    scores = np.asarray(score, dtype=np.float64)
    truth = _check_truth(is_occupied, scores)
    if not truth.any():
        raise ValueError("no point is occupied, so recall is undefined; score a truth with at least one")
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(truth[order])
    ends = np.append(np.flatnonzero(np.diff(scores[order])), truth.size - 1)
    return PrecisionRecallCurve(
        precision=np.append(1.0, hits[ends] / (ends + 1)),
        recall=np.append(0.0, hits[ends] / hits[-1]),
        threshold=np.append(np.inf, scores[order][ends]),
    )


def average_precision(score: ArrayLike, is_occupied: ArrayLike) -> float | None:
    """The average precision, the sum over thresholds of (R_k - R_{k-1}) P_k; None without an occupied point.

    Args:
        score: Anything that ranks the points, shape (N,).
        is_occupied: The truth, shape (N,).
    """
    scores = np.asarray(score, dtype=np.float64)
    if not _check_truth(is_occupied, scores).any():
        return None
    curve = precision_recall_curve(scores, is_occupied)
    return float(np.sum(np.diff(curve.recall) * curve.precision[1:]))


def log_loss(logit: ArrayLike, is_occupied: ArrayLike) -> float:
    """The mean of -log P(true label) [nat], from logits so that no probability saturates.

    Args:
        logit: Logit of the probability of occupancy at each point, shape (N,).
        is_occupied: The truth, shape (N,).
    """
    logits = np.asarray(logit, dtype=np.float64)
    truth = _check_truth(is_occupied, logits)
    return float(np.mean(np.logaddexp(0, np.where(truth, -logits, logits))))


def expected_calibration_error(probability: ArrayLike, is_occupied: ArrayLike, *, n_bins: int = 15) -> float:
    """The mean of |mean probability - observed share| over bins that hold equally many points.

    Args:
        probability: Probability of occupancy at each point, shape (N,).
        is_occupied: The truth, shape (N,).
        n_bins: Number of bins; fewer where there are fewer points.
    """
    probabilities = np.asarray(probability, dtype=np.float64)
    truth = _check_truth(is_occupied, probabilities)
    # Points of equal probability share their labels evenly, so that their order does not matter.
    _, group = np.unique(probabilities, return_inverse=True)
    share = (np.bincount(group, weights=truth) / np.bincount(group))[group]
    order = np.argsort(probabilities, kind="stable")
    bins = np.array_split(order, min(n_bins, order.size))
    gaps = [abs(float(probabilities[part].mean() - share[part].mean())) * part.size for part in bins]
    return float(np.sum(gaps) / order.size)


def dice(is_called_occupied: ArrayLike, is_occupied: ArrayLike) -> float | None:
    """The Dice overlap 2 |A and B| / (|A| + |B|) of two sets of points, None when both are empty.

    Args:
        is_called_occupied: Which points are in the one, shape (N,).
        is_occupied: Which are in the other, shape (N,).
    """
    called = np.asarray(is_called_occupied, dtype=bool)
    truth = _check_truth(is_occupied, called)
    total = int(called.sum() + truth.sum())
    return None if total == 0 else float(2 * np.sum(called & truth) / total)


def _check_truth(is_occupied: ArrayLike, values: NDArray) -> NDArray[np.bool_]:
    truth = np.asarray(is_occupied)
    if truth.ndim != 1 or truth.shape != values.shape or truth.size == 0:
        raise ValueError(
            f"the truth must be one label for each of the {values.shape} values, not {truth.shape}"
        )
    if not np.all(np.isfinite(values)):
        raise ValueError("every score must be finite")
    if not np.all((truth == 0) | (truth == 1)):
        raise ValueError("the truth must hold only False and True (or 0 and 1)")
    return truth.astype(bool)
