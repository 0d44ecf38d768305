"""What a bound is about, built once in each process: the setup, the poses that are reached, the truth of a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sim.episode.scenario import Scenario
from sim.episode.setup import Setup, build_setup
from sim.episode.truth import Truth, make_truth
from sim.running.config import EpisodeConfig
from sim.running.fields import changed
from sim.running.parts import scenario_of
from sim.running.placing.arm_place import arm_of

from .poses import StandingPoses, standing_poses


class Stage:
    """The setup of a configuration's scenario and arm, and the poses that are reached in it.

    A worker process is sent the configuration and, where all seeds share an organ, the poses; it builds the setup
    itself, since a MuJoCo model is larger than all that it is made from.
    """

    def __init__(self, config: EpisodeConfig, *, n_tumours: int | None = None) -> None:
        """Remember what to build.

        Args:
            config: Scenario and arm.
            n_tumours: Number of tumours to plant in place of the scenario's.
        """
        self.config, self._n_tumours = config, n_tumours
        self._setup: Setup | None = None
        self._poses: StandingPoses | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What goes to another process."""
        poses = None if self.is_new_each_seed else self._poses
        return {
            "config": self.config,
            "_n_tumours": self._n_tumours,
            "_setup": None,
            "_poses": poses,
        }

    @property
    def is_new_each_seed(self) -> bool:
        """Whether every seed has an organ of its own."""
        return self.scenario(0) != self.scenario(1)

    def scenario(self, seed: int) -> Scenario:
        """The scenario of a seed."""
        scenario = scenario_of(changed(self.config, seed=seed))
        return scenario if self._n_tumours is None else replace(scenario, n_tumours=self._n_tumours)

    def planting(self, n_tumours: int) -> Stage:
        """The same stage with another number of tumours to plant."""
        other = Stage(self.config, n_tumours=n_tumours)
        if self._setup is not None and not self.is_new_each_seed:
            other._setup = replace(self._setup, scenario=other.scenario(0))
        other._poses = self._poses
        return other

    def setup(self, seed: int) -> Setup:
        """The setup of a seed.

        Raises:
            WorldError: A file or the arm cannot be used.
        """
        scenario = self.scenario(seed)
        if self._setup is None or self._setup.scenario != scenario:
            if self._setup is not None:
                self._poses = None
            self._setup = build_setup(scenario, arm_of(self.config))
        return self._setup

    def poses(self, seed: int, on_progress: Callable[[int], object] = lambda n: None) -> StandingPoses:
        """The poses that are reached in the setup of a seed; with an arm they take a second for each 600."""
        if self._poses is None or self.is_new_each_seed:
            setup = self.setup(seed)
            if self._poses is None:
                self._poses = standing_poses(setup, on_progress)
        return self._poses

    def truth(self, seed: int) -> Truth:
        """The truth that an episode of a seed has.

        Raises:
            WorldError: No place for the tumours was found.
        """
        truth_rng, _, _ = np.random.default_rng(seed).spawn(3)
        return make_truth(self.setup(seed), truth_rng)
