"""Predictions of maps that know a probability and no latent."""

import numpy as np
import pytest

from mapping import Prediction, dice, evaluate_map, log_loss
from mapping.prediction import LEAST_PROBABILITY


def test_a_probability_is_the_predictions_own_and_its_score_the_logit():
    probability = np.array([1e-9, 0.02, 0.5, 0.731, 1 - 1e-9])
    prediction = Prediction.from_probability(probability)
    # logit and sigmoid lose some units of the last digit of 1 - p.
    np.testing.assert_allclose(prediction.probability, probability, rtol=1e-12)
    np.testing.assert_allclose(prediction.score, np.log(probability) - np.log1p(-probability), rtol=1e-6)
    np.testing.assert_array_equal(prediction.latent_variance, 0.0)
    assert prediction.score[2] == 0.0


def test_certainty_is_clipped_and_stays_on_its_side():
    prediction = Prediction.from_probability([0.0, 1.0, np.float32(1.0)])
    assert np.isfinite(prediction.score).all()
    np.testing.assert_allclose(prediction.probability, [LEAST_PROBABILITY, 1.0, 1.0], atol=1e-11)
    # A wrong certainty costs -log(1e-12) = 27.6 nats and no more.
    assert log_loss(prediction.score, [1, 1, 1]) == pytest.approx(-np.log(LEAST_PROBABILITY) / 3, rel=1e-6)


def test_its_metrics_are_those_of_the_probability():
    rng = np.random.default_rng(0)
    probability, truth = rng.random(200), rng.random(200) < 0.3
    metrics = evaluate_map(Prediction.from_probability(probability), truth)
    assert metrics.brier_score == pytest.approx(np.mean((probability - truth) ** 2))
    assert metrics.dice == dice(probability > 0.5, truth)


def test_an_order_of_probabilities_is_an_order_of_scores():
    probability = np.sort(np.random.default_rng(1).random(500))
    assert (np.diff(Prediction.from_probability(probability).score) > 0).all()


@pytest.mark.parametrize("probability", [[0.5, 1.0001], [-1e-9, 0.5], [np.nan, 0.5]])
def test_what_is_no_probability_is_refused_with_its_point(probability):
    with pytest.raises(ValueError, match=r"between 0 and 1, but point \d has"):
        Prediction.from_probability(probability)


def test_a_probability_in_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(N,\), not \(2, 2\)"):
        Prediction.from_probability(np.full((2, 2), 0.5))


@pytest.mark.parametrize(
    ("mean", "variance"), [((3,), (2,)), ((3, 1), (3, 1)), ((), ())], ids=["lengths", "columns", "scalars"]
)
def test_mean_and_variance_that_do_not_fit_are_refused(mean, variance):
    with pytest.raises(ValueError, match="one latent_mean and one latent_variance per point"):
        Prediction(np.zeros(mean), np.zeros(variance))
