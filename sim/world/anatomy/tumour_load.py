"""The tumour load of a patient: how many tumours a liver has and how large they are, as in LiTS.

Published of the LiTS training set (Bilic et al., The Liver Tumor Segmentation Benchmark, Medical Image Analysis, 2023):
3 tumours a scan in the median (quartiles 1 and 9), and 16.1 ml of tumour a scan (quartiles 3.4 and 107.8). Most of them
are metastases, of which 58 % are under 20 mm. The law below has quartiles of 1, 3 and 8 tumours and of 3, 18 and 86 ml:

    count    = exp(N(ln 3, 1.5)), rounded, 1 to 30
    patient  = 16 mm exp(N(0, 0.35)), the median of the patient's tumours
    diameter = patient exp(N(0, 0.60)), 5 to 100 mm
"""

import numpy as np

COUNT_MEDIAN, COUNT_LOG_SPREAD, MOST_TUMOURS = 3.0, 1.5, 30
"""Number of tumours: the median and the spread of its logarithm, and the most."""

MEDIAN_DIAMETER_M = 0.016
"""Median diameter over patients [m]."""

PATIENT_LOG_SPREAD = 0.35
"""Spread of the logarithm of a patient's median diameter: some patients have only small ones."""

TUMOUR_LOG_SPREAD = 0.60
"""Spread of the logarithm of the diameters within a patient."""

DIAMETER_RANGE_M = (0.005, 0.100)
"""Diameters are held within this [m]."""


def draw_lits_diameters(rng: np.random.Generator) -> list[float]:
    """Diameters [m] of the tumours of one patient, of the spheres of equal volume, at least one."""
    count = int(
        np.clip(round(float(np.exp(rng.normal(np.log(COUNT_MEDIAN), COUNT_LOG_SPREAD)))), 1, MOST_TUMOURS)
    )
    patient_m = MEDIAN_DIAMETER_M * np.exp(rng.normal(0.0, PATIENT_LOG_SPREAD))
    return np.clip(patient_m * np.exp(rng.normal(0.0, TUMOUR_LOG_SPREAD, count)), *DIAMETER_RANGE_M).tolist()
