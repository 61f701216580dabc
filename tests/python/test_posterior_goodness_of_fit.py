"""Goodness of fit of the model without effect, and of the library."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.posterior.goodness_of_fit import LibraryFit, misfit, misfits_by, tail_probability
from vsr2.posterior.naming import NAMING
from vsr2.posterior.summaries import SUMMARY, Standard, Standards

TRIALS = 60
CHANCE = np.linspace(0.02, 0.98, TRIALS)


def outcomes(count, rng, chance=CHANCE):
    return (rng.random((count, TRIALS)) < chance).astype(float)


def blank(overturned):
    return np.zeros((*overturned.shape, 0))


def simulated(seed, count=400, chance=CHANCE):
    """Campaigns of coins, half of them with another chance: copies, which are gap-free, folds."""
    rng = np.random.default_rng(seed)
    plain = np.arange(count) % 2 == 0
    effects = np.where(plain[:, None], chance, 1 - chance)
    copies = []
    for _ in range(3):
        made = (rng.random((count, TRIALS)) < effects).astype(float)
        copies.append((made, blank(made)))
    return copies, plain, np.arange(count) % SUMMARY.folds


def test_a_tail_probability_counts_the_observed_campaign() -> None:
    known = np.array([1.0, 2.0, 3.0, 4.0])
    found = tail_probability(np.array([0.5, 2.0, 2.5, 9.0]), known)
    assert found.tolist() == [1.0, 0.8, 0.6, 0.2]
    assert tail_probability(np.array(9.0), np.zeros(0)) == 1.0


def test_the_discrepancy_is_a_mean_square() -> None:
    assert misfit(np.array([[3.0, 4.0], [0.0, 1.0]])) == pytest.approx([12.5, 0.5])


def test_campaigns_without_effect_are_standardised_by_others() -> None:
    """A trial that overturns in one campaign alone is rare by the others, not by itself."""
    copies, plain, fold = simulated(0, count=20, chance=np.full(TRIALS, 1e-9))
    for outcome, _ in copies:
        outcome[0, 0] = 1.0
    own = misfits_by(Standards.of(copies, plain, fold), copies[1:], fold)
    all_of_them = Standard.of(
        np.concatenate([o for o, _ in copies]),
        np.concatenate([f for _, f in copies]),
        np.tile(plain, len(copies)),
    )
    within = misfit(all_of_them.residuals(copies[1][0][:1], copies[1][1][:1]))[0]
    assert own[0, 0] > 1.5 * within
    assert own.shape == (2, plain.size)


def test_new_campaigns_without_effect_seldom_misfit_and_others_do() -> None:
    copies, plain, fold = simulated(1)
    misfits = misfits_by(Standards.of(copies, plain, fold), copies[1:], fold)
    known = np.sort(misfits[:, plain], axis=None)
    standard = Standard.of(
        np.concatenate([o for o, _ in copies]),
        np.concatenate([f for _, f in copies]),
        np.tile(plain, len(copies)),
    )
    rng = np.random.default_rng(2)

    def shares(chance):
        made = outcomes(400, rng, chance)
        sizes = misfit(standard.residuals(made, blank(made)))
        p = tail_probability(sizes, known)
        return (p < 0.01).mean(), p.mean()

    rejected, mean = shares(CHANCE)
    # Of 400 at 1 %: 4, with a standard deviation of 2, and as much from 400 known ones.
    assert rejected < 0.03
    assert mean == pytest.approx(0.5, abs=0.06)
    assert shares(1 - CHANCE)[0] == 1.0


def campaigns(rng, count):
    """Sizes, what is left, and two effects: one leaves more over, and with more chance."""
    size = rng.uniform(-1.0, 2.0, count)
    acts = np.zeros((count, 3))
    acts[np.arange(count), rng.integers(0, 2, count)] = 1.0
    one = acts[:, 0] > 0
    chance = np.where(one, 0.4, 0.2) * rng.standard_normal(count)
    return size, 0.5 * size + chance + np.where(one, 1.0, -0.5), acts


def test_what_is_left_is_compared_with_what_is_expected() -> None:
    rng = np.random.default_rng(3)
    fit = LibraryFit.of(*campaigns(rng, 4000))
    size, left, acts = campaigns(rng, 8000)
    for effect in (0, 1):
        own = acts[:, effect] > 0
        tails = fit.probability(size[own], left[own], acts[own])
        # Of 4,000 at 1 %: a standard error of 0.0016, and as much from the known ones.
        assert (tails < NAMING.least_fit).mean() == pytest.approx(0.01, abs=0.007)
        assert tails.mean() == pytest.approx(0.5, abs=0.03)
    # What is common under one effect is rare under the other, and if either may act.
    either = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]])
    one, other, both = fit.probability(np.zeros(3), np.ones(3), either)
    assert one == pytest.approx(0.5, abs=0.04)
    assert other == pytest.approx(1 / 4001)
    # At 0.75 over a spread between both, 2.65 standard deviations.
    assert both < NAMING.least_fit
    # What is common where the misfit is large is rare where it is small.
    small, large, beyond = fit.probability(
        np.array([-1.0, 2.0, 9.0]), np.full(3, 0.5), np.tile(either[1], (3, 1))
    )
    assert small == pytest.approx(1 / 4001)
    assert large == beyond == pytest.approx(0.5, abs=0.04)


def test_a_campaign_is_not_expected_by_itself() -> None:
    """One row that no other resembles has as large an error as it would have as a new one."""
    rng = np.random.default_rng(4)
    size, left, acts = campaigns(rng, 300)
    acts[0], left[0] = (0.0, 0.0, 1.0), 9.0
    others = LibraryFit.of(size[1:], left[1:], acts[1:])
    alone = others.probability(size[:1], left[:1], acts[:1])[0]
    assert alone == pytest.approx(1 / 300)
    assert LibraryFit.of(size, left, acts).errors[-1] > 5 * others.errors[-1]
