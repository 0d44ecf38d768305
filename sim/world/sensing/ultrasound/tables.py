"""What all planes of an array share: its lines, its beam and pulse, the noise and the level of the speckle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import beam
from .convex_array import ConvexArray
from .scattering import N_ANGLES, N_PER_CUBE, N_PHASES, N_WEIGHTS
from .settings import Settings

N_NOISE = 1 << 20
"""Length of the table of noise."""
MOST_TGC_DB = 150.0
"""The compensation rises no further [dB]: there only noise is left."""


@dataclass(frozen=True, eq=False)
class Tables:
    """What all planes of an array share."""

    starts_m: NDArray[np.float64]
    """First sample of each line in the plane, shape (L, 3)."""
    directions: NDArray[np.float64]
    """Unit vectors of the lines in the plane, shape (L, 3)."""
    corners_m: NDArray[np.float64]
    """Points whose hull holds the slice, in the plane, shape (C, 3)."""
    slices_m: NDArray[np.float64]
    """Half thickness of the slice at each sample, shape (S,)."""
    cube_m: float
    """Edge of the cubes that hold `N_PER_CUBE` scatterers each [m]."""
    keeps: NDArray[np.float64]
    """Of the scatterers of a cube, how many are used at each sample, shape (S,)."""
    norms: NDArray[np.float32]
    """What brings the speckle of liver without attenuation to a mean square of 1 at each sample, shape (S,)."""
    kernels: NDArray[np.float32]
    counts: NDArray[np.int64]
    pulse: NDArray[np.float32]
    phases: NDArray[np.float32]
    weights: NDArray[np.float32]
    angles_rad: NDArray[np.float64]
    noise: NDArray[np.float32]
    """White noise that the pulse brings to the level of the settings, shape (N_NOISE,)."""
    gains: NDArray[np.float32]
    """Time-gain compensation at each sample, shape (S,)."""

    @classmethod
    def of(cls, array: ConvexArray, settings: Settings) -> Tables:
        """The tables of an array and its settings."""
        angles_rad = array.angles_rad
        directions = np.column_stack([np.sin(angles_rad), np.zeros_like(angles_rad), np.cos(angles_rad)])
        starts_m = array.points_m(np.arange(array.n_lines), np.zeros(array.n_lines))
        slice_fwhm_m = beam.slice_fwhm_m(array, array.depths_m)
        slices_m = beam.SLICE_SIGMAS / beam.FWHM_PER_SIGMA * slice_fwhm_m
        ends_m = np.concatenate(
            [starts_m, array.points_m(np.arange(array.n_lines), np.full(array.n_lines, array.n_samples))]
        )
        thick_m = np.array([0.0, slices_m.max(), 0.0])
        cell_m2 = slice_fwhm_m * beam.lateral_fwhm_m(array, array.depths_m)
        keeps = N_PER_CUBE * cell_m2.min() / cell_m2
        cell_m3 = float(cell_m2.min()) * beam.pulse_fwhm_m(array)
        cube_m = (cell_m3 * N_PER_CUBE / settings.scatterers_per_cell) ** (1.0 / 3.0)
        kernels, counts = beam.lateral_kernels(array)
        pulse = beam.axial_kernel(array)
        turns = 2.0 * np.pi * (np.arange(N_PHASES) + 0.5) / N_PHASES
        share = (np.arange(N_WEIGHTS) + 0.5) / N_WEIGHTS
        weights = np.exp(-0.5 * beam.SLICE_SIGMAS**2 * share)
        pulse_energy = float((pulse.astype(np.float64) ** 2).sum())
        tgc_db = settings.tgc_db_cm_mhz * 2.0 * array.depths_m * 100.0 * array.frequency_hz * 1e-6
        return cls(
            starts_m=starts_m,
            directions=directions,
            corners_m=np.concatenate([ends_m - thick_m, ends_m + thick_m]),
            slices_m=slices_m,
            cube_m=cube_m,
            keeps=keeps,
            norms=_norms(array, slices_m, keeps / cube_m**3, kernels, weights, pulse_energy),
            kernels=kernels,
            counts=counts,
            pulse=pulse,
            phases=np.column_stack([np.cos(turns), np.sin(turns)]).astype(np.float32),
            weights=weights.astype(np.float32),
            angles_rad=np.append(np.arcsin(np.linspace(-1.0, 1.0, N_ANGLES + 1)), np.pi / 2.0),
            noise=_noise(10.0 ** (settings.noise_db / 20.0) / math.sqrt(2.0 * pulse_energy)),
            gains=10.0 ** (np.minimum(tgc_db, MOST_TGC_DB) / 20.0).astype(np.float32),
        )


def _noise(deviation: float) -> NDArray[np.float32]:
    """White noise of a standard deviation, always the same, shape (N_NOISE,)."""
    return np.random.default_rng(0).standard_normal(N_NOISE, dtype=np.float32) * np.float32(deviation)


def _norms(
    array: ConvexArray,
    slices_m: NDArray[np.float64],
    density_m3: NDArray[np.float64],
    kernels: NDArray[np.float32],
    weights: NDArray[np.float64],
    pulse_energy: float,
) -> NDArray[np.float32]:
    """What brings liver's speckle to a mean square of 1: the mean energy of the scatterers of each sample's cell.

    A sample of one line, of area dr (R + r) dtheta, holds n of them per unit of the slice's thickness. Each adds the
    square of the slice's profile, of the beam's on the lines (of which the place between two lines is a part), and of
    the pulse's.
    """
    # Even in the distance from the plane: the profile over the square of it, integrated over the distance.
    distance = np.linspace(0.0, 1.0, 2001)[:-1]
    profile = weights[(distance**2 * N_WEIGHTS).astype(int)]
    slice_energy_m = 2.0 * slices_m * float((profile**2).mean())
    full = np.concatenate([kernels[:, :0:-1], kernels], axis=1).astype(np.float64)
    pad = np.pad(full, ((0, 0), (0, 1)))
    part = (np.arange(16) + 0.5) / 16
    between = (1.0 - part)[:, None, None] * pad + part[:, None, None] * np.roll(pad, 1, axis=1)
    beam_energy = (between**2).sum(axis=2).mean(axis=0)
    cell_m2 = array.sample_m * (array.radius_m + array.depths_m) * array.line_rad
    energy = density_m3 * cell_m2 * slice_energy_m * beam_energy * pulse_energy
    return (1.0 / np.sqrt(energy)).astype(np.float32)
