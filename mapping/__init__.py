"""The belief over where tumours are: a sequential Bayesian Hilbert map, and the metrics of a map."""

from .belief.base import UpdateReport
from .detailed_map import DetailedMap, InsetSettings
from .hilbert_map import HilbertMap
from .labelled_points import LabelledPoints
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
    "DetailedMap",
    "HilbertMap",
    "InsetSettings",
    "LabelledPoints",
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
