"""Probabilities from replicates, and their scores."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsr2.analysis import (
    classification_intervals,
    overturning_probability,
    probability_intervals,
    reliability,
)
from vsr2.analysis.probability import PROBABILITY_SCORES, probability_error
from vsr2.errors import ResultError

NAN = math.nan


def test_the_rule_is_jeffreys() -> None:
    ends = np.array([[1, 0, 1, NAN], [1, 0, 0, NAN], [1, 0, NAN, NAN]])
    np.testing.assert_allclose(overturning_probability(ends), [3.5 / 4, 0.5 / 4, 1.5 / 3, 0.5])
    # The standard deviation of a beta distribution of k + 1/2 and n - k + 1/2.
    from scipy.stats import beta

    expected = [beta(k + 0.5, n - k + 0.5).std() for k, n in ((3, 3), (0, 3), (1, 2), (0, 0))]
    np.testing.assert_allclose(probability_error(ends), expected)


def test_scores_are_those_of_the_definitions() -> None:
    rng = np.random.default_rng(1)
    p = rng.uniform(0.01, 0.99, 400)
    truth = rng.random(400) < p
    motions = np.arange(400) // 5
    found = probability_intervals(truth, p, motions, replicates=400)
    assert tuple(found) == PROBABILITY_SCORES
    loss = -np.log(np.where(truth, p, 1 - p))
    assert found["log_loss"].value == pytest.approx(loss.mean())
    assert found["brier"].value == pytest.approx(np.mean((p - truth) ** 2))
    # Motions are drawn as a whole: the error of a mean of clusters.
    clusters = loss.reshape(-1, 5).mean(axis=1)
    error = clusters.std() / math.sqrt(len(clusters))
    assert found["log_loss"].standard_error == pytest.approx(error, rel=0.2)
    assert found["log_loss"].low < found["log_loss"].value < found["log_loss"].high
    same = classification_intervals(truth, p > 0.5, motions, replicates=400)
    assert {name: found[name] for name in same} == same


def test_one_half_is_not_predicted_to_overturn() -> None:
    found = probability_intervals(np.array([True, False]), [0.5, 0.5], ["a", "b"], replicates=100)
    assert found["accuracy"].value == 0.5
    assert found["recall"].value == 0.0


def test_the_calibration_curve_of_right_probabilities_is_the_diagonal() -> None:
    rng = np.random.default_rng(2)
    p = rng.uniform(0.02, 0.98, 3000)
    truth = rng.random(3000) < p
    curve = reliability(truth, p, np.arange(3000), replicates=200)
    assert sum(one.trials for one in curve) == 3000
    assert [one.low for one in curve] == [k / 10 for k in range(10)]
    inside = [one.observed.low <= one.predicted <= one.observed.high for one in curve]
    assert sum(inside) >= 8
    wrong = reliability(truth, np.clip(1 - p, 0.02, 0.98), np.arange(3000), replicates=200)
    away = [one.observed.low <= one.predicted <= one.observed.high for one in wrong]
    assert sum(away) <= 2


def test_bins_hold_their_trials_and_empty_ones_nothing() -> None:
    truth = np.array([True, False, True])
    curve = reliability(truth, [0.05, 0.07, 0.999], ["a", "b", "b"], replicates=100)
    assert [one.trials for one in curve] == [2, *[0] * 8, 1]
    assert curve[0].predicted == pytest.approx(0.06)
    assert curve[0].observed.value == 0.5
    assert curve[-1].observed.undefined > 0, "replicates without motion b"
    assert math.isnan(curve[4].observed.value)


@pytest.mark.parametrize(
    ("observed", "probability", "motions", "message"),
    [
        ([True], [1.0], ["a"], "a probability is not between 0 and 1"),
        ([True], [NAN], ["a"], "a probability is not between 0 and 1"),
        ([1.0], [0.5], ["a"], "observed: must be boolean"),
        ([True, False], [0.5], ["a"], "give one each"),
        ([True, False], [0.5, 0.5], ["a"], "give one each"),
    ],
)
def test_what_cannot_be_scored_is_refused(observed, probability, motions, message) -> None:
    for score in (probability_intervals, reliability):
        with pytest.raises(ResultError, match=message):
            score(observed, probability, motions)
