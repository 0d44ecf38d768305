"""The body of an episode: where the organ truly is, what is believed of that, and the readings taken back to rest."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from mapping import LabelledPoints
from mapping.registration import Contact, Laid, LaidReadings, ReadingShifts, RigidBelief, moved_m
from mapping.registration.laid_readings import MOVED_M, MOVED_SHARE
from planner import PlaceBelief
from sim.world.anatomy.anatomy import Anatomy
from sim.world.body.true_place import TruePlace, measured
from sim.world.frames import rigid_inverse
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor
from sim.world.solids.surface_distance import surface_distance_of
from sim.world.tissue.indentation import Indentation

from .body_options import BodyOptions, BodyScore, expected_place
from .moving.arm_motion import motion_on_body
from .moving.contact_motion import ContactMotion
from .moving.encounter import Encounter
from .moving.motion import Motion, MotionModel
from .planned.checks import checked_reading
from .setup import Setup
from .yielding import STALE_M, RawReading, YieldingOrgan, face_radius_m

SURE = 0.95
"""Probability of the ellipsoid in which the belief says that a tumour lies."""

_EVERY = 20
"""One in so many points of the search space stands for the organ where it is asked how far it is believed to be off."""
_ROUNDS = 3
"""Most times that contacts are released again by the belief that they have changed."""
DEPTH_SHARE = 0.1
"""How far off the depth of a press is, as a standard deviation over the depth: the model of those who believe knows no
tumours, and not quite where it is pressed."""


class Body:
    """The organ of one episode, which need not be where the plan says."""

    def __init__(
        self,
        options: BodyOptions,
        setup: Setup,
        state: SceneState,
        anatomy: Anatomy,
        rng: np.random.Generator,
    ) -> None:
        """Draw where the organ truly is, and begin to believe that it is where it was planned, give or take.

        Args:
            options: How the true world differs from the plan, and what is made of it.
            setup: The plan.
            state: The scene as it was planned.
            anatomy: The truth: tumours are stiffer than the organ, and errors are told at their middles.
            rng: Draws the place and the tip's errors of measurement.
        """
        self.options = options
        middle_m = setup.organ.bounds_m.mean(axis=0)
        place_rng, self._tip_rng = rng.spawn(2)
        self.place = TruePlace(options.settings, middle_m, place_rng)
        self._setup, self._motion = setup, options.motion
        self._planned = state
        self._targets_m = anatomy.tumour_middles_m if anatomy.tumours else middle_m[None]
        self._corners_m = np.array(
            [[setup.organ.bounds_m[i, axis] for axis, i in enumerate(c)] for c in np.ndindex(2, 2, 2)]
        )
        self.yielding: YieldingOrgan | None = None
        if options.tissue is not None:
            self.yielding = YieldingOrgan(setup, anatomy.tumours, options.tissue, options.press_n)
        # A face that presses lies flat, and the force then tells how deep its middle is.
        self._face_m = face_radius_m(setup) if self.yielding is None else 0.0
        self.belief: RigidBelief | None = None
        if options.registration == "contacts":
            surface = surface_distance_of(setup.organ).signed_distance_and_outward
            self.belief = RigidBelief(surface, middle_m, options.prior or expected_place(options.settings))
        self.encounter = Encounter(
            self.place,
            state,
            self.T_world_rest_believed,
            self.yielding,
            speed_m_s=options.motion.approach_speed_m_s,
            face_m=self._face_m,
        )
        self._raw: list[RawReading] = []
        self._contacts_by, self._stale_m = np.eye(4), STALE_M
        self._laid = LaidReadings()
        off_m = options.place_deviation_m(setup.cone.depth_m) if options.aligns_readings else 0.0
        self._shifts = ReadingShifts(off_m) if off_m > 0.0 else None

    def followed_by(self, motion_model: MotionModel) -> MotionModel:
        """A motion model that brings the probe to where the organ is believed to lie, and down to contact."""
        tip_site, positioner = self._setup.scene.tip_site, self._setup.positioner
        return motion_on_body(motion_model, self.encounter) or ContactMotion(
            motion_model, positioner, tip_site, self.encounter.find_contact, self._motion
        )

    @property
    def sensed_s(self) -> float:
        """Time at which the probe senses [s]."""
        return self.encounter.sensed_s

    @property
    def indentation(self) -> Indentation | None:
        """How the organ yields under the probe now; None where it does not."""
        return self.encounter.indentation

    @property
    def T_world_rest(self) -> NDArray[np.float64]:
        """Where the organ is at the time of sensing, as the map from the rest frame to the world, shape (4, 4)."""
        return self.encounter.T_world_rest

    @property
    def T_world_rest_at_exhale(self) -> NDArray[np.float64]:
        """Where the organ is at exhale, likewise."""
        return self.place.T_world_rest(0.5 * self.options.settings.breathing_s)

    @property
    def inhaled_share(self) -> float:
        """How much of a full breath is in it at the time of sensing."""
        return self.place.inhaled_share(self.sensed_s)

    def state(self) -> SceneState:
        """The scene with the organ where it is at the time of sensing, before the probe presses."""
        return self.encounter.state()

    def read(self, sensor: Sensor, rng: np.random.Generator) -> Reading:
        """The reading of the probe where it is now, taken back to rest by what is believed.

        Args:
            sensor: Makes the reading.
            rng: The sensor's stream.
        """
        T_world_probe, share = self._planned.T_world_probe, self.inhaled_share
        T_measured = measured(T_world_probe, self.options.settings, self._tip_rng)
        reading = checked_reading(sensor, self.state(), rng)
        if self.indentation is not None:
            reading = replace(reading, points_m=self.indentation.deformed_m(reading.points_m))
        reading = reading.moved(T_measured @ rigid_inverse(T_world_probe) @ self.T_world_rest)
        self._raw.append(RawReading(T_measured, reading.points_m, share, self.encounter.pressed))
        self._learn()
        points_m, _, _ = self._released(self._raw[-1])
        T = self._T_rest_world()[-1]
        self._laid.add(T)
        return replace(reading, points_m=points_m, T_world_probe=T_measured).moved(T)

    def _learn(self) -> None:
        """Learn from the last contact; how deep each had pressed, or which point touched, follows from the belief."""
        if self.belief is None:
            return
        self.belief.observe(self._contact(self._raw[-1]))
        tips_m = np.array([each.position_m for each in self.belief.contacts])
        self._stale_m = max(STALE_M, MOVED_SHARE * self._deviation_m(tips_m))
        for _ in range(_ROUNDS):
            before = self.T_world_rest_believed(0.0)
            if moved_m(self._corners_m, before - self._contacts_by).max() <= MOVED_M:
                return
            self._contacts_by, told = before, [each.position_m for each in self.belief.contacts]
            contacts = [self._contact(raw) for raw in self._raw]
            if np.array_equal([each.position_m for each in contacts], told):
                return
            self.belief.relearn(contacts, is_near=True)

    def _contact(self, raw: RawReading) -> Contact:
        """Where the tip first met the surface, by what is believed."""
        _, tip_m, depth_m = self._released(raw)
        if raw.pressed.force_n is None and self._face_m > 0.0:
            T, surface = self.T_world_rest_believed(raw.share), surface_distance_of(self._setup.organ)
            tip_m = raw.touching_m(self._face_m, T, surface)
        tracking_m = self.options.settings.tracking_m
        return Contact(tip_m, raw.share, tracking_m, DEPTH_SHARE * depth_m)

    def _released(self, raw: RawReading) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Points and tip where, by what is believed, they lay before the probe pressed, world frame; and its depth."""
        if self.yielding is None or self.belief is None:
            touched_m = raw.T_world_probe[:3, 3] - raw.pressed.dent_m * raw.T_world_probe[:3, 2]
            return raw.points_m, touched_m, 0.0
        return raw.released(self.yielding, self.T_world_rest_believed(raw.share), stale_m=self._stale_m)

    def laid_anew(self, readings: Sequence[LabelledPoints]) -> Laid | None:
        """The readings at where they are now believed to lie; None where that is near where they lie already.

        Args:
            readings: The readings so far, in their order, each with how far its labels are believed.
        """
        middles_m = np.array([each.points_m.mean(axis=0) for each in readings if len(each.points_m)])
        deviation_m, now = self._deviation_m(middles_m), self._T_rest_world()
        if self._shifts is not None:
            self._align(readings, now, self._shifts)
            deviation_m = float(np.hypot(deviation_m, self._shifts.deviation_m))
        return self._laid.anew(readings, now, deviation_m, lambda i: self._released(self._raw[i])[0])

    def _align(
        self, readings: Sequence[LabelledPoints], now: list[NDArray[np.float64]], shifts: ReadingShifts
    ) -> None:
        """Move what takes readings to rest to where they fit each other.

        Args:
            readings: The readings so far, with what is believed of their labels.
            now: What takes each to rest by what contacts tell, shapes (4, 4), which is changed.
            shifts: What is believed of how they lie beside each other.
        """
        measured, beams = [], []
        for reading, raw, T in zip(readings, self._raw, now, strict=True):
            measured.append(reading.at(self._released(raw)[0] @ T[:3, :3].T + T[:3, 3]))
            beams.append(T[:3, :3] @ raw.T_world_probe[:3, 2])
        shifts.observe(measured, np.array(beams))
        for T_rest_world, shift_m in zip(now, shifts.shifts_m, strict=True):
            T_rest_world[:3, 3] += shift_m

    def _deviation_m(self, points_m: NDArray[np.float64]) -> float:
        """How far points of the organ [m], shape (N, 3), are believed to be off, a root mean square [m]."""
        if self.belief is None or not len(points_m):
            return 0.0
        covariances_m2 = self.belief.place_covariance_m2(points_m)
        return float(np.sqrt(np.trace(covariances_m2, axis1=1, axis2=2).mean()))

    def T_world_rest_believed(self, inhaled_share: float) -> NDArray[np.float64]:
        """Where the organ is believed to lie, as the map from the rest frame to the world, shape (4, 4)."""
        return np.eye(4) if self.belief is None else self.belief.T_world_rest(inhaled_share)

    def place_belief(self) -> PlaceBelief | None:
        """What a planner may know of how well it is known where the organ lies; None where nothing tells."""
        if self.belief is None:
            return None
        poses, points_m = self._setup.workspace, self._setup.search_points_m[::_EVERY]
        # A copy, which stays as it is when the belief goes on.
        belief, noise_m = copy(self.belief), self.options.settings.tracking_m

        def gains_m2() -> NDArray[np.float64]:
            return belief.contact_gains_m2(poses.positions_m, -poses.normals, points_m, noise_m=noise_m)

        return PlaceBelief(self._deviation_m(points_m), gains_m2, self.options.register_above_m)

    def done(self, procedure_s: float) -> BodyScore:
        """How well it is known where the organ lies, after an action that is over now.

        Args:
            procedure_s: How long it took, with the ways to poses that were missed [s].
        """
        self.encounter.end_action(procedure_s)
        return self.score()

    def score(self) -> BodyScore:
        """How well it is known where the organ lies."""
        difference = self.T_world_rest_believed(0.0) - self.T_world_rest_at_exhale
        error_m = self._targets_m @ difference[:3, :3].T + difference[:3, 3]
        mean_m = float(np.linalg.norm(error_m, axis=1).mean())
        if self.belief is None:
            return BodyScore(mean_m, 0.0, None)
        covariance_m2 = self.belief.place_covariance_m2(self._targets_m)
        off = np.einsum("ni,nij,nj->n", error_m, np.linalg.inv(covariance_m2), error_m)
        spread_m = float(np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2).mean()))
        return BodyScore(mean_m, spread_m, float((off <= chdtri(3, 1.0 - SURE)).mean()))

    def record(self) -> dict[str, Any]:
        """What is believed of the organ's place, and what is true, as plain data."""
        T_world_rest = self.T_world_rest_believed(0.0)
        T_input_world = rigid_inverse(T_world_rest @ self._setup.T_world_organ)
        record: dict[str, Any] = {
            "T_world_rest": T_world_rest.tolist(),
            "T_input_world": T_input_world.tolist(),
            "T_world_rest_true": self.T_world_rest_at_exhale.tolist(),
        }
        if self.belief is not None:
            turn, shift, breath = self.belief.mean.reshape(3, 3).tolist()
            record |= {"turn_rad": turn, "shift_m": shift, "breath_m": breath}
            record |= {"covariance": self.belief.covariance.tolist()}
        return record

    def record_of(self, motion: Motion) -> dict[str, NDArray[np.float64]]:
        """Where the organ truly was during the last motion, and where the tip was in it at its end, as arrays.

        Args:
            motion: The last motion.
        """
        return {
            "T_world_rest": self.encounter.places_during(motion),
            "T_rest_probe": self.state().T_world_probe,
        }

    def _T_rest_world(self) -> list[NDArray[np.float64]]:
        """What takes each reading back to rest by what contacts tell, shapes (4, 4)."""
        moves = [rigid_inverse(self.T_world_rest_believed(raw.share)) for raw in self._raw]
        if self.belief is not None:
            for T_rest_world, correction_m in zip(moves, self.belief.tip_corrections_m(), strict=True):
                T_rest_world[:3, 3] += correction_m
        return moves
