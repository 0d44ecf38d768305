"""The organ that a probe presses on: as it was planned, or where it truly is and as it truly yields."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.world.motion.beam_contact import MovingOrgan

from ..yielding import Pressed
from .encounter import Encounter

Array = NDArray[np.float64]


class OrganUnderProbe(MovingOrgan, Protocol):
    """What a motion model has to know of the organ that it presses on, and whom it tells how that went."""

    force_n: float
    """Force that the probe is to press with [N]."""
    search_m: float
    """How far below where it is expected the organ is looked for [m]."""

    @property
    def time_s(self) -> float:
        """Time of the procedure now [s]."""
        ...

    def T_world_rest_believed(self, time_s: float) -> Array:
        """Where it is believed to lie at a time, as the map from where it was planned, shape (4, 4)."""
        ...

    def wait_s(self, time_s: float) -> float:
        """How long a probe waits at a time until it may sense [s]."""
        ...

    def moved(self, seconds: float) -> None:
        """Note that a motion took so long."""
        ...

    def pressed(self, T_rest_touch: Array, force_n: float, stiffness_n_m: float) -> None:
        """Note that the motion that is over now ended in contact.

        Args:
            T_rest_touch: Where the beam crosses the organ's surface at rest, rest frame, shape (4, 4).
            force_n: The force on the tip [N].
            stiffness_n_m: The spring under it [N/m].
        """
        ...


class PlannedOrgan(OrganUnderProbe):
    """An organ that lies still where it was planned, under a spring that is the same everywhere."""

    def __init__(self, stiffness_n_m: float, force_n: float, search_m: float) -> None:
        """Press on a spring of so many N/m with a force."""
        self._stiffness_n_m = stiffness_n_m
        self.force_n, self.search_m = force_n, search_m

    @property
    def time_s(self) -> float:
        """See `OrganUnderProbe.time_s`: nothing changes with it."""
        return 0.0

    @property
    def is_moving(self) -> bool:
        """See `MovingOrgan.is_moving`."""
        return False

    def T_world_rest(self, time_s: float) -> Array:
        """See `MovingOrgan.T_world_rest`."""
        del time_s
        return np.eye(4)

    def T_world_rest_believed(self, time_s: float) -> Array:
        """See `OrganUnderProbe.T_world_rest_believed`."""
        del time_s
        return np.eye(4)

    def stiffness_n_m(self, T_rest_touch: Array) -> float:
        """See `MovingOrgan.stiffness_n_m`."""
        del T_rest_touch
        return self._stiffness_n_m

    def wait_s(self, time_s: float) -> float:
        """See `OrganUnderProbe.wait_s`: never."""
        del time_s
        return 0.0

    def moved(self, seconds: float) -> None:
        """See `OrganUnderProbe.moved`."""

    def pressed(self, T_rest_touch: Array, force_n: float, stiffness_n_m: float) -> None:
        """See `OrganUnderProbe.pressed`."""


class BodyUnderProbe(OrganUnderProbe):
    """The organ of an episode, which need not be where it was planned, breathes and yields."""

    def __init__(self, body: Encounter, stiffness_n_m: float, force_n: float) -> None:
        """Press on a body.

        Args:
            body: Where it lies and how it yields, and who is told of contacts.
            stiffness_n_m: The spring under the tip where the body is rigid [N/m].
            force_n: Force to press with where it is [N]; tissue that yields has its own.
        """
        self._body, self._stiffness_n_m = body, stiffness_n_m
        self.search_m = body.place.settings.contact_search_m
        self.force_n = force_n if body.yielding is None else body.yielding.press_n

    @property
    def is_moving(self) -> bool:
        """See `MovingOrgan.is_moving`."""
        return self._body.place.settings.breathing_m > 0.0

    @property
    def time_s(self) -> float:
        """See `OrganUnderProbe.time_s`."""
        return self._body.time_s

    def T_world_rest(self, time_s: float) -> Array:
        """See `MovingOrgan.T_world_rest`."""
        return self._body.place.T_world_rest(time_s)

    def T_world_rest_believed(self, time_s: float) -> Array:
        """See `OrganUnderProbe.T_world_rest_believed`."""
        return self._body.believed(self._body.place.inhaled_share(time_s))

    def wait_s(self, time_s: float) -> float:
        """See `OrganUnderProbe.wait_s`."""
        return self._body.place.wait_s(time_s)

    def stiffness_n_m(self, T_rest_touch: Array) -> float:
        """See `MovingOrgan.stiffness_n_m`: that of the tissue at that place, where it yields."""
        if self._body.yielding is None:
            return self._stiffness_n_m
        return 1.0 / self._body.yielding.press(T_rest_touch).compliance_m_per_n

    def moved(self, seconds: float) -> None:
        """See `OrganUnderProbe.moved`."""
        self._body.time_s += seconds

    def pressed(self, T_rest_touch: Array, force_n: float, stiffness_n_m: float) -> None:
        """See `OrganUnderProbe.pressed`."""
        body = self._body
        body.sensed_s = body.time_s
        is_rigid = body.yielding is None
        body.pressed = Pressed(force_n, force_n / stiffness_n_m if is_rigid else 0.0)
        if body.yielding is not None:
            body.indentation = body.yielding.press(T_rest_touch, force_n)
