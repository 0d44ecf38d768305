"""The environment: an episode whose poses an agent chooses, one a step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.threads import one_blas_thread
from planner import Situation
from sim.episode.episode import Episode
from sim.episode.measures import NEVER, SENSED_GOAL
from sim.episode.planned.checks import checked_prediction
from sim.episode.setup import Setup
from sim.episode.step import Step
from sim.errors import FieldError
from sim.running.config import EpisodeConfig
from sim.running.fields import changed
from sim.running.run_episode import make_episode
from sim.world.optional import optional_module

from .chosen_pose import ChosenPose
from .course import Course, reached_poses
from .observation import History, observation_space
from .taken_options import check_options, whole_number

gymnasium = optional_module("gymnasium", "gym", "`sim.gym`")

SEEDS = 2**31
"""An episode that is started without a seed takes one below this."""


class SoundingEnv(gymnasium.Env):
    """One episode after the other; the agent chooses the pose of each sensing action.

    Actions: the index of a pose, 0 .. n - 1. A pose that was tried may be sensed again.

    Observations, a dictionary, in which N is the number of actions and H that of steps:

    - `action_mask`, shape (N,): 1 for a pose that was not tried yet and that the probe reaches.
    - `last_pose`: the pose sensed last; -1 before the first.
    - `share_used`, shape (1,): the share of `max_steps` that is used.
    - `history`, shape (H,): the poses sensed, in order; -1 for those to come.
    - `tumour_in_cone`, shape (H,): 1 for each of these whose reading, or one on the way of a sweep, held tumour.
    - `belief`, shape (X, Y, Z): the map's probability of tumour on the query lattice, 0 outside the organ. Only where a
      map is kept.

    The reward is the share of the tumours' detection points that lies in a cone for the first time; each tumour has
    equally many such points, so that small ones count as much as large ones. The rewards of an episode add up to the
    share sensed, to which `reward_per_tumour` is added for each tumour that a cone meets for the first time.
    """

    metadata = {"render_modes": []}  # noqa: RUF012, as Gymnasium declares it

    def __init__(
        self,
        scenario: str = "liver",
        *,
        keeps_map: bool = True,
        makes_readings: bool | None = None,
        max_steps: int = 100,
        reward_per_tumour: float = 0.0,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Load the organ and build what all episodes share.

        Args:
            scenario: A scenario's name, or the path of its file.
            keeps_map: Whether readings are made and a map is kept. Without, a step takes some 400 microseconds: no
                ray is cast, and a cone holds tumour where it holds a detection point.
            makes_readings: Whether rays are cast where no map is kept, for agents that look at `situation().readings`;
                None for only with a map, which needs them.
            max_steps: Actions after which an episode is truncated, at least 1.
            reward_per_tumour: Added to the reward for each tumour that is met for the first time.
            render_mode: None; nothing is drawn.
            options: All other fields of an `EpisodeConfig` by name, such as `arm`, which is `none` here by default.

        Raises:
            UsageError, WorldError, PlannerError: Something cannot be done.
        """
        check_options(
            options,
            keeps_map=keeps_map,
            makes_readings=makes_readings,
            max_steps=max_steps,
            reward_per_tumour=reward_per_tumour,
        )
        if render_mode is not None:
            raise FieldError("render_mode", render_mode, "nothing is drawn; leave it out.")
        values = {"scenario": scenario, "arm": "none", "motion": "none"} | options
        self.course = Course.of(changed(EpisodeConfig(), **values))
        if keeps_map and not self.course.parts.keeps_map:
            raise FieldError("map", options["map"], "keeps no map here. Give keeps_map=False too.")
        self.keeps_map, self.max_steps, self.reward_per_tumour = keeps_map, max_steps, reward_per_tumour
        self.makes_readings = keeps_map if makes_readings is None else makes_readings
        self.render_mode = render_mode
        self.action_space = gymnasium.spaces.Discrete(self.course.n_actions)
        shape = self.course.lattice_shape if keeps_map else None
        self.observation_space = observation_space(self.course.n_actions, max_steps, shape)
        self._chosen = ChosenPose()
        self._is_reached: tuple[Setup, NDArray[np.bool_]] | None = None
        self._episode: Episode | None = None
        self._steps: Iterator[Step] = iter(())
        self._sensed_fraction = 0.0

    @property
    def episode(self) -> Episode:
        """The present episode, with its truth; an agent that looks at it cheats.

        Raises:
            gymnasium.error.ResetNeeded: There is none yet.
        """
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("No episode was started yet. Call reset().")
        return self._episode

    def situation(self) -> Situation:
        """What a planner would be shown now, without the truth; `next(planner.rank(env.situation()))` is its action.

        All poses that the probe does not reach are skipped from the start. Readings hold points only where they are
        made.

        Raises:
            gymnasium.error.ResetNeeded: There is no episode yet.
        """
        setup = self.episode.setup
        lost = np.flatnonzero(~self._open_actions(setup)[: setup.workspace.n_poses])
        known = self.episode.motion_model.extended(self.episode.situation())
        return replace(known, skipped=frozenset(lost.tolist()))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start the episode of a seed, whose truth is that of `sounding episode` with this seed and the same options.

        Args:
            seed: 0 or more; None draws one from the environment's own stream.
            options: Not used.

        Returns:
            The observation, and in `info` beside what every step tells: `seed`; `poses`, shape (N, 6), positions
            [m, world] and inward unit normals of the poses, rows of zeros where there is none; `lattice_low_m`, shape
            (3,), the place of the belief's first point [m, world], and `lattice_spacing_m`, shape (3,).
        """
        super().reset(seed=seed)
        del options
        chosen_seed = int(self.np_random.integers(SEEDS)) if seed is None else int(seed)
        parts = self.course.parts_of(chosen_seed)
        if not self.keeps_map:
            parts = replace(parts, make_map=None)
        setup = self.course.setup_of(parts)
        with one_blas_thread():
            self._episode = make_episode(parts, setup, planner=self._chosen, casts_rays=self.makes_readings)
            self._steps = self._episode.steps(self.max_steps)
        self._history = History(self._open_actions(setup), self.max_steps)
        self._is_tumour_met = np.zeros(len(self._episode.truth.anatomy.tumours), dtype=bool)
        self._sensed_fraction = 0.0
        observation = self._observation()
        return observation, self._info(observation) | {"seed": chosen_seed} | self._places(setup)

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Sense from a pose.

        Args:
            action: The pose's index.

        Returns:
            Observation, reward, whether 95 % of the tumours are sensed, whether all steps are used, and `info`:
            `sensed_fraction`, `tumours_met` (a number), `action_mask`, `is_reached`, and `reason`, the sentence that
            says why a pose is not reached, which is a step without a reading; empty where it is.
        """
        self._check_running()
        pose, reason = self._pose_of(action)
        before, n_met = self._sensed_fraction, int(self._is_tumour_met.sum())
        if reason:
            self._history.note_missed(pose)
        else:
            self._sense(pose)
        reward = self._sensed_fraction - before
        reward += self.reward_per_tumour * (int(self._is_tumour_met.sum()) - n_met)
        observation = self._observation()
        is_done = self._sensed_fraction >= SENSED_GOAL
        is_cut = not is_done and self._history.n_actions >= self.max_steps
        return observation, reward, is_done, is_cut, self._info(observation, reason)

    def _check_running(self) -> None:
        """Check that there is an episode that is neither terminated nor truncated.

        Raises:
            gymnasium.error.ResetNeeded: There is none.
        """
        if self._episode is None or self._is_over():
            raise gymnasium.error.ResetNeeded("No episode has a step left. Call reset().")

    def _is_over(self) -> bool:
        return self._sensed_fraction >= SENSED_GOAL or self._history.n_actions >= self.max_steps

    def _sense(self, pose: int) -> None:
        """Have the episode sense from a pose that is reached, and note what came of it."""
        self._chosen.pose = pose
        with one_blas_thread():
            step = next(self._steps)
        anatomy = self.episode.truth.anatomy
        self._is_tumour_met[anatomy.detection_tumours[self.episode.first_seen != NEVER]] = True
        self._sensed_fraction = step.sensed_fraction or 0.0
        is_met = step.reading.is_occupied.any() if self.makes_readings else self._is_held(step)
        self._history.note_sensed(pose, is_tumour_in_cone=bool(is_met))

    def _is_held(self, step: Step) -> bool:
        """Whether a cone of an action held a detection point."""
        cone, points_m = self.episode.setup.cone, self.episode.truth.anatomy.detection_points_m
        poses = [step.reading.T_world_probe] if step.sweep is None else step.sweep.T_world_readings
        return any(cone.contains(points_m, T[:3, 3], T[:3, 2]).any() for T in poses)

    def _pose_of(self, action: int) -> tuple[int, str]:
        """The pose of an action, and why it is not reached; empty where it is.

        Raises:
            ValueError: There is no such action.
        """
        setup, n_actions, pose = self.episode.setup, self.course.n_actions, whole_number(action)
        if pose is None:
            raise ValueError(f"action={action!r}: must be a whole number, 0 .. {n_actions - 1}.")
        if not 0 <= pose < n_actions:
            raise ValueError(f"action={pose}: must be 0 .. {n_actions - 1}.")
        n_poses = setup.workspace.n_poses
        if pose >= n_poses:
            return pose, f"This organ has {n_poses} poses only; the mask leaves the others out."
        answer = setup.positioner.reach(pose)
        return pose, "" if answer.is_reached else answer.explain()

    def _open_actions(self, setup: Setup) -> NDArray[np.bool_]:
        """Which actions lead to a pose that is reached, shape (n_actions,)."""
        if self._is_reached is None or self._is_reached[0] is not setup:
            is_open = np.zeros(self.course.n_actions, dtype=bool)
            is_open[: setup.workspace.n_poses] = reached_poses(setup)
            self._is_reached = (setup, is_open)
        return self._is_reached[1]

    def _observation(self) -> dict[str, Any]:
        observation = self._history.observation()
        if self.keeps_map:
            observation["belief"] = self._belief()
        return observation

    def _belief(self) -> NDArray[np.float32]:
        episode, prediction = self.episode, self.episode.prediction
        if prediction is None:  # before the first action
            assert episode.tumour_map is not None
            with one_blas_thread():
                prediction = checked_prediction(episode.tumour_map, len(episode.setup.search_points_m))
        values = episode.setup.on_lattice(prediction.probability, outside=0.0)
        belief = np.zeros(self.course.lattice_shape, dtype=np.float32)
        belief[tuple(slice(n) for n in values.shape)] = values
        return belief

    def _info(self, observation: dict[str, Any], reason: str = "") -> dict[str, Any]:
        return {
            "sensed_fraction": self._sensed_fraction,
            "tumours_met": int(self._is_tumour_met.sum()),
            "action_mask": observation["action_mask"],
            "is_reached": not reason,
            "reason": reason,
        }

    def _places(self, setup: Setup) -> dict[str, Any]:
        """Where poses and lattice lie."""
        poses = np.zeros((self.course.n_actions, 6))
        workspace, axes_m = setup.workspace, setup.query.axes_m
        poses[: workspace.n_poses] = np.hstack([workspace.positions_m, workspace.normals])
        return {
            "poses": poses,
            "lattice_low_m": np.array([axis[0] for axis in axes_m]),
            "lattice_spacing_m": np.array([axis[1] - axis[0] for axis in axes_m]),
        }
