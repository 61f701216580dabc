"""Intervals from a bootstrap over motions."""

import numpy as np
import pytest

from vsr2.analysis.bootstrap import SCORES, classification_intervals
from vsr2.analysis.metrics import classification_metrics
from vsr2.campaign import motion_resamples
from vsr2.errors import CampaignError, ResultError


def sample(motions=30, trials=6, seed=0, error=0.1):
    """Whole motions are predicted wrongly, as happens where a model misses what they have."""
    rng = np.random.default_rng(seed)
    groups = np.repeat(np.arange(motions), trials)
    observed = rng.random(groups.size) < 0.45
    wrong = (rng.random(motions) < error)[groups]
    return observed, observed ^ wrong, groups


def test_scores_of_replicates_are_those_of_the_trials_drawn():
    observed, predicted, groups = sample()
    found = classification_intervals(observed, predicted, groups, replicates=50, level=0.9, seed=3)
    drawn = motion_resamples(groups, 50, seed=3)
    for name in SCORES:
        values = []
        for counts in drawn:
            index = np.repeat(np.arange(groups.size), counts)
            values.append(getattr(classification_metrics(observed[index], predicted[index]), name))
        low, high = np.quantile(values, [0.05, 0.95])
        assert found[name].value == getattr(classification_metrics(observed, predicted), name)
        assert found[name].low == pytest.approx(low, rel=1e-12)
        assert found[name].high == pytest.approx(high, rel=1e-12)
        assert found[name].standard_error == pytest.approx(np.std(values, ddof=1), rel=1e-9)
        assert found[name].undefined == 0.0


def test_the_error_of_accuracy_is_that_of_motions_not_of_trials():
    observed, predicted, groups = sample(motions=100, trials=10)
    right = (observed == predicted).reshape(100, 10).mean(axis=1)
    found = classification_intervals(observed, predicted, groups)["accuracy"]
    # The plug-in standard error of a mean of 100 clusters; 2000 replicates tell it to 1.6 %.
    assert found.standard_error == pytest.approx(right.std() / 10, rel=0.08)
    single = classification_intervals(observed, predicted, np.arange(1000))["accuracy"]
    assert found.standard_error > 2.5 * single.standard_error


def test_the_interval_covers_as_often_as_it_says():
    covered = 0
    for seed in range(200):
        observed, predicted, groups = sample(motions=60, trials=3, seed=seed, error=0.3)
        found = classification_intervals(observed, predicted, groups, replicates=300)["accuracy"]
        covered += found.low <= 0.7 <= found.high
    # 0.95 with a binomial error of 0.015; percentile intervals of 60 clusters fall a little short.
    assert 0.89 <= covered / 200 <= 0.99


def test_a_score_without_a_denominator_is_unknown():
    observed = np.array([True, False, False])
    found = classification_intervals(observed, np.zeros(3, bool), ["a", "b", "c"])
    assert np.isnan(found["precision"].value)
    assert np.isnan(found["precision"].low)
    assert found["precision"].undefined == 1.0
    assert found["accuracy"].value == pytest.approx(2 / 3)
    # Replicates without "a" have no overturning to recall: (2/3)^3 of them.
    assert found["recall"].undefined == pytest.approx(8 / 27, abs=0.05)
    assert found["recall"].low == found["recall"].high == 0.0


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"motions": ["a"]}, ResultError, r"motions has shape \(1,\) for 2 trials"),
        ({"level": 1.0}, ResultError, r"level 1\.0 must lie"),
        ({"replicates": 0}, CampaignError, "0 replicates"),
    ],
)
def test_bad_arguments_are_named(arguments, error, words):
    values = {"motions": ["a", "b"]} | arguments
    truth = np.array([True, False])
    with pytest.raises(error, match=words):
        classification_intervals(truth, truth, **values)
