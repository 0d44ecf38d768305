"""The organs that an environment meets: one for all seeds, or another for each, in arrays of one size."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mapping import MapSettings
from sim.episode.positioner import FreePositioner
from sim.episode.scenario import Scenario
from sim.episode.setup import Setup, build_setup
from sim.errors import UsageError
from sim.running.config import EpisodeConfig
from sim.running.fields import changed
from sim.running.parts import EpisodeParts, make_parts, scenario_of
from sim.world.probes.probe import ProbeModel
from sim.world.scene.arm import ArmModel

MOST_POSES_SHARE = 1.05
"""Room for poses where organs differ, over the number asked for: the number found is within a few per cent of it."""
MOST_POINTS = (128, 104, 96)
"""Room for the query lattice where organs differ. At 3 mm it is 384 x 312 x 288 mm, more than six standard deviations
above the means of generated livers, 200, 163 and 170 mm."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """What an environment is made for, and the sizes of its arrays."""

    config: EpisodeConfig
    parts: EpisodeParts
    """The parts of the episode of seed 0, of which other seeds change the seed, and the organ where it is generated."""
    n_actions: int
    """Number of actions: of poses, or of what there is room for."""
    lattice_shape: tuple[int, int, int]
    """Shape of the belief: that of the query lattice, or of what there is room for."""

    @classmethod
    def of(cls, config: EpisodeConfig) -> Course:
        """The course of a configuration, whose seed does not matter.

        Raises:
            UsageError, WorldError, PlannerError: Something cannot be made.
        """
        parts = make_parts(changed(config, seed=0))
        if scenario_of(changed(config, seed=1)) != parts.scenario:
            n_actions = math.ceil(MOST_POSES_SHARE * parts.scenario.n_poses)
            return cls(config=config, parts=parts, n_actions=n_actions, lattice_shape=MOST_POINTS)
        setup = setup_of(parts)
        return cls(
            config=config, parts=parts, n_actions=setup.workspace.n_poses, lattice_shape=setup.query.shape
        )

    def parts_of(self, seed: int) -> EpisodeParts:
        """The parts of the episode of a seed.

        Args:
            seed: 0 or more.
        """
        return replace(self.parts, seed=seed, scenario=scenario_of(changed(self.config, seed=seed)))

    def setup_of(self, parts: EpisodeParts) -> Setup:
        """The setup of an episode, which has to fit into the arrays.

        Raises:
            UsageError: It does not.
        """
        setup = setup_of(parts)
        sizes = (setup.workspace.n_poses, *setup.query.shape)
        most = (self.n_actions, *self.lattice_shape)
        if any(size > room for size, room in zip(sizes, most, strict=True)):
            raise UsageError(
                f"seed={parts.seed}: this organ has {sizes[0]} poses and a lattice of {sizes[1:]} points, but there is "
                f"room for {most[0]} and {most[1:]}. Take another seed, or a scenario "
                "file with a larger `score_spacing_m`."
            )
        return setup


def setup_of(parts: EpisodeParts) -> Setup:
    """The setup of an episode; a process keeps the last one, which environments of one organ share."""
    return _setup_of(parts.scenario, parts.arm, parts.map_settings.hinge_spacing_m, parts.probe)


@lru_cache(maxsize=1)
def _setup_of(scenario: Scenario, arm: ArmModel | None, hinge_spacing_m: float, probe: ProbeModel) -> Setup:
    return build_setup(scenario, arm, MapSettings(hinge_spacing_m=hinge_spacing_m), probe=probe)


def reached_poses(setup: Setup) -> NDArray[np.bool_]:
    """Which poses the probe reaches, shape (N,): all of them without an arm; with one each is tried, once a setup.

    Args:
        setup: The setup.
    """
    n_poses = setup.workspace.n_poses
    if isinstance(setup.positioner, FreePositioner):
        return np.ones(n_poses, dtype=bool)
    setup.positioner.prepare(range(n_poses))
    return np.array([setup.positioner.reach(pose).is_reached for pose in range(n_poses)])
