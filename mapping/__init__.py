"""The belief over where tumours are: a sequential Bayesian Hilbert map, and the metrics of a map."""

from .belief import UpdateReport
from .hilbert_map import HilbertMap
from .lattice import Lattice
from .metrics import (
    MapMetrics,
    PrecisionRecallCurve,
    average_precision,
    dice,
    evaluate_map,
    expected_calibration_error,
    log_loss,
    precision_recall_curve,
)
from .prediction import Prediction
from .settings import MapSettings

__all__ = [
    "HilbertMap",
    "Lattice",
    "MapMetrics",
    "MapSettings",
    "PrecisionRecallCurve",
    "Prediction",
    "UpdateReport",
    "average_precision",
    "dice",
    "evaluate_map",
    "expected_calibration_error",
    "log_loss",
    "precision_recall_curve",
]
