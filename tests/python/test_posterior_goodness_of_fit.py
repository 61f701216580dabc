"""Goodness of fit of the model without effect."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.posterior.goodness_of_fit import misfit, misfits_by, tail_probability
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
