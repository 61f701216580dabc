"""What acts beside the effect that leads."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis_samples import NAMES, linear
from vsr2.effects import library as effects
from vsr2.ensemble.simulated.campaigns import Acting, Campaigns
from vsr2.posterior.effect_curves import fit_curves, kernel_coordinates
from vsr2.posterior.second_cause import (
    SecondCause,
    Seen,
    features,
    fit_second_cause,
    odds,
    refined,
)
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY
from vsr2.posterior.truth import Truth

SETS = Sets(NAMES)
EFFECTS = len(NAMES)
FLAT = np.zeros((EFFECTS, EFFECTS), dtype=bool)


class Curved:
    """Discriminants on which each effect acts along a direction of its own, and turns into others'.

    One that is as strong as it often is moves the discriminants of others more than these do.
    """

    def __init__(self, count: int = 700, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        library = linear().library
        self.library = library
        turns = np.random.default_rng(0).normal(size=(EFFECTS, EFFECTS)) * 0.35
        acting, mean = [], np.zeros((count, EFFECTS))
        for row in range(count):
            number = (0, 1, 1, 2)[row % 4]
            chosen = sorted(rng.choice(EFFECTS, number, replace=False).tolist())
            acts = []
            for e in chosen:
                effect = library[NAMES[e]]
                share = rng.random()
                values = tuple(
                    float(p.lower + share * (p.upper - p.lower)) for p in effect.parameters
                )
                acts.append(Acting(NAMES[e], 1, float(np.exp(rng.uniform(0, 2.7))), values))
                mean[row, e] += 3 * acts[-1].size ** 0.7
                mean[row] += turns[e] * acts[-1].size
            acting.append(tuple(acts))
        self.discriminants = mean + rng.normal(size=(3, count, EFFECTS))
        blank = np.zeros((count, 1))
        self.campaigns = Campaigns(tuple(acting), rng.normal(size=(count, 2)), blank, blank, None)
        self.truth = Truth.of(self.campaigns, SETS, library)
        self.fold = np.arange(count) // 4 % SUMMARY.folds

    def probability(self, _copy: int, rows: np.ndarray) -> np.ndarray:
        """As of networks that know the strongest effect and nothing of the second."""
        out = np.full((len(rows), len(SETS)), 1e-4)
        for p, row in zip(out, rows, strict=True):
            acts = self.campaigns.sets[row]
            if not acts:
                p[0] = 1.0
                continue
            lead = NAMES.index(max(acts, key=lambda one: one.size).name)
            p[1 + lead] = 0.6
            p[1 + EFFECTS : -1][SETS.members[1 + EFFECTS : -1, lead]] = 0.3 / (EFFECTS - 1)
        return np.asarray(out / out.sum(axis=1, keepdims=True))


@pytest.fixture(scope="module")
def curved() -> tuple[Curved, tuple[SecondCause, ...]]:
    own = Curved()
    curves = fit_curves(own.discriminants, own.campaigns, own.library, own.fold)
    return own, fit_second_cause(own.discriminants, curves, own.truth, own.fold, own.probability)


def test_the_second_effect_of_a_pair_is_found_in_campaigns_that_nothing_saw(curved) -> None:
    _, judges = curved
    new = Curved(240, seed=1)
    before = new.probability(0, np.arange(240))
    after = np.array(
        [
            refined(p, SETS, new.truth.alike, d, judges)
            for p, d in zip(before, new.discriminants[-1], strict=True)
        ]
    )
    np.testing.assert_allclose(after.sum(axis=1), 1)
    np.testing.assert_allclose(after[:, [0, -1]], before[:, [0, -1]])
    number, row = new.truth.acting.sum(axis=1), np.arange(240)
    gain = np.log(after[row, new.truth.index] / before[row, new.truth.index])
    assert gain[number == 2].mean() > 1.0
    assert gain[number == 1].mean() > -0.1
    assert (after.argmax(axis=1) == new.truth.index)[number == 2].mean() > 0.6


def test_a_parameter_without_a_known_null_has_a_finite_coordinate() -> None:
    known = effects()
    assert np.isnan(known["restitution"].parameters[0].null)
    acting = [Acting("restitution", 1, size, (value,)) for size, value in ((0.9, 0.7), (9.0, 1.1))]
    assert np.isfinite(kernel_coordinates(known, "restitution", acting)).all()


def test_each_pair_has_one_leader() -> None:
    p = np.random.default_rng(2).random(len(SETS))
    p /= p.sum()
    seen = Seen.of(p, SETS)
    assert seen.leading.sum() == pytest.approx(p[1:-1].sum())
    equal = Seen.of(np.full(len(SETS), 1 / len(SETS)), SETS)
    assert equal.leading.sum() == pytest.approx(1 - 2 / len(SETS))


def test_odds_leave_out_what_leads_and_sum_to_one(curved) -> None:
    own, judges = curved
    seen = Seen.of(own.probability(0, np.array([1]))[0], SETS)
    curves = judges[0].curves
    place = (own.discriminants[0, 1] - curves.origin) @ curves.white
    found = features(curves, place, 0, seen, FLAT)
    share = odds(judges[0], found, 0)
    assert share[0] == 0
    assert share.sum() == pytest.approx(1)
    assert np.isfinite(found).all()


def test_larger_sets_keep_what_they_have(curved) -> None:
    own, judges = curved
    larger = Sets(NAMES, 3)
    p = np.random.default_rng(3).random(len(larger))
    p /= p.sum()
    after = refined(p, larger, own.truth.alike, own.discriminants[0, 1], judges)
    kept = (larger.size == 3) | (np.arange(len(larger)) == 0)
    np.testing.assert_array_equal(after[kept], p[kept])
    assert after.sum() == pytest.approx(1)
