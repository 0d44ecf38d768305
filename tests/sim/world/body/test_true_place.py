"""The true place of an organ: as far off as it is said to be, and moved by breaths."""

from contextlib import suppress

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.errors import FieldError
from sim.world.body.breathing import REST_SHARE, inhaled_share, wait_for_rest_s
from sim.world.body.settings import BodySettings
from sim.world.body.true_place import TruePlace, measured

MIDDLE_M = np.array([0.4, 0.1, 0.05])


def place(seed=0, **settings) -> TruePlace:
    return TruePlace(BodySettings(**settings), MIDDLE_M, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_an_organ_is_off_by_what_is_asked_for(seed) -> None:
    T = place(seed, registration_m=0.012, registration_rad=0.1).T_world_rest(3.0)
    assert np.linalg.norm(T[:3, :3] @ MIDDLE_M + T[:3, 3] - MIDDLE_M) == pytest.approx(0.012)
    assert Rotation.from_matrix(T[:3, :3]).magnitude() == pytest.approx(0.1)


def test_seeds_draw_different_directions_and_one_seed_the_same() -> None:
    shifts = [place(seed, registration_m=0.01).T_world_rest(0.0)[:3, 3] for seed in (0, 0, 1)]
    assert np.array_equal(shifts[0], shifts[1])
    assert not np.allclose(shifts[0], shifts[2])


def test_a_breath_rests_at_exhale_and_comes_back() -> None:
    breathing = place(breathing_m=0.02, breathing_s=4.0, breathing_axis=(0.0, 0.0, -2.0))
    np.testing.assert_allclose(breathing.T_world_rest(0.0)[:3, 3], (0.0, 0.0, -0.02), atol=1e-12)
    np.testing.assert_allclose(breathing.T_world_rest(2.0), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(breathing.T_world_rest(1.3), breathing.T_world_rest(5.3), atol=1e-12)
    shares = np.array([inhaled_share(t, 4.0) for t in np.linspace(0.0, 4.0, 401)])
    # The mean of cos^6 is 5 / 16: the organ rests longer than it is moved.
    assert shares[:-1].mean() == pytest.approx(5.0 / 16.0, abs=1e-3)


@pytest.mark.parametrize("time_s", [0.0, 0.7, 1.9, 2.0, 3.5, 101.3])
def test_a_gated_probe_waits_until_the_organ_rests_and_no_longer(time_s) -> None:
    wait_s = wait_for_rest_s(time_s, 4.0)
    assert inhaled_share(time_s + wait_s + 1e-9, 4.0) <= REST_SHARE + 1e-6
    if wait_s > 0.0:
        assert inhaled_share(time_s + 0.98 * wait_s, 4.0) > REST_SHARE
    assert place(breathing_m=0.01, breathing_s=4.0).wait_s(time_s) == 0.0
    assert place(breathing_m=0.01, breathing_s=4.0, is_gated=True).wait_s(time_s) == wait_s


def test_a_tip_is_measured_as_far_off_as_it_is_said_to_be() -> None:
    rng, settings = np.random.default_rng(0), BodySettings(tracking_m=0.003, tracking_rad=0.02)
    told = np.array([measured(np.eye(4), settings, rng) for _ in range(2000)])
    assert told[:, :3, 3].std(axis=0) == pytest.approx([0.003] * 3, rel=0.06)
    assert Rotation.from_matrix(told[:, :3, :3]).as_rotvec().std(axis=0) == pytest.approx(
        [0.02] * 3, rel=0.06
    )


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ({"registration_m": -0.001}, "registration_mm"),
        ({"registration_m": 0.2}, "registration_mm"),
        ({"registration_rad": np.nan}, "registration_deg"),
        ({"tracking_m": 0.06}, "tracking_mm"),
        ({"breathing_s": 0.0}, "breathing_s"),
        ({"breathing_axis": (0.0, 0.0, 0.0)}, "breathing_axis"),
        ({"contact_search_m": -1.0}, "contact_search_mm"),
    ],
)
def test_what_cannot_be_is_an_error_that_names_it(wrong, name) -> None:
    with pytest.raises(FieldError, match=name):
        BodySettings(**wrong)


def test_an_organ_that_is_put_through_the_table_is_told() -> None:
    falls = {"breathing_m": 0.08, "breathing_axis": (0.0, 0.0, -1.0)}
    with pytest.raises(FieldError, match=r"breathing_mm=80.*planned 50 mm above.*30 mm below"):
        place(**falls)
    heights_m = {}
    for seed in range(12):
        with suppress(FieldError):
            heights_m[seed] = place(seed, registration_m=0.1).T_world_rest(0.0)[2, 3]
    # Every second direction points down, and half of these by more than the 50 mm that the middle lies high.
    assert 1 <= 12 - len(heights_m) <= 6
    assert min(heights_m.values()) >= -0.05
    through = next(seed for seed in range(12) if seed not in heights_m)
    with pytest.raises(FieldError, match="registration_mm=100"):
        place(through, registration_m=0.1)
