"""The face of the probe is a disc: what is learnt from its contacts is where the organ lies, without a bias."""

from dataclasses import replace

import numpy as np
import pytest

from planner import make_planner
from sim.episode.body_options import BodyOptions
from sim.episode.episode import Episode
from sim.episode.scenario import SCENARIOS
from sim.episode.yielding import RawReading
from sim.world.body.contact import face_at_m
from sim.world.body.settings import BodySettings
from sim.world.frames import rigid_inverse
from sim.world.sensing.reading import Reading
from sim.world.sensing.sensor import Sensor
from sim.world.solids.surface_distance import surface_distance_of

FACE_M, N_CONTACTS = 0.008, 15
SEEDS = range(3)


class Blind(Sensor):
    """Touches, and sees nothing."""

    def sense(self, state, rng) -> Reading:
        return Reading(np.empty((0, 3)), np.empty(0, dtype=bool), state.T_world_probe)


@pytest.fixture(scope="module")
def liver(setups_are_built_once):
    from mapping import MapSettings

    return setups_are_built_once(SCENARIOS["liver"], None, MapSettings())


def touched(setup, seed) -> Episode:
    """An episode on an organ 12 mm and 5 degrees off, after its contacts."""
    settings = BodySettings(registration_m=0.012, registration_rad=np.deg2rad(5.0))
    run = Episode(
        setup,
        make_planner("random"),
        seed=seed,
        body=BodyOptions(settings=settings),
        sensor=Blind(),
        tumour_map=None,
    )
    for _ in run.steps(N_CONTACTS):
        pass
    return run


def error_m(run) -> np.ndarray:
    """By how much the tumours are believed to lie off, mean over them, shape (3,)."""
    off = run.body.T_world_rest_believed(0.0) - run.body.T_world_rest_at_exhale
    return (run.truth.anatomy.tumour_middles_m @ off[:3, :3].T + off[:3, 3]).mean(axis=0)


def test_the_face_touches_and_does_not_enter(liver) -> None:
    run, surface, n_aslant = touched(liver, 7), surface_distance_of(liver.organ), 0
    T_rest_world = rigid_inverse(run.body.T_world_rest)
    for raw in run.body._raw:
        face_m = face_at_m(T_rest_world @ raw.T_world_probe, FACE_M)
        signed_m = surface.signed_distance_m(face_m)
        # The nearest point stands for the first that touches, which is as near as they lie apart on what is curved.
        assert -1e-4 < signed_m.min() < 1e-4
        n_aslant += signed_m[0] > 3e-4
    # Many poses of a plan that is turned by 5 degrees are aslant.
    assert n_aslant >= 3


def test_a_face_that_touches_with_its_rim_tells_of_the_place_without_a_bias(liver, monkeypatch) -> None:
    errors_m = np.array([error_m(touched(liver, seed)) for seed in SEEDS])
    # 3 seeds tell the mean within 0.05 mm: the errors after 15 contacts have a deviation of 0.1 mm.
    assert np.linalg.norm(errors_m.mean(axis=0)) < 3e-4
    assert np.median(np.linalg.norm(errors_m, axis=1)) < 3e-4
    # The middle of the face, told in place of the point that touched, is off by the height of the rim.
    monkeypatch.setattr(RawReading, "touching_m", lambda raw, *_: raw.T_world_probe[:3, 3])
    assert np.median([np.linalg.norm(error_m(touched(liver, seed))) for seed in SEEDS[:1]]) > 1e-3


def test_an_organ_that_yields_is_touched_by_the_middle(sphere_setup) -> None:
    from sim.world.tissue.settings import ElasticSettings

    options = BodyOptions(settings=BodySettings(), tissue=ElasticSettings(), press_n=0.3)
    run = Episode(sphere_setup, make_planner("random"), seed=0, body=replace(options), tumour_map=None)
    surface = surface_distance_of(sphere_setup.organ)
    for _ in run.steps(2):
        assert abs(surface.signed_distance_m(run.body.indentation.contact.position_m[None])[0]) < 1e-6
