"""The session: Algorithm 1 of the paper without the world, for whoever carries a probe and has a sensor.

    session = Session(plan_organ(scenario), planner, seed=0)
    while (proposal := session.propose()).advice == "sense":
        session.observe(Reading(points_m, is_occupied, T_world_probe))

It plans and maps as `Episode` does, so that the readings of an episode with a free-flying probe lead to its poses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from mapping import (
    DetailSettings,
    LabelledPoints,
    LabelTrust,
    MapSettings,
    Prediction,
    TrustSettings,
    TumourMapFactory,
    make_hilbert_map,
    settle,
    teach,
)
from mapping.likelihood import evidence_of
from mapping.threads import one_blas_thread
from planner import Planner, Situation
from sim.episode.planned.checks import checked_confidence, checked_poses, checked_prediction, checked_worth
from sim.episode.planned.planned_organ import PlannedOrgan
from sim.episode.target_belief import draws_of
from sim.world.frames import frames_along
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.reading import Reading

from .errors import RefusedError
from .event import Event
from .proposal import Proposal
from .session_folder import SessionFolder

PLANNER_STREAM = 2
"""Which of the streams that an episode spawns from its seed is the planner's."""
FARTHEST_TIP_M = 0.05
"""A tip farther from every pose than this senses nothing of the organ: its frame is another [m]."""
SAME_POSE_M, SAME_POSE_RAD = 0.005, math.radians(10.0)
"""A tip that is as near to the proposed pose as this has sensed from it."""


class Session:
    """Planner and belief between `propose` and `observe`. It is for one thread at a time."""

    def __init__(
        self,
        organ: PlannedOrgan,
        planner: Planner,
        *,
        seed: int = 0,
        map_settings: MapSettings | None = None,
        detail: DetailSettings | None = None,
        trust: TrustSettings | None = None,
        tumour_map: TumourMapFactory = make_hilbert_map,
        until_confident: float | None = None,
        miss_cost: float | None = None,
        speeds: MotionSettings | None = None,
        folder: SessionFolder | None = None,
    ) -> None:
        """Begin from the prior, or go on from what the folder holds.

        Args:
            organ: The organ in place, with its workspace and lattices.
            planner: Ranks the poses.
            seed: Seed of the planner, 0 or more.
            map_settings: What the map assumes.
            detail: How the map answers in detail near sensed tumour; None for a plain Hilbert map.
            trust: How far labels of tumour are believed; None to take them as they are.
            tumour_map: Makes the map from its space.
            until_confident: Confidence of the planner at which it is advised to end; None for never.
            miss_cost: How many actions a missed lesion is worth; it is advised to end where more are not worth it.
            speeds: How fast the tip moves, for planners that weigh the way, and how long sensing takes.
            folder: Keeps every event before anything that follows from it is told; None keeps nothing.

        Raises:
            UsageError: The folder cannot be read.
        """
        self.organ, self.planner = organ, planner
        self._rng = np.random.default_rng(seed).spawn(PLANNER_STREAM + 1)[PLANNER_STREAM]
        self._map_settings, self._speeds = map_settings or MapSettings(), speeds or MotionSettings()
        self.tumour_map = tumour_map(organ.map_space(self._map_settings, detail))
        self.trust = LabelTrust(trust)
        self._until_confident, self._miss_cost = until_confident, miss_cost
        self.readings: list[LabelledPoints] = []
        self.sensed: list[int] = []
        self.declined: dict[int, str] = {}
        self.poses: list[int] = []
        """The poses of all that was kept, sensed or declined, in order."""
        self.prediction: Prediction = self._predicted()
        self._proposal: Proposal | None = None
        self._folder = folder
        for event in folder.events() if folder is not None else ():
            self._repeat(event)

    @property
    def n_kept(self) -> int:
        """How many events it has taken in, of earlier processes too."""
        return len(self.poses)

    @one_blas_thread()
    def propose(self, tell_pose: Callable[[NDArray[np.float64]], None] = lambda T: None) -> Proposal:
        """Where to sense next; the same answer until something is observed or declined.

        Args:
            tell_pose: Called with the tip's pose, shape (4, 4) [m], as soon as it is known, since how sure the planner
                is takes as long again. Not called where the answer is known or no pose is left.
        """
        if self._proposal is None:
            start_s = perf_counter()
            situation = self.situation()
            ranking = checked_poses(self.planner, self.planner.rank(situation), self.organ.workspace.n_poses)
            pose = next(ranking, None)
            if pose is not None:
                tell_pose(self.pose_matrix(pose))
            # What the next reading will need can be done while somebody carries the probe there.
            settle(self.tumour_map)
            confidence = (
                checked_confidence(self.planner, situation) if self.planner.tells_confidence else None
            )
            self._proposal = Proposal(
                number=len(self.sensed) + 1,
                pose_index=pose,
                T_world_probe=None if pose is None else self.pose_matrix(pose),
                confidence=confidence,
                advice=self._advice(pose, confidence, situation),
                plan_s=perf_counter() - start_s,
            )
        return self._proposal

    @one_blas_thread()
    def observe(self, reading: Reading) -> int:
        """Take a reading in.

        Args:
            reading: What was sensed, and from where. Its points lie in the organ (`readings` makes such).

        Returns:
            The index of the pose that counts as sensed: the proposed one where the tip is close to it, else the
            nearest.

        Raises:
            RefusedError: There is no point, a value is not finite, or the tip is not at the organ; nothing has changed.
            OSError: It was learnt and could not be kept. Make a new session from the folder.
        """
        pose = self._pose_of(reading)
        self._keep(Event.of_reading(len(self.poses) + 1, pose, reading, self._rng))
        return pose

    def decline(self, pose: int, reason: str = "") -> None:
        """Say that a pose cannot be sensed from; it is not proposed again.

        Args:
            pose: Its index.
            reason: Why, as a sentence.

        Raises:
            RefusedError: There is no such pose, or it was declined before.
        """
        if not 0 <= pose < self.organ.workspace.n_poses:
            raise RefusedError(
                "unusable", f"pose {pose}: the poses are 0 .. {self.organ.workspace.n_poses - 1}"
            )
        if pose in self.declined:
            raise RefusedError("unusable", f"pose {pose}: was declined before")
        self._keep(Event.of_refusal(len(self.poses) + 1, pose, reason, self._rng))

    def situation(self) -> Situation:
        """What the planner may know now."""
        return Situation(
            workspace=self.organ.workspace,
            cone=self.organ.cone,
            search_points_m=self.organ.search_points_m,
            prediction=self.prediction,
            is_visible=self.organ.is_visible,
            surface_distance_m=self.organ.surface_distance_m,
            readings=tuple(self.readings),
            false_positive_rate=self._map_settings.false_positive_rate,
            false_negative_rate=self._map_settings.false_negative_rate,
            missed_rate=self.trust.rates.missed,
            sensed=tuple(self.sensed),
            skipped=frozenset(self.declined),
            motion_s=partial(self._transfer_s, self.sensed[-1]) if self.sensed else None,
            miss_cost=self._miss_cost,
            until_confident=self._until_confident,
            sensing_s=self._speeds.sensing_s,
            draw_map=draws_of(self.tumour_map),
            rng=self._rng,
        )

    def pose_matrix(self, pose: int) -> NDArray[np.float64]:
        """The tip at a pose of the workspace, turned about the beam as a free-flying probe is, shape (4, 4) [m]."""
        T_world_probe = np.eye(4)
        T_world_probe[:3, :3] = frames_along(self.organ.workspace.normals[pose][None])[0]
        T_world_probe[:3, 3] = self.organ.workspace.positions_m[pose]
        return T_world_probe

    def _advice(self, pose: int | None, confidence: float | None, situation: Situation) -> str:
        if pose is None:
            return "no_pose_left"
        if self._until_confident is not None and (confidence or 0.0) >= self._until_confident:
            return "confident"
        if self.sensed and self._miss_cost is not None and not checked_worth(self.planner, situation):
            return "not_worth"
        return "sense"

    def _keep(self, event: Event) -> None:
        """Keep an event on disk, and learn from it meanwhile; both are done when this returns."""
        with nullcontext() if self._folder is None else self._folder.appending(event):
            self._take(event)
        if self._folder is not None:
            self._folder.write_map(self.organ, self.prediction)

    @one_blas_thread()
    def _repeat(self, event: Event) -> None:
        """Take in an event of an earlier process."""
        if event.rng_state != self._rng.bit_generator.state:
            # The planner drew, and what it drew the map may carry on.
            self.propose()
            self._rng.bit_generator.state = event.rng_state
        self._take(event)

    def _take(self, event: Event) -> None:
        self._proposal = None
        self.poses.append(event.pose_index)
        if event.reading is None:
            self.declined[event.pose_index] = event.reason
            return
        labels = self.trust.judge(LabelledPoints(*event.reading.labels))
        self.readings.append(labels)
        self.sensed.append(event.pose_index)
        teach(self.tumour_map, labels)
        self.prediction = self._predicted()
        self.trust.observe(labels, self.organ.search_points_m, self.prediction)

    def _predicted(self) -> Prediction:
        return checked_prediction(self.tumour_map, len(self.organ.search_points_m))

    def _pose_of(self, reading: Reading) -> int:
        """The pose that a reading was taken from."""
        if not len(reading.points_m):
            raise RefusedError(
                "unusable", "the reading holds no point in the organ, so that it tells nothing"
            )
        _check_finite(("points", reading.points_m), ("pose", reading.T_world_probe))
        try:
            # Rates do not matter to whether what is told is of use.
            evidence_of(reading.is_occupied.astype(float), (0.0, 0.0), reading.log_odds, reading.weight)
        except ValueError as error:
            raise RefusedError("malformed", f"the reading cannot be learnt from ({error})") from error
        T, workspace = reading.T_world_probe, self.organ.workspace
        distance_m = np.linalg.norm(workspace.positions_m - T[:3, 3], axis=1)
        nearest = int(np.argmin(distance_m))
        if distance_m[nearest] > FARTHEST_TIP_M:
            raise RefusedError(
                "wrong frame",
                f"the tip is {distance_m[nearest] * 1e3:.0f} mm from the nearest pose, at most "
                f"{FARTHEST_TIP_M * 1e3:.0f} are sensed from; is its frame that of the organ?",
            )
        wanted = self._proposal.pose_index if self._proposal is not None else None
        if wanted is None or distance_m[wanted] > SAME_POSE_M:
            return nearest
        return wanted if workspace.normals[wanted] @ T[:3, 2] >= math.cos(SAME_POSE_RAD) else nearest

    def _transfer_s(self, start: int, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        """The time of the tip's straight way from a pose to others [s], shape (k,)."""
        places_m = self.organ.workspace.positions_m
        return np.linalg.norm(places_m[poses] - places_m[start], axis=1) / self._speeds.tip_speed_m_s


def _check_finite(*named: tuple[str, NDArray[np.float64]]) -> None:
    for name, values in named:
        if not np.isfinite(values).all():
            raise RefusedError("malformed", f"the {name} of the reading hold a value that is not finite")
