"""An organ that yields under the probe: how it truly does, and what is believed of it when readings are taken back."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.world.body.contact import face_at_m
from sim.world.errors import TissueError
from sim.world.frames import rigid_inverse
from sim.world.motion.settings import FACE_M
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance, surface_distance_of
from sim.world.tissue.contact import MOST_STRAIN
from sim.world.tissue.elastic_organ import build_elastic_organ
from sim.world.tissue.indentation import Indentation
from sim.world.tissue.settings import ElasticSettings

from .positioner import ArmPositioner
from .setup import Setup

Array = NDArray[np.float64]

_STEPS_BACK, _THERE_M = 20, 1e-5
"""Most steps back along the beam to the surface, each as long as the distance from it, and how near is near enough [m].
"""
STALE_M, _LEVER_M = 0.001, 0.03
"""A press is released anew when, as it is believed, the tip or what lies so deep below it has moved by so much within
the organ [m]: the depth changes slowly from place to place, by about as much as one in ten of a move."""
_TOUCHED_M = 0.0005
"""Where the surface and the force tell a place of first touch that differ by less [m], the press is not asked again."""


@dataclass(frozen=True, eq=False)
class _Release:
    """What a press did, as it is believed, in the frame of the tip."""

    T_rest_tip: Array
    """Where the tip was believed to be when this was worked out, shape (4, 4)."""
    back_m: Array
    """The way of each point back to where it lay [m], shape (N, 3)."""
    depth_m: float
    """How deep the tip was."""

    def is_stale(self, T_rest_tip: Array, stale_m: float) -> bool:
        """Whether the tip is believed to be elsewhere by now."""
        difference = T_rest_tip - self.T_rest_tip
        ends_m = np.stack([difference[:3, 3], difference[:3, 3] + _LEVER_M * difference[:3, 2]])
        return bool(np.linalg.norm(ends_m, axis=1).max() > stale_m)


@dataclass(frozen=True)
class Pressed:
    """The force on the tip at the time of sensing."""

    force_n: float | None = None
    """[N]; None where it is not simulated."""
    dent_m: float = 0.0
    """How far a rigid organ's spring has given way to it [m]."""


@dataclass(eq=False)
class RawReading:
    """A reading as it was measured."""

    T_world_probe: Array
    """Where the tip was measured, shape (4, 4)."""
    points_m: Array
    """Where its points were, world frame [m], shape (N, 3)."""
    share: float
    """How much of a full breath was in the organ."""
    pressed: Pressed = field(default_factory=Pressed)
    """The force on the tip, as far as it is measured."""
    _release: _Release | None = None

    def released(
        self, organ: YieldingOrgan, T_world_rest: Array, *, stale_m: float = STALE_M
    ) -> tuple[Array, Array, float]:
        """Points and tip where, by what is believed, they lay before the probe pressed, world frame; and its depth.

        Args:
            organ: The organ that yielded.
            T_world_rest: Where it is believed to have lain, shape (4, 4).
            stale_m: By how much it has to be believed elsewhere than before for this to be worked out again [m].
        """
        T_tip, T_rest_world = self.T_world_probe, rigid_inverse(T_world_rest)
        T_rest_tip, before = T_rest_world @ T_tip, self._release
        if before is None or before.is_stale(T_rest_tip, stale_m):
            points_m = self.points_m @ T_rest_world[:3, :3].T + T_rest_world[:3, 3]
            known_m = None if before is None else before.depth_m
            force_n = self.pressed.force_n
            freed_m, depth_m = organ.undone(T_rest_tip, points_m, force_n=force_n, depth_m=known_m)
            self._release = before = _Release(T_rest_tip, (freed_m - points_m) @ T_rest_tip[:3, :3], depth_m)
        tip_m = T_tip[:3, 3] - before.depth_m * T_tip[:3, 2]
        return self.points_m + before.back_m @ T_tip[:3, :3].T, tip_m, before.depth_m

    def touching_m(self, face_m: float, T_world_rest: Array, surface: SurfaceDistance) -> Array:
        """The point of the face that touched, by what is believed: that nearest to the surface [m], shape (3,).

        A face that comes down on a rigid organ until it touches is nowhere inside it. So at the true place the least of
        its points' signed distances is 0, and the contact of that point with the surface is as good as any other.

        Args:
            face_m: Radius of the face [m].
            T_world_rest: Where the organ is believed to lie, shape (4, 4).
            surface: Distances to the surface of the organ at rest.
        """
        points_m = face_at_m(self.T_world_probe, face_m)
        rest_m = (points_m - T_world_rest[:3, 3]) @ T_world_rest[:3, :3]
        return points_m[np.argmin(surface.signed_distance_m(rest_m))]


def face_radius_m(setup: Setup) -> float:
    """Radius of the disc that is as large as the probe's face [m]."""
    positioner = setup.positioner
    is_arm = isinstance(positioner, ArmPositioner)
    return positioner.search.clearance.probe.face_radius_m if is_arm else FACE_M


class YieldingOrgan:
    """The elastic organ of an episode, and the model of it that knows no tumours."""

    def __init__(
        self, setup: Setup, tumours: Sequence[Solid], tissue: ElasticSettings, press_n: float
    ) -> None:
        """Build both models.

        Args:
            setup: Gives the organ at rest and the probe's face.
            tumours: The true tumours, which are stiffer; those who believe do not know of them.
            tissue: What both are made of.
            press_n: Force at which the probe stops [N].

        Raises:
            TissueError: The organ cannot be modelled, or the force is beyond what tissue bears.
        """
        self.press_n = press_n
        self._true = build_elastic_organ(setup.organ, tumours=tumours, tissue=tissue)
        self._believed = build_elastic_organ(setup.organ, tissue=tissue)
        self._surface = surface_distance_of(setup.organ)
        self._face_m = face_radius_m(setup)
        most_n = MOST_STRAIN * 2.0 * np.pi * tissue.contact_modulus_pa * self._face_m**2
        if press_n > most_n:
            raise TissueError(
                f"`press_n` of {press_n:g} N is beyond linear elasticity under a face of {self._face_m * 1e3:g} mm "
                f"radius: press with at most {most_n:.2g} N, or make the tissue stiffer by `young_kpa`"
            )

    def press(self, T_rest_tip: Array, force_n: float | None = None) -> Indentation:
        """How the organ truly yields where the probe presses.

        Args:
            T_rest_tip: Where the tip first touches, rest frame, shape (4, 4).
            force_n: The force [N]; None for that at which the probe stops.

        Raises:
            TissueError: The probe stands too aslant, or presses deeper than linear elasticity goes.
        """
        force_n = self.press_n if force_n is None else force_n
        return self._true.press(
            T_rest_tip[:3, 3], T_rest_tip[:3, 2], force_n=force_n, face_radius_m=self._face_m
        )

    def undone(
        self,
        T_rest_tip: Array,
        points_m: Array,
        *,
        force_n: float | None = None,
        depth_m: float | None = None,
    ) -> tuple[Array, float]:
        """Where points lay before the probe pressed, as it is believed, and how deep the tip is believed to be.

        The tip first touched where its beam crosses the surface at rest, or nearer to where the organ's depth under the
        force puts it. Where the organ's model has no answer, points stay, and the depth is that of a half-space.

        Args:
            T_rest_tip: Where the tip that presses is believed to be, rest frame, shape (4, 4).
            points_m: Points that were read, likewise [m], shape (N, 3).
            force_n: The force that was measured [N]; None for that at which the probe stops.
            depth_m: How deep the tip was believed to be when it was believed to be near there; None for a new press.

        Returns:
            Points [m], shape (N, 3), and the depth [m].
        """
        beam, force_n = T_rest_tip[:3, 2], self.press_n if force_n is None else force_n
        try:
            found = None
            if depth_m is None:
                touched_m = self._touched_m(T_rest_tip)
                found = self._pressed(touched_m, beam, force_n)
                depth_m = found.depth_m
                if np.linalg.norm(T_rest_tip[:3, 3] - depth_m * beam - touched_m) < _TOUCHED_M:
                    return found.rest_of(points_m), depth_m
            with suppress(TissueError):
                # The force tells the depth better than the surface, where the belief of the place is good.
                found = self._pressed(T_rest_tip[:3, 3] - depth_m * beam, beam, force_n)
            found = found or self._pressed(self._touched_m(T_rest_tip), beam, force_n)
            return found.rest_of(points_m), found.depth_m
        except TissueError:
            return points_m, force_n / (2.0 * self._believed.tissue.contact_modulus_pa * self._face_m)

    def _touched_m(self, T_rest_tip: Array) -> Array:
        """Where a tip that presses first touched: back along the beam, where the surface at rest is."""
        touched_m = T_rest_tip[:3, 3].copy()
        for _ in range(_STEPS_BACK):
            distance_m = self._surface.signed_distance_m(touched_m[None])[0]
            touched_m += distance_m * T_rest_tip[:3, 2]
            if abs(distance_m) < _THERE_M:
                break
        return touched_m

    def _pressed(self, touched_m: Array, beam: Array, force_n: float) -> Indentation:
        return self._believed.press(touched_m, beam, force_n=force_n, face_radius_m=self._face_m)
