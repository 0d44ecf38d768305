"""Generated livers and the loads of tumours in them, by seed."""

import numpy as np
import pytest

from sim.episode.scenario import SCENARIOS
from sim.episode.setup import placed_organ
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.world.anatomy.tumour_load import draw_lits_diameters
from sim.world.anatomy.tumours import plant_load
from sim.world.solids.surface_distance import SurfaceDistance


@pytest.fixture(scope="module")
def generated():
    """Scenarios and organs of two seeds."""
    scenarios = [scenario_of(config_of(scenario="generated-liver", seed=seed)) for seed in (4, 5)]
    return scenarios, [placed_organ(scenario)[0].organ for scenario in scenarios]


def test_every_seed_has_a_liver_of_its_own_and_planners_share_it(generated):
    (scenario, _), (organ, other) = generated
    assert organ.volume_m3 != pytest.approx(other.volume_m3, rel=1e-3)
    for planner in ("random", "find-and-outline"):  # equal scenarios are one setup
        assert scenario_of(config_of(scenario="generated-liver", seed=4, planner=planner)) == scenario
    assert np.array_equal(placed_organ(scenario)[0].organ.vertices_m, organ.vertices_m)


def test_a_load_is_planted_below_the_capsule_and_shrinks_where_it_must(generated):
    organ = generated[1][0]
    tumours = plant_load(organ, [0.012, 0.1, 0.02], rng=np.random.default_rng(0))
    diameters_m = np.cbrt(6.0 / np.pi * np.array([tumour.volume_m3 for tumour in tumours]))
    assert 0.03 < diameters_m[0] < 0.1  # a decimetre fits nowhere
    assert diameters_m[1:] == pytest.approx([0.02, 0.012], rel=1e-3)
    surface = SurfaceDistance(organ)
    for tumour in tumours:
        assert surface.signed_distance_m(tumour.vertices_m).max() <= -0.0025


def test_tumour_loads_have_the_quartiles_of_lits():
    rng = np.random.default_rng(0)
    loads = [draw_lits_diameters(rng) for _ in range(4000)]
    counts = np.percentile([len(load) for load in loads], [25, 50, 75])
    assert counts == pytest.approx([1, 3, 8], abs=1.0)
    volumes_ml = [sum(np.pi / 6 * each**3 for each in load) * 1e6 for load in loads]
    # Published: 3.4, 16.1 and 107.8 ml, of scans with tumours.
    assert np.percentile(volumes_ml, [25, 50, 75]) == pytest.approx([3.0, 18.0, 86.0], rel=0.2)


def test_scenarios_by_name_are_what_they_were():
    assert SCENARIOS["liver"].organ_turn_rad == (0.0, 0.0, 0.0)
    assert SCENARIOS["liver"].tumour_load == "fixed"
