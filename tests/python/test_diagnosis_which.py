"""WHICH: the routes combined, calibrated; misfit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from vsr2.diagnosis.verdict.compose import _unrolled
from vsr2.diagnosis.which.novelty import Misfit, fit_out_of_library
from vsr2.diagnosis.which.routes import Combination, _combination, _sets
from vsr2.diagnosis.which.tempering import (
    COVERAGE,
    Judged,
    Tempering,
    below,
    pairwise_exponent,
    sharpness,
)


def test_novelty_is_measured_among_campaigns_alike() -> None:
    rng = np.random.default_rng(0)
    strength = np.repeat([1.0, 1000.0], 100)
    # Strong effects fit worse, because the emulator is off by a share of them.
    statistics = rng.normal(size=(200, 1)) + np.where(strength > 10, 3.0, 0.0)[:, None]
    misfit = Misfit(statistics, np.zeros(200, dtype=np.int64), strength, np.ones(200))
    # Of label 1 there is none, so that strength alone tells which are alike.
    weak = misfit.p_value(np.array([3.0]), 1, 1.0)
    assert weak <= 1 / 40
    assert 0.3 < misfit.p_value(np.array([3.0]), 1, 1000.0) < 0.7


def test_a_label_whose_campaigns_fit_badly_anyway_shows_no_misfit() -> None:
    """Of 140 campaigns, all of one strength, the 40 of label 1 fit worse than all of label 0."""
    rng = np.random.default_rng(4)
    best = np.repeat([0, 1], [100, 40])
    statistics = (rng.normal(size=140) + 6.0 * best)[:, None]
    misfit = Misfit(statistics, best, np.ones(140), np.ones(140))
    assert misfit.p_value(np.array([6.0]), 0, 1.0) <= 2 / 41
    assert 0.3 < misfit.p_value(np.array([6.0]), 1, 1.0) < 0.7


def test_probability_of_a_stranger_rests_on_those_that_were_left_out() -> None:
    rng = np.random.default_rng(2)
    count = 4000
    known = rng.random(count), np.exp(rng.normal(2, 1, count))
    weight = np.ones(count)
    # P values of campaigns from outside have density 0.2 p^-0.8: the likelihood ratio.
    strange = rng.random(count) ** 5, np.exp(rng.normal(2, 1, count))
    gaps = np.ones(count, dtype=bool)
    seen = fit_out_of_library(known, weight, strange, gaps)
    at = np.array([0.01, 0.1, 0.6])
    ratio = 0.2 * at**-0.8
    expected = 0.15 * ratio / (0.15 * ratio + 0.85)
    np.testing.assert_allclose(seen.probability(at, np.full(3, 7.0)), expected, atol=0.04)
    # P(p <= 0.05) = 0.05^0.2.
    assert seen.detection_rate == pytest.approx(0.05**0.2, abs=0.03)
    # Campaigns from outside that look like all others: nothing is learnt beyond the prior.
    alike = (rng.random(count), strange[1])
    same = fit_out_of_library(known, weight, alike, gaps)
    np.testing.assert_allclose(same.probability(at, np.full(3, 7.0)), 0.15, atol=0.04)
    none = fit_out_of_library(known, weight, (np.zeros(0), np.zeros(0)), np.zeros(0, dtype=bool))
    assert none.detection_rate is None
    assert none.probability(np.array(0.01), np.array(5.0)) == pytest.approx(0.15)


def test_the_prior_counts_in_full_however_little_the_data_do() -> None:
    prior = np.log([0.6, 0.3, 0.1])
    ratio = np.array([0.0, 2.0, -1.0])
    flat = np.full(3, -np.log(3))
    mute = Combination(Tempering(0.0, 0.0), 0.0, np.inf, 0.0)
    np.testing.assert_allclose(mute.log_probability(prior + ratio, flat, prior), prior)
    # Half of the evidence: odds are prior odds times the square root of the likelihood's ratio.
    half = Combination(Tempering(0.5, 0.0), 0.2, np.inf, 1.0)
    found = half.log_probability(prior + ratio, flat, prior)
    assert found[1] - found[0] == pytest.approx(np.log(0.5) + 1.0)
    # Against an effect another power counts.
    assert found[2] - found[0] == pytest.approx(np.log(0.1 / 0.6) - 0.2)


def test_no_evidence_speaks_against_an_effect_beyond_the_limit() -> None:
    prior = np.log([0.6, 0.3, 0.1])
    flat = np.full(3, -np.log(3))
    limited = Combination(Tempering(0.5, 0.0), 0.5, 3.0, 1.0)
    sure = prior + np.array([0.0, -2000.0, -5000.0])
    found = limited.log_probability(sure, flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] - [0.0, 3.0, 3.0], atol=1e-12)
    # Small ratios count as they are.
    near = prior + np.array([0.0, -0.2, -0.1])
    found = limited.log_probability(near, flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] - [0, 0.1, 0.05], atol=2e-3)
    # What speaks for an effect is not limited.
    found = limited.log_probability(prior + np.array([0.0, 80.0, 20.0]), flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] + [0, 40.0, 10.0], atol=1e-9)


def test_sure_evidence_that_misleads_one_time_in_ten_is_not_believed_more() -> None:
    rng = np.random.default_rng(3)
    labels, rows = 6, 600
    truth = np.arange(rows) % labels
    prior = np.full(labels, -np.log(labels))
    favoured = np.where(np.arange(rows) % 10 == 0, rng.integers(0, labels, rows), truth)
    likelihood = 3.0 * rng.standard_normal((rows, labels)) + prior
    likelihood[np.arange(rows), favoured] += 60.0
    likelihood -= np.log(np.exp(likelihood).sum(axis=1, keepdims=True))
    flat = np.full((rows, labels), -np.log(labels))
    found = _combination(likelihood, flat, prior, truth, np.ones(rows))
    p = np.exp(found.log_probability(likelihood, flat, prior))
    right = (favoured == truth).mean()
    assert p.max(axis=1).mean() == pytest.approx(right, abs=0.01)


def test_the_pairwise_exponent_undoes_a_claim() -> None:
    """Log likelihood ratios of mean D have variance 2 D; here they are eight times too large.

    600 campaigns: the standard error of the exponent is about 0.005.
    """
    rng = np.random.default_rng(5)
    truth = np.arange(600) % 4
    apart = rng.uniform(0.2, 3.0, (600, 4))
    ratio = apart + np.sqrt(2 * apart) * rng.standard_normal((600, 4))
    evidence = -8.0 * ratio
    evidence[np.arange(600), truth] = 0.0
    assert pairwise_exponent(evidence, truth) == pytest.approx(1 / 8, abs=0.02)
    assert pairwise_exponent(0.5 * evidence / 8.0, truth) == 1.0
    assert pairwise_exponent(evidence[:, :1], np.zeros(600, dtype=np.int64)) == 1.0


def test_angles_are_averaged_as_directions() -> None:
    found = _unrolled(np.array([350.0, 10.0, 30.0]), np.array([0.25, 0.5, 0.25]), 360.0)
    np.testing.assert_allclose(found, [-10, 10, 30], atol=1e-9)
    assert np.array([0.25, 0.5, 0.25]) @ found == pytest.approx(10.0)
    # Beyond half a turn: about a mean of 300 degrees, 60 lies at 420.
    found = _unrolled(np.array([290.0, 310.0, 60.0]), np.array([0.5, 0.5, 1e-9]), 360.0)
    np.testing.assert_allclose(found, [290, 310, 420], atol=1e-6)


def test_a_strong_effect_counts_less() -> None:
    tempering = Tempering(power=0.5, error=0.1)
    # S^2 = 0 and 2 * 50.
    weights = tempering.weight(np.array([[0.0, -1.0, -3.0], [-50.0, 0.0, -2.0]]))
    np.testing.assert_allclose(weights, [0.5, 0.5 / 2])


@pytest.mark.parametrize("true_error", [0.05, 0.15])
def test_posteriors_are_tempered_until_their_intervals_cover(true_error) -> None:
    """Posteriors that claim an error of 0.05 of the range where it is 0.05, and where 0.15."""
    rng = np.random.default_rng(0)
    grid = (np.arange(121) + 0.5) / 121
    campaigns = []
    for truth in rng.uniform(0.3, 0.7, 300):
        seen = truth + true_error * rng.standard_normal()
        nodes = -0.5 * ((grid - seen) / 0.05) ** 2
        likelihood = np.array([0.0, rng.uniform(1, 50)])
        node = int(np.argmin(np.abs(grid - truth)))
        campaigns.append(Judged(nodes, grid[:, None], node, np.array([truth]), likelihood))
    best, found = sharpness(campaigns)

    def covered(tempering) -> float:
        inside = 0
        for one in campaigns:
            log = float(tempering.weight(one.likelihood)) * one.nodes
            weight = np.exp(log - log.max())
            share = below(grid, weight / weight.sum(), one.truth[0])
            inside += 0.025 <= share <= 0.975
        return inside / len(campaigns)

    assert covered(found) >= COVERAGE
    # The exponent that undoes the claim is (0.05 / error)^2; its neighbours may cover.
    power = (0.05 / true_error) ** 2
    middle = np.array([0.0, 25.0])
    assert 0.4 * power < found.weight(middle) <= 1.6 * power
    assert 0.4 * power < best.weight(middle) <= 1.6 * power
    if true_error > 0.1:
        assert covered(Tempering(1.0, 0.0)) < 0.6


@pytest.mark.parametrize("side", [None, -1.0, 1.0])
def test_intervals_cover_in_the_weaker_half_too(side) -> None:
    """Of weak campaigns 91 % hold the truth untempered, of strong ones all: together enough.

    Whether the truth lies on both sides of what is estimated or on one alone.
    """
    rng = np.random.default_rng(7)
    grid = (np.arange(401) + 0.5) / 401
    campaigns = []
    for i in range(1200):
        centre, weak = rng.uniform(0.4, 0.6), i % 2 == 0
        off = rng.normal(0.0, 0.0289 if weak else 0.008)
        truth = centre + (off if side is None else side * abs(off))
        nodes = -0.5 * ((grid - centre) / 0.025) ** 2
        strength = 1.0 + 0.001 * i if weak else 100.0 + i
        campaigns.append(
            Judged(
                nodes - np.log(np.exp(nodes).sum()),
                grid[:, None],
                int(np.argmin(np.abs(grid - truth))),
                np.array([truth]),
                np.array([-strength / 2, 0.0]),
            )
        )
    _, intervals = sharpness(campaigns)
    # Powers are a factor 1.39 apart: 0.72 makes intervals 1.18 times as wide; 1.16 is needed.
    assert intervals.weight(np.array([-0.5, 0.0])) == pytest.approx(0.72, abs=0.01)


def test_sets_hold_the_truth_nine_times_in_ten() -> None:
    """Labels as normal distributions one deviation apart, what lies outside as a wider one."""
    rng = np.random.default_rng(11)
    labels = ("none", "gain", "wear", "catch")
    prior, means = np.array([0.4, 0.2, 0.2, 0.2]), np.arange(4.0)

    def judged(x):
        density = prior * np.exp(-0.5 * (x[:, None] - means) ** 2)
        strange = np.exp(-0.5 * ((x - 4.0) / 3.0) ** 2) / 3.0
        unknown = 0.15 * strange / (0.15 * strange + 0.85 * density.sum(axis=1))
        return density / density.sum(axis=1, keepdims=True), unknown

    # As many of each label, which therefore weigh by its prior.
    truth = np.repeat(np.arange(4), 300)
    probability, unknown = judged(means[truth] + rng.standard_normal(truth.size))
    _, left_out = judged(4.0 + 3.0 * rng.standard_normal(300))
    calibration = SimpleNamespace(
        labels=labels, truth=truth, weight=prior[truth] / 300, probability=probability,
        unknown=unknown, unknown_left_out=left_out,
        likelihood=np.log(probability), classifier=np.log(probability),
    )  # fmt: skip
    count = 3000
    actual = np.where(rng.random(count) < 0.15, 4, rng.choice(4, count, p=prior))
    spread = rng.standard_normal(count)
    x = np.where(actual == 4, 4.0 + 3.0 * spread, means[np.minimum(actual, 3)] + spread)
    own, strange = judged(x)
    sets = [
        _sets(calibration, p, np.log(p), np.log(p), u) for p, u in zip(own, strange, strict=True)
    ]
    named = [(*labels, "unknown")[k] for k in actual]
    # The standard error is 0.005 of these campaigns and 0.01 of those that calibrate.
    held = np.mean([name in found["both"] for name, found in zip(named, sets, strict=True)])
    assert held == pytest.approx(0.9, abs=0.04)
    known = [(n, s) for n, s in zip(named, sets, strict=True) if n != "unknown"]
    for route in ("likelihood", "classifier"):
        assert np.mean([n in s[route] for n, s in known]) == pytest.approx(0.9, abs=0.04)
    assert np.mean([len(found["both"]) for found in sets]) < 3.5
