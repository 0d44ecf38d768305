"""A ball in a patient, and a service of it."""

import pytest
import trimesh
from igtl_service import COARSE, Served

from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import Scenario


@pytest.fixture(scope="module")
def organ():
    """A ball of 50 mm that lies elsewhere, and turned, in the patient."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    ball.apply_translation([0.1, -0.2, 0.3])
    scenario = Scenario(organ=ball, n_poses=200, score_spacing_m=0.01, organ_turn_rad=(0.2, -0.1, 0.5))
    return plan_organ(scenario, COARSE)


@pytest.fixture
def served(organ):
    served = Served(organ)
    yield served
    served.close()
