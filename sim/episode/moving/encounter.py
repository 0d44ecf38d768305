"""Where and when a probe that comes down meets an organ that is not where it was planned, and may breathe and yield."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.body.contact import way_to_contact_m
from sim.world.body.true_place import TruePlace
from sim.world.errors import TissueError
from sim.world.frames import rigid_inverse
from sim.world.ik.settings import IkSettings
from sim.world.sensing.sensor import SceneState
from sim.world.tissue.indentation import Indentation

from ..yielding import Pressed, YieldingOrgan
from .motion import Motion

Array = NDArray[np.float64]

_MOST_ROUNDS, _SAME_S = 10, 1e-3
"""Most rounds in which the time of contact is found, and by how much the last one may change it [s]."""


class Encounter:
    """The procedure's clock, and the contact of the probe with the organ where that is by then."""

    def __init__(
        self,
        place: TruePlace,
        planned: SceneState,
        believed: Callable[[float], Array],
        yielding: YieldingOrgan | None,
        *,
        speed_m_s: float,
        face_m: float,
    ) -> None:
        """Begin a procedure at time 0.

        Args:
            place: Where the organ truly is.
            planned: The scene as it was planned; follows the probe.
            believed: Where the organ is believed to be, as the map from the rest frame to the world (4, 4), with a
                share of a full breath in it.
            yielding: How the organ yields; None where it is rigid.
            speed_m_s: How fast the probe comes down [m/s].
            face_m: Radius of the face that meets the organ [m]; 0 of one that presses until it lies flat.
        """
        self.place, self.believed, self.yielding = place, believed, yielding
        self._planned, self._speed_m_s, self._face_m = planned, speed_m_s, face_m
        self._above_m = IkSettings().standoff_m
        self.indentation: Indentation | None = None
        """How the organ yields under the probe now; None where it does not."""
        self.pressed = Pressed()
        """The force on the tip now, where it is simulated."""
        self.time_s = 0.0
        """Time of the procedure until now [s]."""
        self.sensed_s = 0.0
        """Time at which the probe senses [s]."""
        self._began_s = 0.0

    def find_contact(
        self, data: mujoco.MjData, T_planned: Array, motion_s: float
    ) -> tuple[Array | str, float]:
        """Where the tip meets the organ when it is sent to where a pose is believed to lie; see `ContactMotion`."""
        self.time_s += motion_s
        T_contact, down_s, wait_s = T_planned, 0.0, 0.0
        # The organ goes on breathing while the probe comes down to it.
        for _ in range(_MOST_ROUNDS):
            wait_s = self.place.wait_s(self.time_s + down_s)
            self.sensed_s = self.time_s + down_s + wait_s
            T_contact = self._contact(data, T_planned)
            if isinstance(T_contact, str):
                return T_contact, 0.0
            way_m = float(np.linalg.norm(T_contact[:3, 3] - T_planned[:3, 3]))
            before_s, down_s = down_s, way_m / self._speed_m_s
            if abs(down_s - before_s) < _SAME_S:
                break
        return T_contact, wait_s

    def _contact(self, data: mujoco.MjData, T_planned: Array) -> Array | str:
        """Where the tip that is sent to a planned pose stops at the time of sensing, or why it does not."""
        search_m = self.place.settings.contact_search_m
        T_sent = self.believed(self.place.inhaled_share(self.sensed_s)) @ T_planned
        T_rest_world = rigid_inverse(self.T_world_rest)
        way_m = way_to_contact_m(
            self._planned.rays,
            data,
            T_rest_world @ T_sent,
            above_m=self._above_m,
            search_m=search_m,
            face_radius_m=self._face_m,
        )
        if way_m is None:
            return (
                f"The probe met no organ from {self._above_m * 1e3:g} mm above to {search_m * 1e3:g} mm below where "
                "its surface was expected."
            )
        T_contact = T_sent.copy()
        T_contact[:3, 3] += way_m * T_sent[:3, 2]
        if self.yielding is not None:
            try:
                self.indentation = self.yielding.press(T_rest_world @ T_contact)
            except TissueError as error:
                return f"The organ does not yield to the probe there: {error}."
            T_contact[:3, 3] += self.indentation.depth_m * T_sent[:3, 2]
        return T_contact

    @property
    def T_world_rest(self) -> Array:
        """Where the organ is at the time of sensing, as the map from the rest frame to the world, shape (4, 4)."""
        return self.place.T_world_rest(self.sensed_s)

    def places_during(self, motion: Motion) -> Array:
        """Where the organ was at each state of the motion to the present contact, likewise, shape (S, 4, 4).

        Args:
            motion: The motion, at whose end the probe senses.
        """
        begin_s = self.sensed_s - motion.motion_s
        return np.array([self.place.T_world_rest(begin_s + at_s) for at_s in motion.time_s])

    def state(self) -> SceneState:
        """The scene with the organ where it is at the time of sensing, before the probe presses."""
        T_rest_world = rigid_inverse(self.T_world_rest)
        if self.indentation is None:
            return self._planned.seen_from(T_rest_world)
        T_rest_tip = T_rest_world @ self._planned.T_world_probe
        T_rest_world[:3, 3] -= self.indentation.depth_m * T_rest_tip[:3, 2]
        return self._planned.seen_from(T_rest_world)

    def end_action(self, procedure_s: float) -> None:
        """Set the clock to the end of an action.

        Args:
            procedure_s: How long it took, with the ways to poses that were missed [s].
        """
        self._began_s += procedure_s
        self.time_s = self._began_s
