"""The episode: Algorithm 1 of the paper, with an arm that has to reach the pose before it can sense there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter

import mujoco
import numpy as np

from mapping import (
    DetailSettings,
    LabelledPoints,
    LabelTrust,
    MapMetrics,
    MapSettings,
    Prediction,
    TrustSettings,
    TumourMap,
    TumourMapFactory,
    average_precision,
    evaluate_map,
    make_hilbert_map,
    teach,
)
from planner import Planner, Situation
from sim.world.ik.result import IkResult
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor

from .arm_motion import make_motion_model
from .measures import NEVER, never, note_first
from .motion import Motion, MotionModel, ProcedureStoppedError, joined
from .setup import Setup
from .step import Ending, SkippedPose, Step
from .target_belief import TargetBelief, check_parts, checked_prediction, draws_of
from .truth import Truth, make_truth


class Episode:
    """One episode: the state that `steps` carries from action to action."""

    def __init__(
        self,
        setup: Setup,
        planner: Planner,
        *,
        seed: int,
        map_settings: MapSettings | None = None,
        detail: DetailSettings | None = None,
        trust: TrustSettings | None = None,
        tumour_map: TumourMapFactory | None = make_hilbert_map,
        sensor: Sensor | None = None,
        motion_model: MotionModel | None = None,
        sensing_s: float = MotionSettings().sensing_s,
        casts_rays: bool = True,
        plans_for_target: bool = False,
    ) -> None:
        """Make the truth of the seed and the prior map.

        Args:
            setup: Organ, workspace and arm.
            planner: Ranks the poses.
            seed: Seed of everything random. Parts have streams of their own, so planners with one seed face one truth.
            map_settings: What the map assumes.
            detail: How the map answers in detail near sensed tumour; None for a plain Hilbert map.
            trust: How far the sensor's labels of tumour are believed; None to take them as they are.
            tumour_map: Makes the map from its space: `make_hilbert_map`, or a class of one's own. None keeps no map,
                which suits only planners that need no belief. A second class gets a map of its own.
            sensor: Makes the readings; None for the paper's exact cone.
            motion_model: Moves the probe between the poses of this one episode; by default it jumps.
            sensing_s: Modelled time of a sensing action.
            casts_rays: Whether readings hold points. An episode without a map needs only the share sensed, for which
                the place of the tip is enough.
            plans_for_target: Whether the planner is shown the belief about a second class in place of the tumours'.

        Raises:
            ValueError: The planner or the map lacks what it needs, the seed is negative, or there is no second class
                to plan for.
            WorldError: No place for the tumours was found.
        """
        check_parts(planner, seed, tumour_map, casts_rays=casts_rays)
        truth_rng, self._sensor_rng, self._planner_rng = np.random.default_rng(seed).spawn(3)
        self.setup, self.planner = setup, planner
        self.truth: Truth = make_truth(setup, truth_rng)
        # Tumours are in the scene only for the rays to meet.
        scene = self.truth.scene if casts_rays else setup.scene
        self.data: mujoco.MjData = scene.new_data()
        self._map_settings = map_settings or MapSettings()
        self.tumour_map = self._new_map(tumour_map, detail)
        self.trust = LabelTrust(trust)
        self.prediction: Prediction | None = None
        self.target: TargetBelief | None = None
        if self.truth.target is not None:
            self.target = TargetBelief(self.truth.target, setup.cone, self._new_map(tumour_map, detail))
        if plans_for_target and self.target is None:
            raise ValueError(
                "plans_for_target=True: the setup has no second class. Give the case a second class, or leave it out."
            )
        self._plans_for_target, self._casts_rays = plans_for_target, casts_rays
        self._scene_state = SceneState(scene, self.data)
        self._sensor = ConeSensor() if sensor is None else sensor
        self._motion_model, self._sensing_s = motion_model or make_motion_model(setup), sensing_s
        self.first_seen = never(len(self.truth.anatomy.detection_points_m))
        self.readings: list[LabelledPoints] = []
        self.sensed: list[int] = []
        self.skipped: dict[int, SkippedPose] = {}
        self.ended_by: Ending | None = None
        self._confidence: dict[tuple[int, int], float] = {}
        self._miss_cost: float | None = None

    @property
    def notices(self) -> tuple[str, ...]:
        """What is to be known about the truth and about the motion, a sentence each."""
        return (*self.truth.anatomy.notices, *self._motion_model.notices)

    def steps(
        self,
        n_steps: int,
        *,
        until_sensed: float | None = None,
        until_confident: float | None = None,
        miss_cost: float | None = None,
        on_skipped: Callable[[int], None] = lambda n_in_a_row: None,
    ) -> Iterator[Step]:
        """Sense until `n_steps` actions are done, a rule to stop is met, or no pose is left that the arm reaches.

        Args:
            n_steps: Actions at most.
            until_sensed: Share of the detection points, of the class planned for, at which to stop; None for never.
            until_confident: Confidence of the planner that nothing is left at which to stop; None for never.
            miss_cost: How many actions a missed lesion is worth; it stops where more are not worth it. None for never.
            on_skipped: Called whenever a pose is out of reach, with how many in a row are.
        """
        self._miss_cost = miss_cost
        self._predict()
        for number in range(1, n_steps + 1):
            step = self._sense_once(number, on_skipped)
            if step is None:
                self.ended_by = "no_pose_left"
                return
            score = step.target if self._plans_for_target and step.target else step
            self.ended_by = "steps" if number == n_steps else None
            if until_sensed is not None and (score.sensed_fraction or 0.0) >= until_sensed:
                self.ended_by = "sensed"
            elif until_confident is not None and self.confidence() >= until_confident:
                self.ended_by = "confident"
            elif miss_cost is not None and not self.planner.is_worth_going_on(self.situation()):
                self.ended_by = "not_worth"
            yield step
            if self.ended_by:
                return

    def confidence(self) -> float:
        """How sure the planner is, from what is known so far, that nothing is left to find or outline."""
        if (known := (len(self.sensed), len(self.skipped))) not in self._confidence:
            self._confidence = {known: self.planner.confidence(self.situation())}
        return self._confidence[known]

    def metrics(self) -> MapMetrics | None:
        """The scores of the present map against the truth."""
        return None if self.prediction is None else evaluate_map(self.prediction, self.truth.is_tumour)

    def _sense_once(self, number: int, on_skipped: Callable[[int], None]) -> Step | None:
        start_s = perf_counter()
        chosen, skipped, ik_s, move_s = self._choose(on_skipped)
        planned_s = perf_counter()
        if chosen is None:
            return None
        pose, answer, motion = chosen
        reading = self._read()
        self._note_seen(number)
        sensed_s = perf_counter()
        labels = self.trust.judge(LabelledPoints(*reading.labels))
        auprc = self._update(labels)
        T, own = self._scene_state.T_world_probe, self.target
        target = own.learn(number, reading, T) if own is not None else None
        self.sensed.append(pose)
        self.readings.append(labels)
        return Step(
            step=number,
            pose_index=pose,
            ik=answer,
            reading=reading,
            sensed_fraction=float((self.first_seen != NEVER).mean()) if self.first_seen.size else None,
            auprc=auprc,
            skipped=tuple(skipped),
            motion=motion,
            procedure_s=motion.motion_s + self._sensing_s,
            plan_s=planned_s - start_s - ik_s - move_s,
            ik_s=ik_s,
            move_s=move_s,
            sense_s=sensed_s - planned_s,
            update_s=perf_counter() - sensed_s,
            target=target,
        )

    def _choose(
        self, on_skipped: Callable[[int], None]
    ) -> tuple[tuple[int, IkResult, Motion] | None, list[SkippedPose], float, float]:
        """The first pose of the ranking that the probe could be brought to, those skipped, seconds of IK and of motion.

        A pose to which there is no way now has none later either: the arm can always go back to where it is now. The
        way to a pose that was missed was gone all the same, and is part of the motion to the one that is had.
        """
        skipped: list[SkippedPose] = []
        motions: list[Motion] = []
        ik_s = move_s = 0.0
        for pose in self.planner.rank(self.situation()):
            start_s = perf_counter()
            answer = self.setup.positioner.reach(pose)
            reached_s = perf_counter()
            ik_s += reached_s - start_s
            reason = answer.explain()
            if answer.is_reached:
                motion = self._move(pose, motions)
                move_s += perf_counter() - reached_s
                if motion.is_done:
                    return (pose, answer, motion), skipped, ik_s, move_s
                reason = motion.reason
            self.skipped[pose] = SkippedPose(pose, reason)
            skipped.append(self.skipped[pose])
            on_skipped(len(skipped))
        return None, skipped, ik_s, move_s

    def _move(self, pose: int, missed: list[Motion]) -> Motion:
        """The motion to a pose, together with those that missed others before it; one more is noted where this misses.

        Raises:
            ProcedureStoppedError: The arm stopped; its motion holds those before too.
        """
        try:
            motion = self._motion_model.move(self.data, pose)
        except ProcedureStoppedError as error:
            error.motion = joined([*missed, error.motion])
            raise
        if motion.is_done:
            return joined([*missed, motion])
        if len(motion.time_s):
            missed.append(motion)
        return motion

    @property
    def _planned_for(self) -> Episode | TargetBelief:
        return self.target if self._plans_for_target and self.target is not None else self

    def situation(self) -> Situation:
        """What the planner may know now."""
        travel = self._motion_model.travel
        return Situation(
            workspace=self.setup.workspace,
            cone=self.setup.cone,
            search_points_m=self.setup.search_points_m,
            prediction=self._planned_for.prediction,
            is_visible=self.setup.is_visible,
            surface_distance_m=self.setup.surface_distance_m,
            readings=tuple(self._planned_for.readings),
            false_positive_rate=self._map_settings.false_positive_rate,
            false_negative_rate=self._map_settings.false_negative_rate,
            missed_rate=self.trust.rates.missed,
            sensed=tuple(self.sensed),
            skipped=frozenset(self.skipped),
            motion_s=partial(travel.seconds, self.sensed[-1]) if travel is not None and self.sensed else None,
            miss_cost=self._miss_cost,
            sensing_s=self._sensing_s,
            draw_map=draws_of(self._planned_for.tumour_map),
            rng=self._planner_rng,
        )

    def _read(self) -> Reading:
        """A reading at the present state; without points where no rays are cast."""
        if self._casts_rays:
            return self._sensor.sense(self._scene_state, self._sensor_rng)
        return Reading(np.empty((0, 3)), np.empty(0, dtype=bool), self._scene_state.T_world_probe)

    def _note_seen(self, number: int) -> None:
        T = self._scene_state.T_world_probe
        is_held = self.setup.cone.contains(self.truth.anatomy.detection_points_m, T[:3, 3], T[:3, 2])
        note_first(self.first_seen, number, is_held)

    def _update(self, labels: LabelledPoints) -> float | None:
        if self.tumour_map is None:
            return None
        teach(self.tumour_map, labels)
        self._predict()
        assert self.prediction is not None
        self.trust.observe(labels, self.setup.search_points_m, self.prediction)
        return average_precision(self.prediction.score, self.truth.is_tumour)

    def _new_map(self, make: TumourMapFactory | None, detail: DetailSettings | None) -> TumourMap | None:
        """A map before any reading, on the setup's lattices."""
        return None if make is None else make(self.setup.map_space(self._map_settings, detail))

    def _predict(self) -> None:
        if self.tumour_map is not None:
            self.prediction = checked_prediction(self.tumour_map, len(self.setup.search_points_m))
