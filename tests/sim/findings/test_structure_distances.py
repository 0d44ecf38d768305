"""The distances of structures to what the map calls tumour, by the rule of the findings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mapping import Prediction
from planner import RandomOrder
from sim.episode.episode import Episode
from sim.findings.structure_distances import distance_rows
from sim.record.map_field import called_from
from sim.world.anatomy.structures import Structure
from sim.world.solids.solid import Solid


@pytest.mark.parametrize(("prior", "is_called"), [(0.02, True), (0.5, False)])
def test_a_mapped_tumour_is_what_the_findings_call_one(sphere_setup, prior, is_called) -> None:
    """A probability of 0.6 is tumour where 2 % were expected, and none where half of the organ was."""
    middle_m = sphere_setup.organ.bounds_m.mean(axis=0)
    vessel = trimesh.creation.icosphere(radius=0.005)
    vessel.apply_translation(middle_m)
    structure = Structure(name="vessel", solid=Solid.from_trimesh(vessel), is_keepout=False)
    episode = Episode(replace(sphere_setup, structures=(structure,)), RandomOrder(), seed=0)
    away_m = np.linalg.norm(sphere_setup.search_points_m - middle_m, axis=1)
    episode.prediction = Prediction.from_probability(np.where(away_m < 0.02, 0.6, 0.01))
    assert (called_from(prior) < 0.6) is is_called
    kinds = [row["tumour"] for row in distance_rows(episode, prior)]
    assert kinds == (["mapped", "true"] if is_called else ["true"])
