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
    TumourMapFactory,
    average_precision,
    evaluate_map,
    laid_anew,
    make_hilbert_map,
    teach,
)
from planner import Planner, Situation, registering_first
from sim.world.motion.settings import MotionSettings
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import SceneState, Sensor

from .body import Body
from .body_options import BodyOptions
from .measures import NEVER, never, note_held
from .moving.approach import approach_first
from .moving.arm_motion import make_motion_model
from .moving.motion import MotionModel, SkippedPose
from .planned.checks import (
    check_parts,
    checked_confidence,
    checked_poses,
    checked_prediction,
    checked_reading,
    checked_worth,
)
from .setup import Setup
from .step import Ending, Step
from .sweeping.score import SweepScore, joined_reading, taught_together
from .target_belief import TargetBelief, draws_of, map_maker, target_belief_of
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
        body: BodyOptions | None = None,
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
            body: How the organ's true place differs from the plan; None where it lies as planned.

        Raises:
            ValueError: The planner or the map lacks what it needs, the seed is negative, or there is no second class
                to plan for.
            WorldError: No place for the tumours was found.
        """
        check_parts(planner, seed, tumour_map, casts_rays=casts_rays)
        truth_rng, self._sensor_rng, self._planner_rng, body_rng = np.random.default_rng(seed).spawn(4)
        self.setup, self.planner = setup, planner
        self.truth: Truth = make_truth(setup, truth_rng)
        # Tumours are in the scene only for the rays to meet.
        scene = self.truth.scene if casts_rays else setup.scene
        self.data: mujoco.MjData = scene.new_data()
        self._map_settings = map_settings or MapSettings()
        self._new_map = map_maker(setup, tumour_map, self._map_settings, detail)
        self.tumour_map = None if self._new_map is None else self._new_map()
        self.trust = LabelTrust(trust)
        self.prediction: Prediction | None = None
        self.target = target_belief_of(
            self.truth.target, setup.cone, self._new_map, is_needed=plans_for_target
        )
        self._plans_for_target, self._casts_rays = plans_for_target, casts_rays
        self._scene_state = SceneState(scene, self.data)
        self._sensor = ConeSensor() if sensor is None else sensor
        self.motion_model, self._sensing_s = motion_model or make_motion_model(setup), sensing_s
        self.body: Body | None = None
        if body is not None:
            self.body = Body(body, setup, self._scene_state, self.truth.anatomy, body_rng)
            self.motion_model = self.body.followed_by(self.motion_model)
        self.first_seen = never(len(self.truth.anatomy.detection_points_m))
        self.readings: list[LabelledPoints] = []
        self.sensed: list[int] = []
        self.skipped: dict[int, SkippedPose] = {}
        self.ended_by: Ending | None = None
        self._confidence: dict[tuple[int, int], float] = {}
        self._miss_cost: float | None = None
        self._until_confident: float | None = None

    @property
    def notices(self) -> tuple[str, ...]:
        """What is to be known about the truth and about the motion, a sentence each."""
        return (*self.truth.anatomy.notices, *self.motion_model.notices)

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
        self._miss_cost, self._until_confident = miss_cost, until_confident
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
            elif miss_cost is not None and not checked_worth(self.planner, self.situation()):
                self.ended_by = "not_worth"
            yield step
            if self.ended_by:
                return

    def confidence(self) -> float:
        """How sure the planner is, from what is known so far, that nothing is left to find or outline."""
        if (known := (len(self.sensed), len(self.skipped))) not in self._confidence:
            self._confidence = {known: checked_confidence(self.planner, self.situation())}
        return self._confidence[known]

    def metrics(self) -> MapMetrics | None:
        """The scores of the present map against the truth."""
        return None if self.prediction is None else evaluate_map(self.prediction, self.truth.is_tumour)

    def _sense_once(self, number: int, on_skipped: Callable[[int], None]) -> Step | None:
        start_s = perf_counter()
        situation = self.situation()
        ranking = self.motion_model.ranking(self.planner, situation)
        approach = approach_first(
            registering_first(checked_poses(self.planner, ranking, self.setup.workspace.n_poses), situation),
            self.setup.positioner,
            self.motion_model,
            self.data,
            skipped=self.skipped,
            on_skipped=on_skipped,
        )
        planned_s = perf_counter()
        if approach.motion is None or approach.answer is None:
            return None
        pose, motion = approach.pose, approach.motion
        readings, passed = list[Reading](), list[int]()
        for halt in self.motion_model.halts(self.data, motion):
            readings.append(self._read())
            passed.append(pose if halt is None else halt)
            T_world_probe = self._scene_state.T_world_probe
            note_held(
                self.first_seen, number, self.setup.cone, self.truth.anatomy.detection_points_m, T_world_probe
            )
            if self.target is not None:
                self.target.note(number, readings[-1], T_world_probe)
        sensed_s = perf_counter()
        labels = [self.trust.judge(LabelledPoints(*reading.labels)) for reading in readings]
        self.readings += labels
        auprc = self._update(labels)
        self.sensed += passed
        seconds = motion.motion_s + (0.0 if self.motion_model.senses_in_motion else self._sensing_s)
        return Step(
            step=number,
            pose_index=pose,
            ik=approach.answer,
            reading=joined_reading(readings),
            sensed_fraction=float((self.first_seen != NEVER).mean()) if self.first_seen.size else None,
            auprc=auprc,
            skipped=tuple(approach.skipped),
            motion=motion,
            procedure_s=seconds,
            plan_s=planned_s - start_s - approach.ik_s - approach.move_s,
            ik_s=approach.ik_s,
            move_s=approach.move_s,
            sense_s=sensed_s - planned_s,
            update_s=perf_counter() - sensed_s,
            target=None if self.target is None else self.target.score(),
            body=None if self.body is None else self.body.done(seconds),
            sweep=SweepScore.of(motion, readings) if self.motion_model.senses_in_motion else None,
        )

    @property
    def _planned_for(self) -> Episode | TargetBelief:
        return self.target if self._plans_for_target and self.target is not None else self

    def situation(self) -> Situation:
        """What the planner may know now."""
        travel = self.motion_model.travel
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
            until_confident=self._until_confident,
            sensing_s=self._sensing_s,
            place=None if self.body is None else self.body.place_belief(),
            draw_map=draws_of(self._planned_for.tumour_map),
            rng=self._planner_rng,
        )

    def _read(self) -> Reading:
        """A reading at the present state; without points where no rays are cast."""
        if self.body is not None:
            self._scene_state = self.body.state()
            return self.body.read(self._sensor, self._sensor_rng)
        if self._casts_rays:
            return checked_reading(self._sensor, self._scene_state, self._sensor_rng)
        return Reading(np.empty((0, 3)), np.empty(0, dtype=bool), self._scene_state.T_world_probe)

    def _update(self, labels: list[LabelledPoints]) -> float | None:
        if self.tumour_map is None:
            return None
        self._learn(labels)
        self._predict()
        assert self.prediction is not None
        for each in self.readings[-len(labels) :]:
            self.trust.observe(each, self.setup.search_points_m, self.prediction)
        return average_precision(self.prediction.score, self.truth.is_tumour)

    def _learn(self, labels: list[LabelledPoints]) -> None:
        """Teach the maps an action's readings, or all anew where the organ is now believed to lie elsewhere."""
        assert self.tumour_map is not None
        assert self._new_map is not None
        laid = None if self.body is None else self.body.laid_anew(self.readings)
        if laid is not None:
            self.readings = laid.readings
            labels = laid.readings[-len(labels) :]
        if laid is not None and laid.is_moved:
            self.tumour_map = laid_anew(self.tumour_map, laid.readings, self._new_map, is_far=laid.is_far)
        else:
            for each in taught_together(labels, self.setup.cone, self._map_settings):
                teach(self.tumour_map, each)
        if self.target is not None:
            self.target.learn(laid, self._new_map, n_new=len(labels))

    def _predict(self) -> None:
        if self.tumour_map is not None:
            self.prediction = checked_prediction(self.tumour_map, len(self.setup.search_points_m))
