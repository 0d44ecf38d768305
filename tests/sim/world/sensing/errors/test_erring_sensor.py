"""A reader that errs: each kind of error by itself, as large and as often as it was asked for."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import pdist
from scipy.stats import binomtest

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.errors import FieldError, UsageError
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.anatomy.structures import Structure
from sim.world.scene.scene import build_scene
from sim.world.sensing.cone_sensor import ConeSensor
from sim.world.sensing.errors.erring_sensor import ErringSensor
from sim.world.sensing.errors.lesion_views import lesion_of
from sim.world.sensing.errors.reader_errors import ReaderErrors
from sim.world.sensing.sensor import SceneState
from sim.world.solids.solid import Solid

ABOVE = Workspace(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
"""A pose at the top of the ball, whose cone lies in the ball as a whole."""
DENSE = ConeSensor(n_rays=300, n_points_per_ray=30)


def ball(radius_m: float, centre_m: tuple[float, float, float]) -> Solid:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_m)
    mesh.apply_translation(centre_m)
    return Solid.from_trimesh(mesh)


def state_of(cone, *, radius_m: float = 0.010, structures: tuple[Structure, ...] = ()) -> SceneState:
    """A ball of an organ with one tumour in the middle of the view."""
    organ, tumour = ball(0.06, (0.5, 0.0, 0.06)), ball(radius_m, (0.5, 0.0, 0.06))
    anatomy = build_anatomy(
        organ, (tumour,), name="ball", rng=np.random.default_rng(0), structures=structures
    )
    scene = build_scene(anatomy, cone, arm=None)
    data = scene.new_data()
    FreePositioner(scene, ABOVE).place(data, 0, is_lifted=False)
    return SceneState(scene, data)


@pytest.fixture(scope="module")
def state(cone) -> SceneState:
    return state_of(cone)


def read(state: SceneState, seed: int = 0, exact: ConeSensor | None = None, **errors):
    sensor = ErringSensor(errors=ReaderErrors(**errors), exact=exact or ConeSensor())
    return sensor.sense(state, np.random.default_rng(seed))


def truth_of(state: SceneState, points_m):
    return state.scene.anatomy.is_tumour(points_m)


def test_without_errors_it_reads_what_the_exact_sensor_reads(state) -> None:
    """To the byte, so that errors of size zero change nothing in an episode."""
    exact, own = ConeSensor().sense(state, np.random.default_rng(5)), read(state, 5)
    assert own.points_m.tobytes() == exact.points_m.tobytes()
    assert np.array_equal(own.is_occupied, exact.is_occupied)
    assert np.array_equal(own.T_world_probe, exact.T_world_probe)


def test_the_same_seed_reads_the_same_and_another_does_not(state) -> None:
    errors = {"flipped_free": 0.1, "missed_share": 0.5, "boundary_m": 0.002, "false_blobs": 1.0}
    first, again, other = (read(state, seed, **errors) for seed in (1, 1, 2))
    assert np.array_equal(first.is_occupied, again.is_occupied)
    assert not np.array_equal(first.is_occupied, other.is_occupied)


def test_points_are_flipped_at_their_rates(state) -> None:
    readings = [read(state, seed, DENSE, flipped_free=0.03, flipped_tumour=0.2) for seed in range(4)]
    is_tumour = np.concatenate([truth_of(state, each.points_m) for each in readings])
    called = np.concatenate([each.is_occupied for each in readings])
    for wrong, rate in ((called[~is_tumour], 0.03), (~called[is_tumour], 0.2)):
        assert binomtest(int(wrong.sum()), len(wrong), rate).pvalue > 1e-3


def test_a_lesion_is_missed_as_a_whole_and_as_often_as_asked(state) -> None:
    is_missed = []
    for seed in range(300):
        reading = read(state, seed, missed_share=0.3, missed_size_power=1.0)
        is_tumour = truth_of(state, reading.points_m)
        assert not reading.is_occupied.any() or np.array_equal(reading.is_occupied, is_tumour)
        is_missed.append(not reading.is_occupied.any())
    # A lesion of 20 mm is missed half as often as one of 10 mm.
    assert binomtest(sum(is_missed), 300, 0.15).pvalue > 1e-3


def test_deeper_lesions_are_missed_more_often(state) -> None:
    """The lesion's nearest point lies 50 mm below the tip, so exp(20 * 0.05) is e."""
    is_missed = [
        not read(state, seed, missed_share=0.2, missed_per_m=20.0).is_occupied.any() for seed in range(300)
    ]
    assert binomtest(sum(is_missed), 300, 0.2 * np.e).pvalue > 1e-3


@pytest.fixture(scope="module")
def straying(state):
    """Readings of 80 views whose outlines stray by 2 mm."""
    return [read(state, seed, DENSE, boundary_m=0.002) for seed in range(80)]


def test_the_outline_strays_by_its_standard_deviation(straying) -> None:
    """Along a ray the outline that is drawn lies where labels change, which is measured against the ball's radius."""
    strays_m = []
    for reading in straying[:60]:
        away_m = np.linalg.norm(reading.points_m - (0.5, 0.0, 0.06), axis=1)
        # The mean volume of what was drawn gives its mean radius in the view.
        inside = reading.is_occupied.sum() / np.clip((away_m < 0.01).sum(), 1, None)
        strays_m.append(0.010 * (inside ** (1 / 3) - 1))
        wrong_m = away_m[reading.is_occupied != (away_m < 0.01)]
        assert np.abs(wrong_m - 0.01).max(initial=0.0) < 4.5 * 0.002
    # The mean over the ball strays less than a place of the outline, since the field is 10 mm long.
    assert 0.0007 < np.std(strays_m) < 0.002
    assert abs(np.mean(strays_m)) < 0.0008


def test_single_places_of_the_outline_stray_by_the_deviation(straying) -> None:
    """Far from the outline in deviations d / s the chance of a wrong label is Phi(-d / s)."""
    wrong, deviations = [], []
    for reading in straying:
        outside_m = np.linalg.norm(reading.points_m - (0.5, 0.0, 0.06), axis=1) - 0.01
        near = (outside_m > 0.0015) & (outside_m < 0.0025)
        wrong.append(reading.is_occupied[near].mean())
        deviations.append(outside_m[near].mean())
    # Phi(-1) is 0.159; the field's waves make views differ widely, so the mean over views has an error of some 0.03.
    assert np.mean(wrong) == pytest.approx(0.159, abs=0.07)
    assert np.mean(deviations) == pytest.approx(0.002, abs=1e-4)


def test_what_views_share_of_an_outline_no_view_corrects(state) -> None:
    points = ConeSensor(n_rays=200, n_points_per_ray=20)

    def drawn(shared: float, seed: int):
        # The same points in every view: only the reader's draws differ.
        return ErringSensor(
            errors=ReaderErrors(boundary_m=0.003, boundary_shared=shared), exact=_Same(points)
        ).sense(state, np.random.default_rng(seed))

    assert np.array_equal(drawn(1.0, 1).is_occupied, drawn(1.0, 2).is_occupied)
    assert not np.array_equal(drawn(0.5, 1).is_occupied, drawn(0.5, 2).is_occupied)
    assert not np.array_equal(drawn(1.0, 1).is_occupied, truth_of(state, drawn(1.0, 1).points_m))


class _Same(ConeSensor):
    """A sensor whose points do not depend on the seed."""

    def __init__(self, inner: ConeSensor) -> None:
        super().__init__(n_rays=inner.n_rays, n_points_per_ray=inner.n_points_per_ray)

    def sense(self, state, rng):
        return super().sense(state, np.random.default_rng(0))


def test_false_blobs_are_balls_of_their_size_and_number(cone) -> None:
    state = state_of(cone, radius_m=0.003)
    n_blobs, sizes_m = 0, []
    for seed in range(150):
        reading = read(state, seed, DENSE, false_blobs=0.5, false_blob_radius_m=0.005)
        false_m = reading.points_m[reading.is_occupied & ~truth_of(state, reading.points_m)]
        if len(false_m):
            n_blobs += 1
            sizes_m.append(pdist(false_m).max() / 2.0)
    # A Poisson number of mean 1/2 is none with the chance exp(-1/2).
    assert binomtest(n_blobs, 150, 1.0 - np.exp(-0.5)).pvalue > 1e-3
    assert 0.004 < np.quantile(sizes_m, 0.3) < 0.007


def test_what_lies_too_deep_is_left_out_and_not_called_free(state) -> None:
    reading = read(state, penetration_m=0.05)
    depth_m = 0.12 - reading.points_m[:, 2]
    assert 0.045 < depth_m.max() <= 0.05
    assert len(reading.points_m) < len(read(state).points_m)


def test_a_structure_hides_what_lies_behind_it(cone) -> None:
    """A plate 20 mm below the tip, over the half of the view with positive x."""
    plate = trimesh.creation.box((0.06, 0.1, 0.002))
    plate.apply_translation((0.53, 0.0, 0.1))
    rib = Structure(name="rib", solid=Solid.from_trimesh(plate))
    state = state_of(cone, structures=(rib,))
    everything = ErringSensor().sense(state, np.random.default_rng(3))
    seen = ErringSensor(shadowing=("rib",)).sense(state, np.random.default_rng(3))
    below = everything.points_m[:, 2] < 0.101
    is_behind = below & (everything.points_m[:, 0] > 0.5)
    assert {tuple(each) for each in seen.points_m} == {
        tuple(each) for each in everything.points_m[~is_behind]
    }


def test_a_shadow_of_nothing_is_an_error_that_names_what_there_is(state) -> None:
    with pytest.raises(FieldError, match="it has no structures"):
        ErringSensor(shadowing=("rib",)).sense(state, np.random.default_rng(0))


def test_one_kind_of_error_does_not_change_another(state) -> None:
    flips = read(state, 7, flipped_free=0.05)
    both = read(state, 7, flipped_free=0.05, false_blobs=0.0, boundary_m=0.001)
    far = np.linalg.norm(flips.points_m - (0.5, 0.0, 0.06), axis=1) > 0.02
    assert np.array_equal(flips.is_occupied[far], both.is_occupied[far])


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"missed_share": 1.5}, "`missed_share` must be from 0 to 1, not 1.5"),
        ({"boundary_m": float("nan")}, "`boundary_m` must be 0 or more and finite, not nan"),
        ({"penetration_m": 0.0}, "`penetration_m` must be above 0, not 0"),
        ({"flipped_free": 0.6, "flipped_tumour": 0.5}, "add up to less than 1"),
    ],
)
def test_a_value_out_of_range_is_named(wrong, text) -> None:
    with pytest.raises(UsageError, match=text):
        ReaderErrors(**wrong)


def test_no_lesion_is_missed_more_often_than_always(state) -> None:
    """However small and deep it is; a larger one still is missed with less than certainty."""
    lesion = lesion_of(state.scene.anatomy.tumours[0])
    errors = ReaderErrors(missed_share=0.5, missed_size_power=2.0, missed_per_m=100.0)
    assert lesion.chance_of_miss(errors, 0.1) == 1.0
    assert lesion.chance_of_miss(errors, 0.0) == pytest.approx(
        0.5 / 4.0, rel=0.02
    )  # the mesh is a little small
