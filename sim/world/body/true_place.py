"""The true place of an organ: drawn by a seed, and moved by each breath."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.errors import FieldError

from .breathing import inhaled_share, wait_for_rest_s
from .settings import BodySettings


class TruePlace:
    """Where an organ truly is at any time."""

    def __init__(
        self, settings: BodySettings, middle_m: NDArray[np.float64], rng: np.random.Generator
    ) -> None:
        """Draw by how much the plan is wrong.

        Args:
            settings: How far the true world is from the planned one.
            middle_m: The middle of the organ, about which it is turned, rest frame [m], shape (3,).
            rng: Draws direction and axis, in streams of their own.

        Raises:
            FieldError: The table's top, z = 0, which the organ was planned above, would be above its middle.
        """
        self.settings = settings
        way_rng, turn_rng = rng.spawn(2)
        R = Rotation.from_rotvec(settings.registration_rad * _direction(turn_rng)).as_matrix()
        self._T_world_rest = np.eye(4)
        self._T_world_rest[:3, :3] = R
        self._T_world_rest[:3, 3] = middle_m - R @ middle_m + settings.registration_m * _direction(way_rng)
        axis = np.asarray(settings.breathing_axis, dtype=np.float64)
        self._inhaled_m = settings.breathing_m * axis / np.linalg.norm(axis)
        self._check_above_table(middle_m)

    def _check_above_table(self, middle_m: NDArray[np.float64]) -> None:
        """Check that the organ is not put through the table.

        Raises:
            FieldError: Its middle is.
        """
        settings = self.settings
        registered_m = float((self._T_world_rest[:3, :3] @ middle_m + self._T_world_rest[:3, 3])[2])
        breathed_m = registered_m + min(float(self._inhaled_m[2]), 0.0)
        if breathed_m >= 0.0 or middle_m[2] < 0.0:
            return
        name, value_m = "registration_mm", settings.registration_m
        if registered_m >= 0.0:
            name, value_m = "breathing_mm", settings.breathing_m
        raise FieldError(
            name,
            float(f"{1e3 * value_m:.6g}"),
            f"puts the organ through the table: its middle, planned {1e3 * middle_m[2]:.0f} mm above the table's top, "
            f"comes to lie {-1e3 * breathed_m:.0f} mm below it. Move the organ by less, or choose another seed.",
        )

    def T_world_rest(self, time_s: float) -> NDArray[np.float64]:
        """Maps the rest frame to where the organ truly is, shape (4, 4).

        Args:
            time_s: Time since the procedure began [s].
        """
        T_world_rest = self._T_world_rest.copy()
        T_world_rest[:3, 3] += self.inhaled_share(time_s) * self._inhaled_m
        return T_world_rest

    def inhaled_share(self, time_s: float) -> float:
        """How far the organ is on its way to full inhale, from 0 to 1; 0 of an organ that does not breathe."""
        if self.settings.breathing_m == 0.0:
            return 0.0
        return inhaled_share(time_s, self.settings.breathing_s)

    def wait_s(self, time_s: float) -> float:
        """How long the probe waits before it senses [s], which only a gated one does."""
        if not self.settings.is_gated or self.settings.breathing_m == 0.0:
            return 0.0
        return wait_for_rest_s(time_s, self.settings.breathing_s)


def measured(
    T_world_probe: NDArray[np.float64], settings: BodySettings, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Where the tip is measured to be, shape (4, 4): about where it is, in place and turn.

    Args:
        T_world_probe: Where the tip is, shape (4, 4).
        settings: Gives the standard deviations.
        rng: Draws both errors, whatever their sizes.
    """
    shift_m = settings.tracking_m * rng.standard_normal(3)
    turn = Rotation.from_rotvec(settings.tracking_rad * rng.standard_normal(3))
    T = T_world_probe.copy()
    T[:3, :3] = turn.as_matrix() @ T[:3, :3]
    T[:3, 3] += shift_m
    return T


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """A direction, all being equally likely, shape (3,)."""
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)
