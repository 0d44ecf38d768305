"""The same array in PyMUST, an independent simulator: linear acoustics of every element, and delay-and-sum.

PyMUST is under the LGPL and is used here only to compare with.
"""

import numpy as np

from sim.world.sensing.ultrasound.convex_array import SPEED_M_S, ConvexArray

PITCH_M, KERF_M = 0.25e-3, 0.025e-3


class MustArray:
    """The part of the face that makes one line, as PyMUST has it; other lines are had by turning the scatterers."""

    def __init__(self, array: ConvexArray) -> None:
        import pymust

        self._pymust, self._array = pymust, array
        param = pymust.utils.Param()
        param.fc, param.fs, param.c = array.frequency_hz, 8.0 * array.frequency_hz, SPEED_M_S
        param.pitch, param.kerf, param.width = PITCH_M, KERF_M, PITCH_M - KERF_M
        param.Nelements, param.radius = round(array.aperture_m / PITCH_M), array.radius_m
        param.TXnow = 0.5
        param.bandwidth, param.height, param.focus = (
            100.0 * array.bandwidth,
            array.height_m,
            array.height_focus_m,
        )
        self._param = param
        self._x_m, self._z_m, *_ = (np.asarray(each).ravel() for each in param.getElementPositions())
        self._tip_m = self._z_m.max()
        to_focus_m = np.hypot(self._x_m, array.focus_m + self._tip_m - self._z_m)
        self._lead_m = to_focus_m.max() - array.focus_m
        self._delays_s = ((to_focus_m.max() - to_focus_m) / SPEED_M_S)[None]

    def echoes(self, places_m, angle_rad: float):
        """The signals of all elements for scatterers in the plane, of which x and z are given; the line is turned."""
        x, z = places_m.T
        radius_m = self._array.radius_m
        range_m, turn = np.hypot(x, z + radius_m), np.arctan2(x, z + radius_m) - angle_rad
        x, z = range_m * np.sin(turn), range_m * np.cos(turn) - radius_m + self._tip_m
        signals, _ = self._pymust.simus(x, z, np.ones_like(x), self._delays_s, self._param)
        return np.asarray(signals)

    def line(self, places_m, angle_rad: float, depths_m):
        """The envelope of a line at depths, received with the aperture that the array has there."""
        signals = self.echoes(places_m, angle_rad)
        base = self._pymust.rf2iq(signals, self._param.fs, self._param.fc)
        times_s = np.arange(len(base)) / self._param.fs
        total = np.zeros(len(depths_m), complex)
        for element in range(base.shape[1]):
            back_m = np.hypot(self._x_m[element], depths_m + self._tip_m - self._z_m[element])
            at_s = (self._lead_m + depths_m + back_m) / SPEED_M_S
            signal = np.interp(at_s, times_s, base[:, element].real) + 1j * np.interp(
                at_s, times_s, base[:, element].imag
            )
            is_open = np.abs(self._x_m[element]) <= 0.5 * depths_m / self._array.f_number
            total += is_open * signal * np.exp(2j * np.pi * self._param.fc * at_s)
        return np.abs(total)
