"""The belief over a long run: still a covariance, still what the readings say."""

import numpy as np
from dense_reference import dense_features

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((-0.03, -0.03, -0.035), (0.03, 0.03, 0.0))


def small_map(**changes):
    return HilbertMap(
        Lattice.from_box(*BOX_M, spacing_m=0.01125),
        MapSettings(**changes),
        query=Lattice.from_box(*BOX_M, spacing_m=0.006),
    )


def random_reading(rng, n_points=40):
    low_m = rng.uniform((-0.03, -0.03, -0.035), (0.01, 0.01, -0.02))
    points_m = low_m + rng.uniform(0, 0.02, (n_points, 3))
    return points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.01


def test_covariance_stays_symmetric_positive_definite_through_1000_readings():
    tumour_map = small_map()
    rng = np.random.default_rng(0)
    for _ in range(1000):
        tumour_map.update(*random_reading(rng))
    Sigma = tumour_map.belief.covariance.matrix
    np.testing.assert_array_equal(Sigma, Sigma.T)
    eigenvalues = np.linalg.eigvalsh(Sigma)
    # After 40,000 points the best-known direction keeps a variance of about 1e-4, far above the tolerance.
    assert eigenvalues[0] > 1e-6
    # No reading may raise a variance above the prior's.
    assert eigenvalues[-1] < tumour_map.settings.weight_variance + 1e-9


def test_1000_readings_equal_a_replay_from_scratch_with_their_lambdas():
    tumour_map = small_map(tolerance=0.0)
    hinges_m = tumour_map.hinges.points_m()
    precision = np.eye(len(hinges_m)) / tumour_map.settings.weight_variance
    information = np.zeros(len(hinges_m))
    prior_logit = np.log(tumour_map.settings.prior_prevalence / (1 - tumour_map.settings.prior_prevalence))
    rng = np.random.default_rng(1)
    for _ in range(1000):
        points_m, is_occupied = random_reading(rng)
        curvature = tumour_map.update(points_m, is_occupied).curvature
        Phi = dense_features(points_m, hinges_m, tumour_map.settings.gamma_per_m2)
        offset = prior_logit * np.sqrt(
            1 + np.pi / 8 * tumour_map.settings.weight_variance * (Phi**2).sum(axis=1)
        )
        precision += 2 * Phi.T @ (curvature[:, None] * Phi)
        information += Phi.T @ (is_occupied - 0.5 - 2 * curvature * offset)
    Sigma = np.linalg.inv(precision)
    # 1000 falls of the covariance round by 1e-16 of the prior's variance each; readings amplify that by what they know.
    np.testing.assert_allclose(tumour_map.belief.covariance.matrix, Sigma, atol=1e-9)
    np.testing.assert_allclose(tumour_map.belief.mean, Sigma @ information, atol=1e-7)
