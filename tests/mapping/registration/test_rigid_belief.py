"""The belief about where an organ lies finds planted moves, and is as sure as it is right."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from mapping.registration import Contact, RigidBelief, RigidPrior

SHIFT_M = np.array([0.004, 0.0, 0.0])
AXES_M = np.array([0.09, 0.06, 0.04])


def ellipsoid(points_m):
    """Signed distance to an ellipsoid, to first order, and its outward normals: an oracle without a mesh."""
    level = np.sqrt(((points_m / AXES_M) ** 2).sum(axis=1))
    slope = points_m / AXES_M**2 / level[:, None]
    size = np.linalg.norm(slope, axis=1)
    return (level - 1.0) / size, slope / size[:, None]


def with_its_slope(points_m):
    """The same distance with its exact slope, for who follows it to the least of a function."""
    steps_m = 1e-7 * np.eye(3)
    ahead, behind = (
        np.stack([ellipsoid(points_m + way * step_m)[0] for step_m in steps_m], axis=1) for way in (1, -1)
    )
    return ellipsoid(points_m)[0], (ahead - behind) / 2e-7


def surface_points_m(rng, n, *, upper=True):
    way = rng.standard_normal((n, 3))
    if upper:
        way[:, 2] = np.abs(way[:, 2])
    return way / np.linalg.norm(way, axis=1, keepdims=True) * AXES_M


def moved(points_m, turn_rad, shift_m):
    return Rotation.from_rotvec(turn_rad).apply(points_m) + shift_m


def a_move(rng, shift_m=0.012, turn_rad=0.0873):
    shift, turn = rng.standard_normal((2, 3))
    return turn_rad * turn / np.linalg.norm(turn), shift_m * shift / np.linalg.norm(shift)


@pytest.mark.parametrize("seed", range(4))
def test_a_planted_move_is_found(seed) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = a_move(rng)
    belief = RigidBelief(ellipsoid, np.zeros(3))
    for point_m in surface_points_m(rng, 30, upper=False):
        belief.observe(Contact(moved(point_m[None], turn, shift)[0]))
    T = belief.T_world_rest()
    inner_m = 0.5 * surface_points_m(rng, 20, upper=False)
    off_m = inner_m @ T[:3, :3].T + T[:3, 3] - moved(inner_m, turn, shift)
    assert np.linalg.norm(off_m, axis=1).max() < 0.0005


def test_a_breath_is_told_from_a_shift() -> None:
    rng = np.random.default_rng(7)
    shift, breath = np.array([0.003, -0.004, 0.002]), np.array([0.0, 0.009, 0.002])
    belief = RigidBelief(ellipsoid, np.zeros(3), RigidPrior(turn_rad=1e-4, breath_m=0.01))
    for point_m, share in zip(surface_points_m(rng, 40, upper=False), rng.random(40), strict=True):
        belief.observe(Contact(point_m + shift + share * breath, share))
    np.testing.assert_allclose(belief.mean[3:6], shift, atol=5e-4)
    np.testing.assert_allclose(belief.mean[6:], breath, atol=1e-3)


def test_the_mean_is_the_least_of_the_posterior_that_the_docs_write_down() -> None:
    rng = np.random.default_rng(3)
    turn, shift = a_move(rng, 0.006, 0.05)
    prior, noise_m = RigidPrior(), 0.001
    contacts_m = moved(surface_points_m(rng, 12), turn, shift) + noise_m * rng.standard_normal((12, 3))
    belief = RigidBelief(with_its_slope, np.zeros(3), prior)
    for contact_m in contacts_m:
        belief.observe(Contact(contact_m, noise_m=noise_m))
    sigma = np.hypot(noise_m, prior.surface_m)

    def cost(x):
        rest_m = Rotation.from_rotvec(x[:3]).inv().apply(contacts_m - x[3:])
        fit = 3.0 * np.log1p((ellipsoid(rest_m)[0] / sigma) ** 2 / 5.0).sum()
        return (
            fit + 0.5 * (x[:3] ** 2).sum() / prior.turn_rad**2 + 0.5 * (x[3:] ** 2).sum() / prior.shift_m**2
        )

    options = {"xatol": 1e-8, "fatol": 1e-10, "maxiter": 40_000, "maxfev": 40_000}
    found = minimize(cost, belief.mean[:6], method="Nelder-Mead", options=options)
    assert cost(belief.mean[:6]) <= found.fun + 1e-3


def test_of_the_truths_nineteen_in_twenty_lie_in_the_ellipsoid_of_95_per_cent() -> None:
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        # Moves as the prior draws them.
        turn, shift = np.deg2rad(2.0) * rng.standard_normal(3), 0.004 * rng.standard_normal(3)
        prior = RigidPrior(shift_m=0.004, turn_rad=np.deg2rad(2.0), surface_m=1e-4)
        belief = RigidBelief(ellipsoid, np.zeros(3), prior)
        for point_m in surface_points_m(rng, 8):
            contact_m = moved(point_m[None], turn, shift)[0] + 0.001 * rng.standard_normal(3)
            belief.observe(Contact(contact_m, noise_m=0.001))
        place_m, T = np.array([[0.02, 0.01, 0.0]]), belief.T_world_rest()
        off_m = (place_m @ T[:3, :3].T + T[:3, 3] - moved(place_m, turn, shift))[0]
        inside.append(off_m @ np.linalg.solve(belief.place_covariance_m2(place_m)[0], off_m) <= 7.815)
    assert 53 <= sum(inside) <= 60


def test_what_no_contact_tells_stays_as_uncertain_as_it_was() -> None:
    """On a ball the probe can slide about, and nothing is learnt of the turn."""
    belief = RigidBelief(
        lambda points_m: (
            np.linalg.norm(points_m, axis=1) - 0.05,
            points_m / np.linalg.norm(points_m, axis=1, keepdims=True),
        ),
        np.zeros(3),
    )
    way = np.random.default_rng(0).standard_normal((30, 3))
    for point_m in 0.05 * way / np.linalg.norm(way, axis=1, keepdims=True):
        belief.observe(Contact(point_m + SHIFT_M))
    np.testing.assert_allclose(belief.mean[3:6], (0.004, 0.0, 0.0), atol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance))[:3], RigidPrior().turn_rad, rtol=1e-3)


def test_one_contact_that_is_far_off_hardly_counts() -> None:
    rng = np.random.default_rng(1)
    belief = RigidBelief(ellipsoid, np.zeros(3))
    for point_m in surface_points_m(rng, 20, upper=False):
        belief.observe(Contact(point_m))
    belief.observe(Contact(np.array([0.0, 0.0, 0.06])))
    assert np.abs(belief.mean[3:6]).max() < 0.0007


def test_a_tip_is_set_right_across_the_surface_and_not_along_it() -> None:
    belief = RigidBelief(ellipsoid, np.zeros(3), RigidPrior(shift_m=1e-5, turn_rad=1e-5, surface_m=1e-4))
    belief.observe(Contact(np.array([0.003, 0.0, 0.044]), noise_m=0.003))
    (correction_m,) = belief.tip_corrections_m()
    assert correction_m[2] == pytest.approx(-0.004, abs=1e-4)
    assert np.abs(correction_m[:2]).max() < 5e-4


def test_what_a_contact_is_expected_to_tell_is_what_it_tells_when_it_comes() -> None:
    rng, noise_m = np.random.default_rng(4), 0.002
    prior = RigidPrior(shift_m=0.01, turn_rad=0.08, breath_m=0.004)
    belief = RigidBelief(with_its_slope, np.zeros(3), prior)
    turn, shift = a_move(rng)
    for at_m in moved(surface_points_m(rng, 6), turn, shift):
        belief.observe(Contact(at_m, noise_m=noise_m))
    points_m, some_m = rng.uniform(-0.04, 0.04, (50, 3)), surface_points_m(rng, 5, upper=False)

    def off_m2():
        return np.trace(belief.place_covariance_m2(points_m), axis1=1, axis2=2).mean()

    # At no distance a contact of Student's t with 5 degrees of freedom counts as 6/5 of a Gaussian's.
    as_told_m = np.sqrt((noise_m**2 + prior.surface_m**2) / 1.2 - prior.surface_m**2)
    gains_m2 = belief.contact_gains_m2(some_m, with_its_slope(some_m)[1], points_m, noise_m=as_told_m)
    T, known, before_m2 = belief.T_world_rest(), list(belief.contacts), off_m2()
    for rest_m, gain_m2 in zip(some_m, gains_m2, strict=True):
        # It meets the surface where that is believed to lie, which leaves the mean as it is.
        belief.observe(Contact(T[:3, :3] @ rest_m + T[:3, 3], noise_m=noise_m))
        assert before_m2 - off_m2() == pytest.approx(gain_m2, rel=0.02)
        belief.relearn(known)
    assert (gains_m2 > 0.0).all()
    assert gains_m2.max() > 2.0 * gains_m2.min()
