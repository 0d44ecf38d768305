"""The B-mode image of one plane, from the tissue about it to the pixels.

lines through the tissue -> echoes of boundaries and scatterers -> beam -> noise -> pulse -> gain -> log -> fan
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .convex_array import ConvexArray
from .display import Fan, compress, draw_fan, make_fan, spread_across, spread_along
from .label_grid import LabelGrid
from .scattering import FACTORS, SHIFTS, gather_scatterers
from .settings import Settings
from .tables import N_NOISE, Tables
from .tissues import TISSUES
from .tracing import trace_lines

SPECKLE_DB = -50.0
"""Level of liver's speckle against the echo of a perfect mirror [dB]; a boundary of fat and liver then stands 29 dB
above the speckle, and one of blood and liver 12 dB, where they are met at a right angle."""
WHITE_DB = 30.0
"""How far above liver's mean speckle white is at a gain of 0 [dB]."""


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
    settings: Settings = field(default_factory=Settings)

    @cached_property
    def fan(self) -> Fan:
        """The table of the scan conversion."""
        return make_fan(self.array, self.settings.n_pixels)

    @cached_property
    def _tables(self) -> Tables:
        return Tables.of(self.array, self.settings)

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
        T_cube_plane[:3] /= tables.cube_m
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
