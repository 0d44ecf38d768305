"""The B-mode image of one plane, from the tissue about it to the pixels.

lines through the tissue -> echoes of boundaries and scatterers -> beam -> noise -> pulse -> gain -> log -> fan
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.errors import FieldError

from . import beam
from .convex_array import ConvexArray
from .display import compress, draw_fan, spread_across, spread_along
from .fan import Fan, make_fan
from .label_grid import LabelGrid
from .scattering import FACTORS, N_ANGLES, N_PER_CUBE, N_PHASES, N_WEIGHTS, SHIFTS, gather_scatterers
from .tissues import TISSUES
from .tracing import trace_lines

SPECKLE_DB = -50.0
"""Level of liver's speckle against the echo of a perfect mirror [dB]; a boundary of fat and liver then stands 29 dB
above the speckle, and one of blood and liver 12 dB, where they are met at a right angle."""
WHITE_DB = 30.0
"""How far above liver's mean speckle white is at a gain of 0 [dB]."""
N_NOISE = 1 << 20
"""Length of the table of noise."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the machine is set to, and how finely the tissue is strewn with scatterers."""

    gain_db: float = 0.0
    """Gain of all depths [dB]."""
    tgc_db_cm_mhz: float = 0.5
    """Attenuation that the time-gain compensation makes up for [dB/cm/MHz]; that of liver by default."""
    range_db: float = 60.0
    """Dynamic range: how far below white black begins [dB]."""
    noise_db: float = -65.0
    """The receiver's noise against liver's speckle at the face [dB], which the compensation raises with depth."""
    contact_gap_m: float = 0.010
    """Widest gap between the face and the organ [m], which gel and the soft organ fill; beyond it a line is dark."""
    scatterer_spacing_m: float = 0.00055
    """Distance of scatterers, of which the cube of this edge holds one in the mean [m]."""
    tissue_seed: int = 0
    """Which scatterers the tissue has."""
    n_pixels: int = 512
    """Pixels along each edge of the picture."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        if not 10.0 <= self.range_db <= 200.0:
            raise FieldError("dynamic_range_db", self.range_db, "must be from 10 to 200.")
        if not 0.0 <= self.tgc_db_cm_mhz <= 10.0:
            raise FieldError("tgc_db_cm_mhz", self.tgc_db_cm_mhz, "must be from 0 to 10.")
        if not 0.0001 <= self.scatterer_spacing_m <= 0.005:
            raise FieldError("scatterer_spacing_mm", self.scatterer_spacing_m * 1e3, "must be from 0.1 to 5.")

    @property
    def cube_m(self) -> float:
        """Edge of the cubes that hold `N_PER_CUBE` scatterers each [m]."""
        return self.scatterer_spacing_m * N_PER_CUBE ** (1.0 / 3.0)


@dataclass(frozen=True, eq=False)
class Plane:
    """The image of one plane."""

    image: NDArray[np.uint8]
    """The picture, face on top, shape (n_pixels, n_pixels)."""
    left: NDArray[np.float32]
    """Amplitude of what a perfect mirror would send back from each sample, 1 at the face; 0 where contact is lost,
    shape (n_samples, n_lines)."""
    received: NDArray[np.float32]
    """Echoes in phase and in quadrature before compensation, of which liver's speckle at the face has a mean square of
    1, shape (n_samples, n_lines, 2)."""

    @property
    def envelope(self) -> NDArray[np.float32]:
        """Amplitude of the echoes before compensation, shape (n_samples, n_lines)."""
        return np.hypot(self.received[..., 0], self.received[..., 1])


@dataclass(frozen=True, eq=False)
class Imager:
    """Draws planes of an array. It keeps tables only: the same plane of the same tissue gives the same image."""

    array: ConvexArray
    settings: Settings = Settings()

    @cached_property
    def fan(self) -> Fan:
        """The table of the scan conversion."""
        return make_fan(self.array, self.settings.n_pixels)

    @cached_property
    def _tables(self) -> _Tables:
        return _Tables.of(self.array, self.settings)

    @property
    def gains(self) -> NDArray[np.float32]:
        """The time-gain compensation at each sample, as a factor of the amplitude, shape (n_samples,)."""
        return self._tables.gains

    def plane(self, grid: LabelGrid, T_grid_plane: NDArray[np.float64], noise_seed: int = 0) -> Plane:
        """The image of a plane.

        Args:
            grid: The tissue.
            T_grid_plane: Maps the plane's coordinates to those of the tissue, shape (4, 4).
            noise_seed: Which noise of the receiver.
        """
        signal, left, strength = self.trace(grid, T_grid_plane)
        self.scatter(T_grid_plane, strength, signal)
        received = self.receive(signal, noise_seed)
        return Plane(self.draw(received), left, received)

    def trace(
        self, grid: LabelGrid, T_grid_plane: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """What the lines run through: echoes of boundaries, what is left, and the strength of speckle.

        The echoes have shape (n_samples, n_lines, 2), the others (n_samples, n_lines). All are amplitudes, of which 1
        is that of liver's speckle at the face, and for what is left that of the pulse there.
        """
        array, tables = self.array, self._tables
        left, strength = np.empty((2, array.n_samples, array.n_lines), np.float32)
        signal = np.empty((array.n_samples, array.n_lines, 2), np.float32)
        starts_m = tables.starts_m @ T_grid_plane[:3, :3].T + T_grid_plane[:3, 3]
        tissues = (*grid.tissues, TISSUES["gel"])
        losses_db = [2.0 * tissue.attenuation_db_m(array.frequency_hz) * array.sample_m for tissue in tissues]
        trace_lines(
            grid.cells,
            grid.rooms,
            grid.labels,
            grid.margins,
            (starts_m - grid.origin_m) / grid.spacing_m,
            np.ascontiguousarray(tables.directions @ T_grid_plane[:3, :3].T),
            array.sample_m / grid.spacing_m,
            np.array([tissue.impedance_mrayl for tissue in tissues]),
            10.0 ** (-np.array(losses_db) / 20.0),
            10.0 ** (np.array([tissue.backscatter_db for tissue in tissues]) / 20.0),
            10.0 ** (-SPECKLE_DB / 20.0),
            math.ceil(self.settings.contact_gap_m / array.sample_m),
            signal,
            left,
            strength,
        )
        return signal, left, strength

    def scatter(
        self,
        T_grid_plane: NDArray[np.float64],
        strength: NDArray[np.float32],
        signal: NDArray[np.float32],
    ) -> None:
        """Adds the scatterers' echoes to a signal, before beam and pulse.

        Args:
            T_grid_plane: Maps the plane's coordinates to those of the tissue, shape (4, 4).
            strength: Amplitude of the speckle, shape (n_samples, n_lines).
            signal: Added to, shape (n_samples, n_lines, 2).
        """
        array, tables = self.array, self._tables
        T_cube_plane = T_grid_plane.copy()
        T_cube_plane[:3] /= self.settings.cube_m
        steepest = int(np.argmax(np.abs(T_grid_plane[:3, 1])))
        order = [(steepest + 1) % 3, (steepest + 2) % 3, steepest]
        corners = (tables.corners_m @ T_cube_plane[:3, :3].T + T_cube_plane[:3, 3])[:, order[:2]]
        box = np.stack([np.floor(corners.min(axis=0)) - 1, np.ceil(corners.max(axis=0)) + 1], axis=1)
        cycles = 2.0 / array.wavelength_m
        gather_scatterers(
            np.ascontiguousarray(np.linalg.inv(T_cube_plane)[:3][:, [*order, 3]], dtype=np.float64),
            box.astype(np.int64),
            FACTORS[order],
            SHIFTS[order],
            np.array([array.radius_m, array.sample_m, array.line_rad, array.half_angle_rad, cycles]),
            tables.slices_m,
            tables.keeps,
            tables.phases,
            tables.weights,
            tables.angles_rad,
            tables.norms,
            strength,
            self.settings.tissue_seed,
            signal,
        )

    def receive(self, signal: NDArray[np.float32], noise_seed: int) -> NDArray[np.float32]:
        """Echoes with the beam, the noise and the pulse laid over them; the signal is changed."""
        tables, flat = self._tables, signal.reshape(len(signal), -1)
        received = np.empty_like(flat)
        spread_across(flat, tables.kernels, tables.counts, tables.noise, noise_seed * 7919 % N_NOISE)
        spread_along(flat, tables.pulse, received)
        return received.reshape(signal.shape)

    def draw(self, received: NDArray[np.float32]) -> NDArray[np.uint8]:
        """The picture of what was received: compensated, compressed and scan converted."""
        fan = self.fan
        brightness = np.empty(received.shape[:2], np.float32)
        white = 10.0 ** ((WHITE_DB - self.settings.gain_db) / 20.0)
        compress(received, self._tables.gains, white, self.settings.range_db, brightness)
        image = np.zeros(fan.n_pixels**2, np.uint8)
        draw_fan(brightness.ravel(), fan.pixels, fan.corners, fan.parts, image)
        return image.reshape(fan.n_pixels, fan.n_pixels)


@dataclass(frozen=True, eq=False)
class _Tables:
    """What all planes of an array share."""

    starts_m: NDArray[np.float64]
    """First sample of each line in the plane, shape (L, 3)."""
    directions: NDArray[np.float64]
    """Unit vectors of the lines in the plane, shape (L, 3)."""
    corners_m: NDArray[np.float64]
    """Points whose hull holds the slice, in the plane, shape (C, 3)."""
    slices_m: NDArray[np.float64]
    """Half thickness of the slice at each sample, shape (S,)."""
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
    def of(cls, array: ConvexArray, settings: Settings) -> _Tables:
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
        kernels, counts = beam.lateral_kernels(array)
        pulse = beam.axial_kernel(array)
        turns = 2.0 * np.pi * (np.arange(N_PHASES) + 0.5) / N_PHASES
        share = (np.arange(N_WEIGHTS) + 0.5) / N_WEIGHTS
        weights = np.exp(-0.5 * beam.SLICE_SIGMAS**2 * share)
        pulse_energy = float((pulse.astype(np.float64) ** 2).sum())
        noise = np.random.default_rng(0).standard_normal(N_NOISE, dtype=np.float32)
        noise *= 10.0 ** (settings.noise_db / 20.0) / math.sqrt(2.0 * pulse_energy)
        depths_cm_mhz = 2.0 * array.depths_m * 100.0 * array.frequency_hz * 1e-6
        return cls(
            starts_m=starts_m,
            directions=directions,
            corners_m=np.concatenate([ends_m - thick_m, ends_m + thick_m]),
            slices_m=slices_m,
            keeps=keeps,
            norms=_norms(array, settings, slices_m, keeps, kernels, weights, pulse_energy),
            kernels=kernels,
            counts=counts,
            pulse=pulse,
            phases=np.column_stack([np.cos(turns), np.sin(turns)]).astype(np.float32),
            weights=weights.astype(np.float32),
            angles_rad=np.append(np.arcsin(np.linspace(-1.0, 1.0, N_ANGLES + 1)), np.pi / 2.0),
            noise=noise,
            gains=(10.0 ** (settings.tgc_db_cm_mhz * depths_cm_mhz / 20.0)).astype(np.float32),
        )


def _norms(
    array: ConvexArray,
    settings: Settings,
    slices_m: NDArray[np.float64],
    keeps: NDArray[np.float64],
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
    density = keeps / settings.cube_m**3
    energy = density * cell_m2 * slice_energy_m * beam_energy * pulse_energy
    return (1.0 / np.sqrt(energy)).astype(np.float32)
