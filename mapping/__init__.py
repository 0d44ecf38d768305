"""The belief over where tumours are: a sequential Bayesian Hilbert map, and the metrics of a map.

`HilbertMap` is the paper's map, `DetailedMap` lays finer ones into it where tumour was sensed, and `TumourMap` is what
a map of one's own has to offer. `belief/` holds the algebra.
"""

from .belief.belief import UpdateReport
from .detailed_map import DetailedMap
from .hilbert_map import HilbertMap
from .labelled_points import LabelledPoints
from .lattice import Lattice
from .merged_readings import merged
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
from .read_only import read_only
from .settings import DetailSettings, MapSettings
from .trust.error_rates import ErrorRates
from .trust.label_trust import LabelTrust
from .trust.settings import TrustSettings
from .trust.teaching import laid_anew, settle, teach
from .trust.votes import votes
from .tumour_map import MapSpace, TumourMap, TumourMapFactory, load_map, make_hilbert_map

__all__ = [
    "DetailSettings",
    "DetailedMap",
    "ErrorRates",
    "HilbertMap",
    "LabelTrust",
    "LabelledPoints",
    "Lattice",
    "MapMetrics",
    "MapSettings",
    "MapSpace",
    "PrecisionRecallCurve",
    "Prediction",
    "TrustSettings",
    "TumourMap",
    "TumourMapFactory",
    "UpdateReport",
    "average_precision",
    "dice",
    "evaluate_map",
    "expected_calibration_error",
    "laid_anew",
    "load_map",
    "log_loss",
    "make_hilbert_map",
    "merged",
    "precision_recall_curve",
    "read_only",
    "settle",
    "teach",
    "votes",
]
