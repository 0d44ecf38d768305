"""The resolution of the array: the pulse along a line, and the beam's width across the lines and through the plane.

All three are Gaussians of a scatterer's amplitude. Widths are full widths at half of it (-6 dB).

The beam of an aperture D, focused at a depth f, is as wide at a depth z as diffraction and defocus make it,

    one way     w = sqrt((1.206 lambda z / D)^2 + (0.68 D (1 - z / f))^2),

of which 1.206 lambda z / D is the exact width of the far field of a slit, sinc(D x / (lambda z)) = 1/2, and
0.68 D (1 - z / f) that of the Gaussian with the standard deviation of the width that rays light. The receiving
aperture is focused at every depth and grows with it up to D, so that it has no defocus. The way out and the way back
multiply, and a product of Gaussians has 1 / w^2 = 1 / w_out^2 + 1 / w_back^2. Szabo, Diagnostic Ultrasound Imaging,
2nd ed., 2014, chapters 6 and 7.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .convex_array import SPEED_M_S, ConvexArray

SINC_HALF_WIDTH = 1.206
"""Full width of sinc(x) = sin(pi x) / (pi x) at half of its height."""
FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half height of a Gaussian of standard deviation 1."""
LIT_SHARE = FWHM_PER_SIGMA / math.sqrt(12.0)
"""Full width of a Gaussian with the standard deviation of an even distribution of width 1: 0.68."""
TAIL_SIGMAS = 3.0
"""Gaussians across and along the lines are cut here."""
SLICE_SIGMAS = 2.0
"""The Gaussian through the plane is cut here, at 14 % of its height."""


def pulse_fwhm_m(array: ConvexArray) -> float:
    """Length of a point's echo along a line at half of its amplitude [m].

    A Gaussian spectrum whose amplitude has the full width B halves its envelope over 4 ln 2 / (pi B) in time, and an
    echo's path is twice its depth: 2 ln 2 c / (pi B).
    """
    return 2.0 * math.log(2.0) * SPEED_M_S / (math.pi * array.bandwidth * array.frequency_hz)


def transmit_fwhm_m(array: ConvexArray, depths_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Width of the transmitted beam across the lines [m], in the shape of the depths."""
    diffraction_m = SINC_HALF_WIDTH * array.wavelength_m * depths_m / array.open_m
    return np.hypot(diffraction_m, LIT_SHARE * array.open_m * (1.0 - depths_m / array.focus_m))


def lateral_fwhm_m(array: ConvexArray, depths_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Width of a point's echo across the lines [m], in the shape of the depths."""
    receiving_m = np.minimum(array.open_m, depths_m / array.f_number)
    back_m = SINC_HALF_WIDTH * array.wavelength_m * depths_m / receiving_m
    return 1.0 / np.sqrt(transmit_fwhm_m(array, depths_m) ** -2 + back_m**-2)


def slice_fwhm_m(array: ConvexArray, depths_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Thickness of the slice through the plane [m], in the shape of the depths; one lens serves both ways."""
    diffraction_m = SINC_HALF_WIDTH * array.wavelength_m * depths_m / array.height_m
    lit_m = LIT_SHARE * array.height_m * (1.0 - depths_m / array.height_focus_m)
    one_way_m = np.hypot(diffraction_m, lit_m)
    return one_way_m / math.sqrt(2.0)


def axial_kernel(array: ConvexArray) -> NDArray[np.float32]:
    """The pulse's envelope on the samples of a line, of peak 1, shape (odd,)."""
    return _gaussian(pulse_fwhm_m(array) / array.sample_m / FWHM_PER_SIGMA)


def lateral_kernels(array: ConvexArray) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """The beam's profile on the lines at each sample's depth, of peak 1.

    Returns:
        Right halves of the profiles with the middle first, shape (n_samples, K), and how many of them count at each
        depth, shape (n_samples,).
    """
    pitch_m = (array.radius_m + array.depths_m) * array.line_rad
    sigma = lateral_fwhm_m(array, array.depths_m) / pitch_m / FWHM_PER_SIGMA
    counts = np.minimum(np.ceil(TAIL_SIGMAS * sigma).astype(np.int64), array.n_lines // 2) + 1
    steps = np.arange(counts.max())
    profiles = np.exp(-0.5 * (steps / sigma[:, None]) ** 2)
    return profiles.astype(np.float32), counts


def _gaussian(sigma: float) -> NDArray[np.float32]:
    half = max(math.ceil(TAIL_SIGMAS * sigma), 1)
    return np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2).astype(np.float32)
