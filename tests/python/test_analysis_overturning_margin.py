"""From overturning margins to probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from vsr2.analysis.overturning_margin import (
    MARGIN,
    MarginModel,
    _fitted,
    fit_margin_model,
    out_of_fold_probability,
    seek_margins,
)


def planted(count: int, bias: float, scatter: float, seed: int = 0):
    rng = np.random.default_rng(seed)
    margin = rng.uniform(-0.6, 0.6, count)
    return margin[None], (margin + scatter * rng.standard_normal(count) < bias).astype(float)


def test_the_probability_is_that_of_a_normal_variable_but_for_lapses() -> None:
    model = MarginModel(bias=0.1, scatter=0.2)
    found = model.probability([[0.1, 0.3, -5.0, 5.0]])
    wanted = (1 - MARGIN.lapse) * norm.cdf([0.0, -1.0, 25.5, -24.5]) + MARGIN.lapse / 2
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


@pytest.mark.parametrize(("bias", "scatter"), [(0.0, 0.15), (0.15, 0.1), (-0.2, 0.3)])
def test_bias_and_scatter_are_found(bias, scatter) -> None:
    found = fit_margin_model(*planted(3000, bias, scatter))
    # A threshold among 3,000 trials of 2,500 a unit is known to about 0.01.
    assert found.bias == pytest.approx(bias, abs=0.03)
    assert found.scatter == pytest.approx(scatter, rel=0.12)


def test_few_trials_leave_the_prior() -> None:
    found = fit_margin_model([[0.4, -0.4]], [0.0, 1.0])
    assert abs(found.bias) < 0.02
    assert found.scatter == pytest.approx(MARGIN.scatter, rel=0.4)
    unknown = fit_margin_model([[0.3]], [np.nan])
    assert (unknown.bias, unknown.scatter) == pytest.approx((0.0, MARGIN.scatter), abs=1e-3)


def test_a_motion_s_outcomes_have_no_part_in_its_prediction() -> None:
    margin, ends = planted(200, 0.1, 0.15)
    motions = np.repeat(np.arange(20), 10)
    found = out_of_fold_probability(margin, ends, motions, 20)
    turned = np.where(motions == 3, 1 - ends, ends)
    # Each motion is a fold of its own, so that the folds stay.
    again = out_of_fold_probability(margin, turned, motions, 20)
    np.testing.assert_array_equal(again[motions == 3], found[motions == 3])
    assert (again != found).any()


def test_replicates_that_are_far_off_lose_their_weight() -> None:
    margin, ends = planted(200, 0.0, 0.1)
    rng = np.random.default_rng(1)
    near = margin + 0.05 * rng.standard_normal((4, 200))
    far = rng.uniform(-0.6, 0.6, (4, 200))
    motions = np.repeat(np.arange(20), 10)
    both = np.concatenate([near, far])
    found = fit_margin_model(both, ends, motions)
    assert sum(found.weights[:4]) > 0.8, "half of it with equal weights"
    assert sum(found.weights) == pytest.approx(1.0)
    # Where all are as good, weights stay about equal.
    alike = fit_margin_model(near, ends, motions)
    assert not alike.weights or max(alike.weights) < 0.6
    loss = [
        -np.log(np.where(ends > 0.5, p, 1 - p)).mean()
        for p in (
            out_of_fold_probability(both, ends, motions, 4),
            out_of_fold_probability(near, ends, motions, 4),
            fit_margin_model(both, ends).probability(both),
        )
    ]
    assert loss[0] < loss[1] + 0.03
    assert loss[0] < loss[2] - 0.02


def test_a_replicate_that_failed_does_not_count() -> None:
    margin, ends = planted(300, 0.1, 0.15)
    both = np.concatenate([margin, margin])
    both[0, ::3] = np.nan
    motions = np.repeat(np.arange(30), 10)
    one, other = (fit_margin_model(given, ends, motions) for given in (both, margin))
    # Weights move nothing where all that is known agrees.
    assert one.bias == pytest.approx(other.bias, abs=1e-3)
    np.testing.assert_allclose(one.mean(both), margin[0], rtol=1e-12)
    both[1, 0] = np.nan
    assert np.isnan(one.mean(both)[0])
    assert one.probability(both)[0] == pytest.approx(0.5)
    assert np.isfinite(out_of_fold_probability(both, ends, motions, 5)).all()


def test_slopes_of_the_fit_are_those_of_differences() -> None:
    margin, ends = planted(60, 0.0, 0.2)
    rng = np.random.default_rng(3)
    given = margin + 0.2 * rng.standard_normal((3, 60))
    given[1, :20] = np.nan
    found = _fitted(given, ends > 0.5, 1.0, biased=True)
    # At the optimum no change of any weight raises the posterior: the slope is right.
    theta = np.log(np.array(found.weights))
    theta -= theta.mean()

    def cost(moved) -> float:
        weights = np.exp(moved) / np.exp(moved).sum()
        model = MarginModel(found.bias, found.scatter, tuple(weights.tolist()))
        p = model.probability(given)
        return 0.5 * float(moved @ moved) - np.log(np.where(ends > 0.5, p, 1 - p)).sum()

    for k in range(3):
        step = np.eye(3)[k] * 1e-4
        slope = (cost(theta + step) - cost(theta - step)) / 2e-4
        assert slope == pytest.approx(0.0, abs=0.02)


def test_without_a_bias_the_scatter_takes_what_a_bias_explains() -> None:
    margin, ends = planted(400, 0.4, 0.1)
    free, held = (fit_margin_model(margin, ends, biased=b) for b in (True, False))
    assert free.bias == pytest.approx(0.4, abs=0.1)
    assert held.bias == 0.0
    assert held.scatter > 1.5 * free.scatter


def test_margins_are_sought_to_half_of_what_is_left_of_the_range():
    true = np.array([[-0.93, 0.0], [0.31, 2.0]])

    def overturns(logs):
        return (logs > true).astype(float)

    found = seek_margins(overturns, true.shape, (-1.0, 1.0), 7)
    half = 2.0 / 2**7 / 2
    assert np.all(np.abs(found - np.minimum(true, 1.0)) <= half)
    assert found[1, 1] == 1.0 - half  # beyond the range: next to its end


def test_a_failed_simulation_has_no_margin():
    calls = iter([1.0, np.nan, 1.0])
    found = seek_margins(lambda logs: np.array([next(calls)]), (1,), (-1.0, 1.0), 3)
    assert np.isnan(found).all()
