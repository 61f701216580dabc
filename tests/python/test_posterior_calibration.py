"""Calibration of the posterior: levels by which probabilities become a statement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vsr2.posterior.calibration as calibration
from planar.planar_library import PLANAR_LIBRARY
from vsr2.ensemble.simulated.campaigns import Acting, Campaigns
from vsr2.posterior.calibration import (
    CALIBRATED,
    JudgedCampaigns,
    _before_true,
    _naming_limits,
    _set_level,
    best_temperature,
    calibrate,
    label_probability,
    label_set,
    pooled,
)
from vsr2.posterior.naming import (
    NEVER,
    Candidates,
    NamingLimits,
    VerdictKind,
    candidates,
    decide,
    is_wrong,
    one_cause,
)
from vsr2.posterior.sets import Sets
from vsr2.posterior.truth import PRIOR, Truth

LIBRARY = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "inertia", "wear", "slenderness")}
SETS = Sets(tuple(LIBRARY))


# --- what campaigns are trained on --------------------------------------------------------------


def truth_of(sets):
    acting = tuple(tuple(Acting(n, 1, 1.0, (0.0,)) for n in names) for names in sets)
    blank = np.zeros((len(sets), 1))
    return Truth.of(Campaigns(acting, blank, blank, blank, None), SETS, LIBRARY)


MANY = truth_of(
    [()] * 300 + [("table_gain",)] * 200 + [("wear",)] * 400 + [("inertia", "wear")] * 100
)


FITTING = np.ones(1000)
"""All campaigns fit simulations without effect."""


def test_campaigns_count_by_the_prior_however_many_there_are() -> None:
    count = MANY.acting.sum(axis=1)
    weight = np.array([MANY.weight[count == k].sum() for k in range(3)]) / MANY.weight.sum()
    wanted = np.array([PRIOR.none, PRIOR.one, PRIOR.two])
    np.testing.assert_allclose(weight, wanted / wanted.sum())
    np.testing.assert_array_equal(SETS.members[MANY.index], MANY.acting)


# --- calibration ---------------------------------------------------------------------------------


def exact_logs(truth: Truth, sharpness: float, seed: int):
    """A posterior that is exact: of one deviation, about a point for each set.

    Of all campaigns, then of those in which some act, which are drawn as outside.
    """
    rng = np.random.default_rng(seed)
    points = 1.4 * np.random.default_rng(9).standard_normal((len(SETS), 5))
    prior = np.full(len(SETS), 1e-9)
    for k in np.unique(truth.index):
        prior[k] = truth.weight[truth.index == k].sum()
    prior[SETS.outside] = prior.sum() * PRIOR.outside / (1 - PRIOR.outside)

    def log(index):
        x = points[index] + rng.standard_normal((index.size, 5))
        out = np.log(prior) - 0.5 * ((x[:, None] - points) ** 2).sum(axis=2)
        out = sharpness * (out - np.log(np.exp(out).sum(axis=1, keepdims=True)))
        return out - np.log(np.exp(out).sum(axis=1, keepdims=True))

    acting = int(truth.acting.any(axis=1).sum())
    return log(truth.index)[None], log(np.full(acting, SETS.outside))[None]


class Tabled:
    """Log probabilities that are given."""

    def __init__(self, logs):
        self.log = logs

    def score(self, index, temperature):
        own = self.log / temperature
        own -= np.log(np.exp(own).sum(axis=2, keepdims=True))
        return own[:, np.arange(index.size), index]


def judged_of(logs, temperature=1.0):
    parts = (np.arange(MANY.index.size), False), (np.flatnonzero(MANY.acting.any(axis=1)), True)
    return JudgedCampaigns.of(
        MANY,
        ((rows, unknown, pooled(own, temperature)) for (rows, unknown), own in zip(parts, logs,
         strict=True)),
    )  # fmt: skip


def levels_of(logs, fit=FITTING):
    judged = judged_of(logs)
    return calibrate(judged, MANY, fit[judged.row])


@pytest.mark.parametrize("sharpness", [1.0, 2.5])
def test_the_temperature_undoes_a_claim(sharpness) -> None:
    found = best_temperature(Tabled(exact_logs(MANY, sharpness, 1)[0]), MANY)
    assert found == pytest.approx(sharpness, rel=0.1)


def test_the_mean_of_networks_is_calibrated_and_not_each_of_them() -> None:
    """Networks with errors of their own claim too much, and their mean says too little."""
    exact = exact_logs(MANY, 1.0, 5)[0]
    rng = np.random.default_rng(6)
    eight = exact + 2.5 * rng.standard_normal((8, *exact.shape[1:]))
    assert best_temperature(Tabled(eight), MANY) < 0.95
    assert best_temperature(Tabled(eight[:1]), MANY) > 1.2


def test_names_gain_most_less_what_wrong_ones_cost() -> None:
    logs = exact_logs(MANY, 1.0, 2)
    levels = levels_of(logs)
    acting = MANY.acting.any(axis=1)
    p = pooled(np.concatenate(logs, axis=1), 1.0)
    outside = MANY.weight[acting] * PRIOR.outside / (1 - PRIOR.outside)
    outside *= MANY.weight.sum() / MANY.weight[acting].sum()
    weight = np.concatenate([MANY.weight, outside])
    assert outside.sum() / weight.sum() == pytest.approx(PRIOR.outside)
    owners = [tuple(np.flatnonzero(row)) for row in MANY.acting] + [()] * int(acting.sum())
    plain = np.flatnonzero(~acting)
    assert levels.none_limit == pytest.approx(np.quantile(p[plain, 0], CALIBRATED.false_alarms))

    found = [candidates(one, SETS, MANY.alike) for one in p]

    def shares(one, together):
        limits = NamingLimits(levels.none_limit, one, together)
        said = [decide(own, limits, MANY.alike) for own in found]
        named = np.array([str(s.kind) in ("effect", "class", "pair") for s in said])
        wrong = np.array([is_wrong(s, own) for s, own in zip(said, owners, strict=True)])
        alarms = np.mean([str(said[i].kind) != "none" for i in plain])
        assert alarms <= CALIBRATED.false_alarms + 1 / plain.size
        pair = np.array([str(s.kind) == "pair" for s in said])
        right = np.array(
            [
                sum(bool(set(f) & set(own)) for f in s.findings)
                for s, own in zip(said, owners, strict=True)
            ]
        )
        cost = np.where(pair, CALIBRATED.wrong_beside, CALIBRATED.wrong)
        gain = right - cost * (np.where(pair, 2, 1) - right)
        return (
            weight[wrong].sum() / weight[named].sum(),
            weight[named].sum() / weight.sum(),
            (weight * named * gain).sum(),
        )

    wrong, named, gain = shares(levels.least_name, levels.least_together)
    assert (wrong, named) == pytest.approx((levels.wrong, levels.named))
    others = [
        shares(one, together)[2]
        for one in CALIBRATED.one[::7]
        for together in CALIBRATED.together[::9]
    ]
    assert gain >= max(others) - 1e-9 > min(others) + 0.1 * gain
    # Of limits that gain as much the strictest are chosen.
    steps = (CALIBRATED.one, levels.least_name), (CALIBRATED.together, levels.least_together)
    for k, (known, own) in enumerate(steps):
        if own < known[-1]:
            stricter = [levels.least_name, levels.least_together]
            stricter[k] = known[known.index(own) + 1]
            assert shares(*stricter)[2] < gain


def named_with(stated, right):
    """Levels where one cause has a stated probability, and is the right one or not."""
    found = tuple(Candidates(0.0, 0.0, (), (1,), (p,), (1,)) for p in stated)
    known = np.zeros(stated.size, dtype=bool)
    judged = JudgedCampaigns(
        np.arange(stated.size), known, np.ones(stated.size), found, np.zeros((1, 1))
    )
    owners = [(1,) if own else (2,) for own in right]
    unresolved = np.ones(stated.size, dtype=bool)
    return _naming_limits(judged, owners, unresolved, np.eye(3, dtype=bool), 0.5)


def test_a_name_needs_the_odds_that_its_cost_asks_for(monkeypatch) -> None:
    """True probabilities of one cause are named from cost over one and cost (C. K. Chow, 1970)."""
    rng = np.random.default_rng(4)
    stated = rng.uniform(0.5, 1.0, 20_000)
    right = rng.uniform(size=stated.size) < stated
    for cost in (1.5, 4.0, 9.0):
        monkeypatch.setattr(calibration, "CALIBRATED", replace(CALIBRATED, wrong=cost))
        chosen, wrong, named = named_with(stated, right)
        threshold = cost / (1 + cost)
        assert chosen.one == pytest.approx(threshold, abs=0.04)
        assert wrong == pytest.approx((1 - threshold) / 2, abs=0.02)
        assert named == pytest.approx(2 * (1 - threshold), abs=0.08)


def test_nothing_is_named_where_every_level_loses() -> None:
    sure = np.full(400, 0.9999)
    chosen, wrong, named = named_with(sure, np.arange(400) % 2 == 0)
    assert (chosen.one, chosen.together, wrong, named) == (NEVER, NEVER, 0.0, 0.0)
    assert one_cause(Candidates(0.0, 0.0, (), (1,), (1.0,), (1,)), NEVER, np.eye(3)).kind == (
        "unresolved"
    )


def test_levels_are_set_on_verdicts_that_see_the_fit() -> None:
    """A campaign of which none is not excluded is named or unresolved where it does not fit."""
    logs = exact_logs(MANY, 1.0, 2)
    misfitting = np.where(MANY.acting.any(axis=1), 1e-3, 1.0)
    free, held = levels_of(logs), levels_of(logs, misfitting)
    assert held.none_limit == free.none_limit
    assert (held.named, held.least_name) != (free.named, free.least_name)


@pytest.mark.parametrize("sharpness", [0.5, 1.0, 2.0])
def test_sets_hold_the_truth_nine_times_in_ten_whatever_probabilities_claim(sharpness) -> None:
    one, other = exact_logs(MANY, 1.0, 3)[0][0], exact_logs(MANY, 1.0, 4)[0][0]
    one, other = np.exp(sharpness * one), np.exp(sharpness * other)
    one, other = (p / p.sum(axis=1, keepdims=True) for p in (one, other))
    level = _set_level(_before_true(label_probability(one, SETS), MANY.index, SETS), MANY.weight)
    held, size = [], []
    for p, acting in zip(other, MANY.acting, strict=True):
        labels = label_set(label_probability(p[None], SETS)[0], level)
        wanted = set(1 + np.flatnonzero(acting)) or {0}
        held.append(bool(wanted & set(labels)))
        size.append(len(labels))
    # A thousand campaigns, and as many that set the level.
    assert np.average(held, weights=MANY.weight) == pytest.approx(CALIBRATED.coverage, abs=0.04)
    assert 1 < np.mean(size) < 3


def test_sets_hold_nine_in_ten_of_campaigns_with_a_gap_and_of_those_without() -> None:
    """One level for all would hold more of those without a gap, and less of the others."""
    levels = levels_of(exact_logs(MANY, 0.5, 3))
    other = judged_of(exact_logs(MANY, 0.5, 4))
    index = np.where(other.unknown, SETS.outside, MANY.index[other.row])
    before = _before_true(other.labels, index, SETS)
    gap = other.labels[:, 0] < levels.none_limit

    def held(own, level):
        return np.average(before[own] <= level, weights=other.weight[own])

    # Of 1,362 and 338 campaigns, and as many that set the levels.
    assert held(gap, levels.gap_set_level) == pytest.approx(CALIBRATED.coverage, abs=0.03)
    assert held(~gap, levels.none_set_level) == pytest.approx(CALIBRATED.coverage, abs=0.05)
    common = _set_level(before, other.weight)
    assert held(gap, common) < CALIBRATED.coverage < held(~gap, common) - 0.04


def test_a_set_without_campaigns_that_could_bound_it_holds_all_labels() -> None:
    nobody = np.zeros(0)
    assert _set_level(nobody, nobody) == 1.0
    levels = levels_of(exact_logs(MANY, 1.0, 3))
    assert levels.set_level(VerdictKind.NONE) == levels.none_set_level
    assert levels.set_level(VerdictKind.UNKNOWN) == levels.gap_set_level
