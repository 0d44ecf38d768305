"""An episode with an organ that is not where it was planned: contact, the frame of readings, and the belief."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mapping import DetailSettings, average_precision, make_hilbert_map, teach
from planner import make_planner
from sim.episode.body_options import BodyOptions
from sim.episode.episode import Episode
from sim.episode.moving.motion import Phase
from sim.episode.yielding import RawReading
from sim.world.body.contact import face_at_m
from sim.world.body.settings import BodySettings
from sim.world.errors import WorldError
from sim.world.frames import rigid_inverse
from sim.world.motion.settings import FACE_M
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import surface_distance_of
from sim.world.tissue.settings import ElasticSettings

OFF = {"registration_m": 0.008, "registration_rad": np.deg2rad(3.0)}


def episode(setup, *, registration="contacts", planner="random", seed=0, **settings) -> Episode:
    body = BodyOptions(settings=BodySettings(**settings), registration=registration)
    return Episode(setup, make_planner(planner), seed=seed, body=body)


def test_the_probe_comes_down_to_where_the_organ_truly_is(sphere_setup) -> None:
    run, surface = episode(sphere_setup, **OFF), surface_distance_of(sphere_setup.organ)
    for step in run.steps(4):
        T_rest_world = rigid_inverse(run.body.place.T_world_rest(run.body.sensed_s))
        face_m = face_at_m(T_rest_world @ run.body._planned.T_world_probe, FACE_M)
        np.testing.assert_allclose(run.body._raw[-1].T_world_probe[:3, 3], step.motion.tips_m[-1], atol=1e-9)
        assert abs(surface.signed_distance_m(face_m).min()) < 1e-4


def test_labels_are_true_where_the_organ_truly_is(sphere_setup) -> None:
    """With nothing learnt, a reading tells of places beside the plan, and its labels are right of where those lie."""
    run = episode(sphere_setup, registration="none", seed=3, **OFF)
    anatomy, n_tumour = run.truth.anatomy, 0
    for step in run.steps(12):
        T_rest_world = rigid_inverse(run.body.place.T_world_rest(run.body.sensed_s))
        rest_m = step.reading.points_m @ T_rest_world[:3, :3].T + T_rest_world[:3, 3]
        np.testing.assert_array_equal(step.reading.is_occupied, anatomy.is_tumour(rest_m))
        assert anatomy.is_inside_organ(rest_m).all()
        n_tumour += step.reading.is_occupied.sum()
        assert step.body.registration_within_share is None
    assert n_tumour > 0


def test_readings_of_a_scattering_tip_are_laid_where_they_fit_each_other(sphere_setup) -> None:
    def n_wrong(**options) -> int:
        body = BodyOptions(settings=BodySettings(tracking_m=0.003), **options)
        run = Episode(sphere_setup, make_planner("find-and-outline"), seed=1, body=body)
        for _ in run.steps(12):
            pass
        is_tumour = run.truth.anatomy.is_tumour
        return sum(int((is_tumour(each.points_m) != each.is_occupied).sum()) for each in run.readings)

    assert n_wrong() < 0.7 * n_wrong(aligns_readings=False)


def test_contacts_tell_where_the_organ_lies(sphere_setup) -> None:
    run = episode(sphere_setup, **OFF)
    scores = [step.body for step in run.steps(25)]
    assert scores[-1].registration_error_m < 0.4 * scores[0].registration_error_m
    # Turned about its middle, this organ nearly fits itself, and the belief says so.
    assert scores[-1].registration_error_m < 0.003
    assert scores[-1].registration_error_m < 2.5 * scores[-1].registration_deviation_m


def test_a_map_that_is_laid_anew_is_that_of_all_readings_where_they_now_lie(sphere_setup) -> None:
    run = episode(sphere_setup, **OFF)
    for _ in run.steps(6):
        pass
    fresh = make_hilbert_map(sphere_setup.map_space(run._map_settings, None))
    for reading in run.readings:
        teach(fresh, reading)
    off = np.abs(fresh.predict_lattice().probability - run.prediction.probability).max()
    assert off < 1e-6


def test_a_belief_that_is_right_gives_the_readings_of_an_organ_that_lies_as_planned(sphere_setup) -> None:
    """The body is a change of frame: an organ that only breathes, sensed at exhale, is where it was planned."""
    still = Episode(sphere_setup, make_planner("random"), seed=1)
    gated = episode(
        sphere_setup,
        registration="none",
        seed=1,
        breathing_m=0.02,
        breathing_axis=(0.0, 0.0, 1.0),
        is_gated=True,
    )
    for plain, other in zip(still.steps(4), gated.steps(4), strict=True):
        assert plain.pose_index == other.pose_index
        # The rest at exhale is within 2 % of the way.
        np.testing.assert_allclose(
            plain.reading.T_world_probe[:3, 3], other.reading.T_world_probe[:3, 3], atol=0.0006
        )


def test_a_gated_probe_waits_and_the_time_counts(sphere_setup) -> None:
    run = episode(sphere_setup, registration="none", breathing_m=0.01, is_gated=True)
    steps = list(run.steps(5))
    assert any(step.motion.phases[-1] == Phase.HOLD for step in steps)


@pytest.mark.parametrize("is_gated", [False, True])
def test_the_probe_senses_when_its_motion_has_ended(sphere_setup, is_gated) -> None:
    """The way down counts: the organ breathes meanwhile, and the tip is on its surface where that is in the end."""
    run = episode(sphere_setup, breathing_m=0.02, is_gated=is_gated, **OFF)
    surface, before_s = surface_distance_of(sphere_setup.organ), 0.0
    for step in run.steps(5):
        # The time of contact is found to a millisecond, in which the organ moves by up to 0.03 mm.
        assert run.body.sensed_s == pytest.approx(before_s + step.motion.motion_s, abs=0.002)
        assert run.body.encounter.places_during(step.motion)[-1] == pytest.approx(run.body.T_world_rest)
        T_rest_probe = run.body.state().T_world_probe
        tip_m = rigid_inverse(run.body.T_world_rest) @ np.append(step.motion.tips_m[-1], 1.0)
        assert T_rest_probe[:3, 3] == pytest.approx(tip_m[:3], abs=1e-6)
        face_m = face_at_m(T_rest_probe, FACE_M)
        assert abs(surface.signed_distance_m(face_m).min()) < 1e-5
        before_s += step.procedure_s


def test_a_pose_without_contact_is_skipped_with_its_reason(sphere_setup) -> None:
    run = episode(sphere_setup, registration="none", registration_m=0.05, contact_search_m=0.0, seed=0)
    steps = list(run.steps(3))
    reasons = [skipped.reason for step in steps for skipped in step.skipped]
    assert reasons
    assert all("met no organ from 40 mm above to 0 mm below" in reason for reason in reasons)


def test_an_arm_follows_the_organ(sphere_arm_setup) -> None:
    run, site = episode(sphere_arm_setup, **OFF), sphere_arm_setup.scene.tip_site
    surface = surface_distance_of(sphere_arm_setup.organ)
    for step in run.steps(3):
        T_rest_world = rigid_inverse(run.body.place.T_world_rest(run.body.sensed_s))
        T_world_tip = np.eye(4)
        tip = run.data.site(site)
        T_world_tip[:3, :3], T_world_tip[:3, 3] = tip.xmat.reshape(3, 3), tip.xpos
        face_m = face_at_m(T_rest_world @ T_world_tip, FACE_M)
        assert abs(surface.signed_distance_m(face_m).min()) < 2e-4
        assert np.all(np.diff(step.motion.time_s) > 0.0)


def test_the_same_seed_gives_the_same_body(sphere_setup) -> None:
    runs = [list(episode(sphere_setup, tracking_m=0.003, **OFF).steps(3)) for _ in range(2)]
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.reading.points_m, other.reading.points_m)
    noisy = BodySettings(tracking_m=0.003, **OFF)
    assert replace(noisy, tracking_m=0.0) == BodySettings(**OFF)


def test_small_moves_of_the_belief_leave_the_coarse_map_and_large_ones_do_not(sphere_setup) -> None:
    body = BodyOptions(settings=BodySettings(registration_m=0.008))
    run = Episode(sphere_setup, make_planner("random"), seed=2, detail=DetailSettings(), body=body)
    for _ in run.steps(3):
        pass
    belief, way_m = run.body.belief, np.array([0.0, 0.0, -0.0012])
    belief.covariance = belief.covariance * 1e-9
    # There and back, so that all lies where it is believed.
    for much_m in (-0.005, 0.005):
        belief.mean[5] += much_m
        run._learn(run.readings[-1:])
    coarse, before = run.tumour_map.coarse, run.readings
    for n_moves, is_new in ((1, False), (2, True), (3, False)):
        belief.mean[3:6] -= way_m
        run._learn(run.readings[-1:])
        for was, now, mine in zip(before, run.readings, run.tumour_map._readings, strict=True):
            np.testing.assert_allclose(now.points_m, was.points_m + n_moves * way_m, atol=1e-9)
            np.testing.assert_array_equal(mine.points_m, now.points_m)
        assert (run.tumour_map.coarse is not coarse) == is_new
        coarse = run.tumour_map.coarse
        # The second move took all 2.4 mm; the third leaves what that laid.
        n_laid = 0 if n_moves == 1 else 2
        for was, held in zip(before, coarse.belief.held, strict=True):
            np.testing.assert_allclose(held.points_m, was.points_m + n_laid * way_m, atol=1e-9)


def elastic(setup, *, registration="contacts", seed=0, press_n=0.5, **settings) -> Episode:
    body = BodyOptions(
        settings=BodySettings(**settings),
        registration=registration,
        tissue=ElasticSettings(),
        press_n=press_n,
    )
    return Episode(setup, make_planner("random"), seed=seed, body=body)


def test_a_probe_presses_with_its_force_and_goes_in(sphere_setup) -> None:
    run, surface = elastic(sphere_setup), surface_distance_of(sphere_setup.organ)
    for step in run.steps(3):
        depth_m = run.body.indentation.depth_m
        assert run.body.indentation.force_n == pytest.approx(0.5)
        assert 0.001 < depth_m < 0.03
        tip_m, beam = step.motion.tips_m[-1], sphere_setup.workspace.normals[step.pose_index]
        assert abs(surface.signed_distance_m((tip_m - depth_m * beam)[None])[0]) < 2e-4


def test_what_yields_is_told_where_it_lies_under_the_probe_and_taken_back(sphere_setup) -> None:
    """The plan's frame has the points where they lie pressed; the belief, which knows no tumours, takes them back."""
    pressed, released = (elastic(sphere_setup, registration=way, seed=4) for way in ("none", "contacts"))
    rest = Episode(sphere_setup, make_planner("random"), seed=4)
    runs = [list(run.steps(3)) for run in (rest, pressed, released)]
    for still, deep, back in zip(*runs, strict=True):
        np.testing.assert_array_equal(still.reading.is_occupied, deep.reading.is_occupied)
        moved_m, left_m = (
            np.linalg.norm(each.reading.points_m - still.reading.points_m, axis=1) for each in (deep, back)
        )
        most = np.argsort(moved_m)[-50:]
        assert moved_m[most].mean() > 0.001
        assert left_m[most].mean() < 0.3 * moved_m[most].mean()


def test_a_force_beyond_what_tissue_bears_is_told_at_once(sphere_setup) -> None:
    with pytest.raises(WorldError, match=r"`press_n` of 40 N.*press with at most 5\.\d N"):
        elastic(sphere_setup, press_n=40.0)


def test_contacts_are_released_again_where_the_belief_has_moved(sphere_setup) -> None:
    """How deep the tip had pressed follows from where the organ lies, which is learnt from how deep it had pressed."""
    run = elastic(sphere_setup, registration_m=0.008)
    scores = [step.body for step in run.steps(25)]
    assert scores[-1].registration_error_m < 0.004
    assert scores[-1].registration_error_m < 2.5 * scores[-1].registration_deviation_m


def test_a_press_is_kept_while_the_belief_hardly_moves_and_follows_it_when_it_does(sphere_setup) -> None:
    run = elastic(sphere_setup, registration_m=0.008)
    for _ in run.steps(2):
        pass
    raw, organ, T = run.body._raw[0], run.body.yielding, run.body.T_world_rest_believed(0.0)
    kept_m, _, depth_m = raw.released(organ, T)
    worked_out: list[float] = []
    undone = organ.undone

    def counted(*arguments, **more):
        worked_out.append(1.0)
        return undone(*arguments, **more)

    organ.undone = counted
    near, far = T.copy(), T.copy()
    near[:3, 3] += 0.0005
    far[:3, 3] += 0.004
    assert raw.released(organ, near)[2] == depth_m
    assert not worked_out
    moved_m, _, moved_depth_m = raw.released(organ, far)
    assert worked_out == [1.0]
    # As if the press had never been worked out elsewhere: the depth before is only where the search begins.
    afresh_m, _, afresh_depth_m = RawReading(raw.T_world_probe, raw.points_m, raw.share).released(organ, far)
    assert moved_depth_m == pytest.approx(afresh_depth_m, abs=0.0003)
    assert np.abs(moved_m - afresh_m).max() < 0.0005
    assert np.abs(moved_m - kept_m).max() > 0.0


def test_a_second_class_moves_with_the_organ(sphere_setup) -> None:
    middle_m = sphere_setup.search_points_m[sphere_setup.surface_distance_m.argmax()]
    cyst = Solid.from_trimesh(
        trimesh.creation.icosphere(subdivisions=2, radius=0.03).apply_translation(middle_m)
    )
    run = episode(replace(sphere_setup, given_targets=(cyst,), target_names=("cyst",)), **OFF)
    for step in run.steps(6):
        # It is scored by the readings where they lie now, also where they were just laid anew.
        score = run.target.prediction.score
        assert step.target.auprc == average_precision(score, run.target.truth.is_target)
        fresh = run._new_map()
        for reading in run.target.readings:
            fresh.update(reading.points_m, reading.is_occupied)
        np.testing.assert_allclose(fresh.predict_lattice().score, score, atol=1e-6)
    assert any(reading.is_occupied.any() for reading in run.target.readings)
    for own, reading in zip(run.target.readings, run.readings, strict=True):
        np.testing.assert_array_equal(own.points_m, reading.points_m)


def test_actions_are_spent_on_registering_until_the_place_is_known(sphere_setup) -> None:
    def scores(above_m):
        body = BodyOptions(settings=BodySettings(tracking_m=0.002, **OFF), register_above_m=above_m)
        run = Episode(sphere_setup, make_planner("random"), seed=0, body=body)
        places = [run.situation().place]
        steps = []
        for step in run.steps(4):
            steps.append(step)
            places.append(run.situation().place)
        return steps, places

    steps, places = scores(0.001)
    asked, seen = scores(np.inf)
    assert steps[0].pose_index == places[0].contact_gains_m2().argmax()
    # What planners see is what the belief says, and contacts that tell most make it sure sooner.
    assert places[-1].deviation_m < seen[-1].deviation_m < seen[0].deviation_m
    # A place that is known well enough leaves the choice to the planner.
    known, _ = scores(0.1)
    assert [step.pose_index for step in known] == [step.pose_index for step in asked]
