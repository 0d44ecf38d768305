"""The metrics on cases that can be worked out by hand."""

import numpy as np
import pytest

from mapping import (
    Prediction,
    average_precision,
    dice,
    evaluate_map,
    expected_calibration_error,
    log_loss,
    precision_recall_curve,
)


def test_average_precision_of_a_worked_example():
    # Ranked 1 0 1 0 1: precisions at the hits are 1, 2/3 and 3/5, each worth a third of the recall.
    score = [5.0, 4.0, 3.0, 2.0, 1.0]
    assert average_precision(score, [1, 0, 1, 0, 1]) == pytest.approx((1 + 2 / 3 + 3 / 5) / 3)


def test_ties_enter_together_whatever_their_order():
    truth = np.array([1, 0, 0, 0])
    assert average_precision(np.zeros(4), truth) == pytest.approx(0.25)
    assert average_precision(np.zeros(4), truth[::-1]) == pytest.approx(0.25)


def test_average_precision_agrees_with_a_count_per_threshold():
    rng = np.random.default_rng(0)
    truth = rng.random(300) < 0.1
    score = np.round(rng.normal(size=300) + truth, 1)
    recall_before, total = 0.0, 0.0
    for threshold in np.unique(score)[::-1]:
        called = score >= threshold
        recall = (called & truth).sum() / truth.sum()
        total += (recall - recall_before) * (called & truth).sum() / called.sum()
        recall_before = recall
    assert average_precision(score, truth) == pytest.approx(total)


def test_average_precision_is_none_without_an_occupied_point():
    assert average_precision([1.0, 2.0], [0, 0]) is None
    with pytest.raises(ValueError, match="recall is undefined"):
        precision_recall_curve([1.0, 2.0], [0, 0])


def test_a_perfect_ranking_has_precision_one_at_every_recall():
    curve = precision_recall_curve([3.0, 2.0, 1.0], [1, 1, 0])
    np.testing.assert_allclose(curve.precision, [1, 1, 1, 2 / 3])
    np.testing.assert_allclose(curve.recall, [0, 0.5, 1, 1])


def test_log_loss_does_not_saturate():
    assert log_loss([800.0], [0]) == pytest.approx(800.0)
    assert log_loss([0.0, 0.0], [0, 1]) == pytest.approx(np.log(2))


def test_calibration_error_of_a_known_miscalibration():
    rng = np.random.default_rng(1)
    probability = rng.uniform(0, 0.5, 20_000)
    calibrated = rng.random(20_000) < probability
    doubled = rng.random(20_000) < 2 * probability
    # Sampling noise of a bin of 1,333 points is about 0.012; the doubled truth lies 0.25 off on average.
    assert expected_calibration_error(probability, calibrated) < 0.02
    assert expected_calibration_error(probability, doubled) == pytest.approx(0.25, abs=0.02)


def test_calibration_of_one_constant_probability_does_not_depend_on_the_order():
    truth = np.repeat([0, 1], [90, 10])
    assert expected_calibration_error(np.full(100, 0.1), truth) == pytest.approx(0, abs=1e-12)


def test_dice_of_known_overlaps():
    assert dice([1, 1, 0], [1, 0, 0]) == pytest.approx(2 / 3)
    assert dice([0, 0], [0, 0]) is None


def test_evaluate_map_ranks_points_whose_probabilities_saturate():
    prediction = Prediction(np.array([900.0, 800.0, -5.0]), np.zeros(3))
    assert prediction.probability[0] == prediction.probability[1] == 1
    metrics = evaluate_map(prediction, [1, 0, 0])
    assert metrics.auprc == 1
    assert (metrics.n_points, metrics.n_occupied) == (3, 1)
    assert metrics.dice == pytest.approx(2 / 3)


def test_labels_that_are_no_labels_are_refused():
    with pytest.raises(ValueError, match="one label for each"):
        average_precision([1.0, 2.0], [1])
    with pytest.raises(ValueError, match="only False and True"):
        average_precision([1.0, 2.0], [1, 3])
