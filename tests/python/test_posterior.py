"""Parts of the learned posterior: sets, network, summaries, discrepancy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis_samples import campaigns_of
from vsr2.effects import library
from vsr2.ensemble.simulated.campaigns import Acting
from vsr2.ensemble.simulated.linear_algebra import ridge
from vsr2.posterior.discrepancy import DISCREPANCY, disturbed
from vsr2.posterior.network import NETWORK, Network, SetOutputs, _logits, log_score, train_network
from vsr2.posterior.sets import Sets, with_alike
from vsr2.posterior.summaries import SUMMARY, Standard, fit_summaries, targets

SETS = Sets(("a", "b", "c", "d"))


# --- network -------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [1, 2, 3, 4])
def test_gradients_are_those_of_differences(most, monkeypatch) -> None:
    sets = Sets(SETS.names, most)
    small = replace(NETWORK, hidden=(5, 4), dropout=0.3, decay=0.01)
    monkeypatch.setattr("vsr2.posterior.network.NETWORK", small)
    rng = np.random.default_rng(0)
    network = Network.drawn(sets, 6, rng)
    # In double precision, in which differences have digits enough.
    network.weights = [one.astype(np.float64) for one in network.weights]
    network.biases = [0.1 * rng.standard_normal(one.shape) for one in network.biases]
    inputs, weight = rng.standard_normal((9, 6)), rng.uniform(0.5, 2.0, 9)
    truth = rng.integers(0, len(sets) - 1, 9)

    found = network.score(inputs, truth)
    every = network.log_probability(inputs)
    np.testing.assert_allclose(found, every[np.arange(9), truth], rtol=1e-12)

    def loss() -> float:
        # The same units are left out as in the step.
        values, _ = network._layers(inputs, np.random.default_rng(5))
        logits = _logits(sets, values[-1])
        log = logits - np.log(np.exp(logits - logits.max(1, keepdims=True)).sum(1, keepdims=True))
        log -= logits.max(1, keepdims=True)
        own = log[np.arange(9), truth]
        decay = 0.5 * small.decay * sum(float((w**2).sum()) for w in network.weights)
        return float(-(weight * own).sum() / weight.sum()) + decay

    slopes = network.step(inputs, truth, weight, np.random.default_rng(5))
    for parameter, slope in zip([*network.weights, *network.biases], slopes, strict=True):
        for index in rng.integers(0, parameter.size, 6):
            place = np.unravel_index(index, parameter.shape)
            kept, sides = parameter[place], []
            for step in (1e-6, -1e-6):
                parameter[place] = kept + step
                sides.append(loss())
            parameter[place] = kept
            assert slope[place] == pytest.approx((sides[0] - sides[1]) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("most", [2, 3, 4])
def test_slopes_hold_where_parts_differ_by_more_than_a_number_has_digits(most) -> None:
    sets = Sets(SETS.names, most)
    network = Network.drawn(sets, 3, np.random.default_rng(0))
    outputs = 90.0 * np.random.default_rng(1).standard_normal((50, 2 * 4 + most))
    truth = np.arange(50) % (len(sets) - 1)

    found = network._slope(outputs, truth)

    logits = (outputs @ network.sets.parts.T)[:, :-1]
    p = np.exp(logits - logits.max(axis=1, keepdims=True))
    p /= p.sum(axis=1, keepdims=True)
    # Every term is positive, so only rounding of the sums is left.
    np.testing.assert_allclose(
        found, p @ network.sets.parts[:-1] - network.sets.parts[truth], atol=1e-11
    )


TWO = Sets(("a", "b"))

MEANS = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])

PRIOR = np.array([0.35, 0.25, 0.2, 0.2])


def gaussian_batches(draw):
    """None, a, b and both as normal distributions, whose posterior is known."""
    truth = draw.choice(4, 2000, p=PRIOR)
    x = MEANS[truth] + draw.standard_normal((2000, 2))
    return x, truth, np.ones(2000)


def exact(x):
    log = np.log(PRIOR) - 0.5 * ((x[:, None] - MEANS) ** 2).sum(axis=2)
    return log - np.log(np.exp(log).sum(axis=1, keepdims=True))


@pytest.fixture(scope="module")
def learnt():
    return gaussian_training(120, 3)


def gaussian_training(passes, seed):
    held_out = gaussian_batches(np.random.default_rng(100))
    with pytest.MonkeyPatch.context() as patch:
        few = replace(NETWORK, hidden=(24, 16), passes=passes, dropout=0.0, least_passes=4)
        patch.setattr("vsr2.posterior.network.NETWORK", few)
        return train_network(TWO, gaussian_batches, held_out, np.random.default_rng(seed))


def test_a_posterior_that_is_known_is_learnt(learnt) -> None:
    x, truth, weight = gaussian_batches(np.random.default_rng(200))
    every, wanted = learnt.log_probability(x), exact(x)
    assert np.exp(every[:, -1]).max() == 0, "no network knows a cause outside"
    found = every[:, :-1]
    # Divergence of the learned posterior from the exact one [nat].
    divergence = (np.exp(wanted) * (wanted - found)).sum(axis=1).mean()
    assert 0 <= divergence < 0.02
    own = -wanted[np.arange(2000), truth].mean()
    assert log_score(learnt, x, truth, weight) < own + 0.03


@pytest.mark.parametrize("most", [1, 3])
def test_sets_are_judged_a_few_at_a_time_and_one_alone(most) -> None:
    sets, rng = Sets(SETS.names, most), np.random.default_rng(3)
    networks = [Network.drawn(sets, 6, rng) for _ in range(2)]
    for one in networks:
        one.weights[-1] *= 30
    inputs = rng.standard_normal((7, 6))
    judged = SetOutputs(sets, np.stack([one.outputs(inputs) for one in networks]))
    wanted = np.stack([one.log_probability(inputs) for one in networks])
    found = [judged.log_probability(rows) for rows in (np.arange(3), np.arange(3, 7))]
    np.testing.assert_allclose(np.concatenate(found, axis=1), wanted, rtol=1e-12)
    index = rng.integers(0, len(sets) - 1, 7)
    tempered = np.exp((wanted - wanted.max(axis=2, keepdims=True)) / 1.7)
    tempered /= tempered.sum(axis=2, keepdims=True)
    own = np.exp(judged.score(index, 1.7))
    np.testing.assert_allclose(own, tempered[:, np.arange(7), index], rtol=1e-12)


def test_equal_seeds_train_equal_networks() -> None:
    one, again, other = (gaussian_training(6, seed) for seed in (3, 3, 4))
    for weight, same in zip(one.weights, again.weights, strict=True):
        np.testing.assert_array_equal(weight, same)
    assert (one.weights[0] != other.weights[0]).all()


def test_the_best_weights_of_the_passes_are_kept(monkeypatch) -> None:
    held_out = gaussian_batches(np.random.default_rng(100))
    scores = []

    def noting(network, *rest):
        scores.append(log_score(network, *rest))
        return scores[-1] if len(scores) == 5 else 9.0 + len(scores)

    monkeypatch.setattr("vsr2.posterior.network.log_score", noting)
    kept = gaussian_training(9, 3)
    assert len(scores) == 9 - 4 + 1
    assert log_score(kept, *held_out) == scores[4] != scores[-1]


# --- summaries -----------------------------------------------------------------------------------


def test_residuals_are_standardised_by_campaigns_without_effect() -> None:
    overturned = np.array([[1.0], [0.0], [1.0], [1.0], [1.0]])
    plain = np.array([True, True, True, False, False])
    values = np.array([[1.0, 1.0], [3.0, 3.0], [5.0, np.nan], [50.0, 8.0], [60.0, np.nan]])
    features = np.repeat(values[:, None, :1], 1, axis=1)
    standard = Standard.of(overturned, features, plain)
    assert standard.probability[0] == pytest.approx(2.5 / 4)
    # Three known without effect count for 3 / (3 + 5) of the mean and of the variance.
    share = 3 / (3 + SUMMARY.own)
    of_all = values[:, 0]
    assert standard.centre[0, 0] == pytest.approx(share * 3.0 + (1 - share) * of_all.mean())
    variance = share * 8 / 3 + (1 - share) * of_all.var()
    assert standard.scatter[0, 0] == pytest.approx(np.sqrt(variance))
    seen = np.array([[1.0], [0.0], [np.nan]])
    noted = np.array([[[standard.centre[0, 0] + 2 * np.sqrt(variance)]], [[1e9]], [[np.nan]]])
    found = standard.residuals(seen, noted)
    p = 2.5 / 4
    unit = np.sqrt(p * (1 - p) + SUMMARY.chance)
    np.testing.assert_allclose(found, [[(1 - p) / unit, 2.0], [-p / unit, SUMMARY.most], [0, 0]])


def test_a_feature_scatters_in_no_trial_by_less_than_a_share_of_the_median() -> None:
    rng = np.random.default_rng(0)
    features = rng.standard_normal((2000, 3, 1)) * np.array([0.001, 1.0, 1.0])[:, None]
    standard = Standard.of(np.zeros((2000, 3)), features, np.ones(2000, dtype=bool))
    expected = [SUMMARY.least_scatter, 1.0, 1.0]
    np.testing.assert_allclose(standard.scatter[:, 0], expected, rtol=0.05)


@pytest.fixture(scope="module")
def planted_directions():
    """400 campaigns of 30 trials; an effect on both sides, one on one side, and a nuisance."""
    rng = np.random.default_rng(1)
    sets, moved = [], np.zeros((400, 3))
    for i in range(400):
        acting = []
        if i % 4 in (1, 3):
            side, size = rng.choice([-1, 1]), rng.uniform(1, 8)
            acting.append(Acting("a", int(side), size, (0.0,)))
            moved[i, 0] = side * size**SUMMARY.power
        if i % 4 in (2, 3):
            size = rng.uniform(1, 8)
            acting.append(Acting("b", 1, size, (0.0,)))
            moved[i, 1] = size**SUMMARY.power
        sets.append(tuple(acting))
    moved[:, 2] = rng.standard_normal(400)
    ways = rng.standard_normal((3, 30)) / np.sqrt(30)
    plain = moved @ ways + 0.3 * rng.standard_normal((400, 30))
    copies = [plain, plain + 0.1 * rng.standard_normal((400, 30))]
    campaigns = campaigns_of(sets, moved[:, 2:])
    fold = np.arange(400) % SUMMARY.folds
    summaries, found = fit_summaries(copies, campaigns, ("a", "b"), fold, 30)
    return campaigns, moved, ways, copies, fold, summaries, found


def test_campaigns_without_effect_are_summarised_as_new_ones_are() -> None:
    """More columns than campaigns: what they are standardised by must not give a fold away."""
    rng = np.random.default_rng(4)

    def drawn(count):
        sets = [() if i % 5 == 0 else (Acting("a", 1, 2.0, (0.0,)),) for i in range(count)]
        acts = np.array([bool(acting) for acting in sets])
        return sets, acts, rng.standard_normal((count, 900)) + 0.02 * acts[:, None]

    sets, acts, plain = drawn(300)
    centre, scatter = plain[~acts].mean(axis=0), plain[~acts].std(axis=0)
    campaigns = campaigns_of(sets, rng.standard_normal((300, 1)))
    fold = rng.permutation(300) % SUMMARY.folds
    summaries, found = fit_summaries([(plain - centre) / scatter] * 2, campaigns, ("a",), fold, 900)
    _, new_acts, values = drawn(300)
    reported = summaries((values - centre) / scatter)
    for rows, new_rows in ((~acts, ~new_acts), (acts, new_acts)):
        held, fresh = found[0][rows, 0], reported[new_rows, 0]
        assert abs(held.mean() - fresh.mean()) < 4 * held.std() / np.sqrt(rows.sum())


def test_a_campaign_is_summarised_by_regressions_that_did_not_see_it(planted_directions) -> None:
    campaigns, _, _, copies, fold, summaries, found = planted_directions
    wanted, effect = targets(campaigns, ("a", "b"))
    # Both sides of a are regressed on as its size besides.
    assert effect.tolist() == [0, 1, 0, -1]
    np.testing.assert_allclose(wanted.mean(axis=0), 0, atol=1e-12)
    fitted = []
    for k in range(SUMMARY.folds):
        x = np.concatenate([copy[fold != k] for copy in copies])
        y = np.concatenate([wanted[fold != k]] * 2)
        ways = [
            ridge(x - x.mean(axis=0), y - y.mean(axis=0), penalty * 30)
            for penalty in SUMMARY.penalties
        ]
        fitted.append(min(ways, key=lambda one: np.abs(one - summaries.coefficients[k]).max()))
        np.testing.assert_allclose(fitted[-1], summaries.coefficients[k], rtol=1e-9, atol=1e-12)
        for copy, summary in zip(copies, found, strict=True):
            moved = (copy - x.mean(axis=0)) @ fitted[-1] + y.mean(axis=0)
            own = (moved / summaries.deviation)[fold == k]
            np.testing.assert_allclose(summary[fold == k, :4], own, rtol=1e-9, atol=1e-12)
    for copy, summary in zip(copies, found, strict=True):
        np.testing.assert_allclose(summaries.by_folds(copy, fold), summary, rtol=1e-9, atol=1e-12)
    # A new campaign by the mean of all of them.
    new = copies[0][:3]
    mean = new @ np.mean(fitted, axis=0) + np.mean(summaries.intercepts, axis=0)
    mean /= summaries.deviation
    np.testing.assert_allclose(summaries(new)[:, :4], mean, rtol=1e-9)
    assert np.abs(summaries(new)[:, :4] - found[0][:3, :4]).max() > 1e-3


def test_discriminants_find_the_directions_of_what_acts(planted_directions) -> None:
    _, moved, _, _, _, _, found = planted_directions
    for k, column in ((0, 0), (1, 1), (2, 3)):
        r = np.corrcoef(found[0][:, column], moved[:, k])[0, 1]
        # Signal to noise of a direction of unit length is that of the size over 0.3.
        assert r > 0.93
        others = [np.corrcoef(found[0][:, column], moved[:, j])[0, 1] for j in {0, 1, 2} - {k}]
        assert np.abs(others).max() < 0.35
    assert found[0].shape[1] == 4 + 3, "and mean square, what is left of it, and mean"


def test_what_no_discriminant_reproduces_shows_in_what_is_left(planted_directions) -> None:
    _, _, ways, copies, _, summaries, _ = planted_directions
    rng = np.random.default_rng(3)
    strange = rng.standard_normal(30)
    strange -= ways.T @ np.linalg.lstsq(ways.T, strange, rcond=None)[0]
    inside, outside = 4 * ways[0], 4 * strange / np.linalg.norm(strange)
    size = summaries(np.stack([copies[0][0] * 0 + inside, outside]))[:, 4:6]
    # Alike in size within a factor; what is left of the known one is far less.
    assert abs(size[0, 0] - size[1, 0]) < 0.5
    assert size[1, 1] > size[0, 1] + 1.0


# --- discrepancy ---------------------------------------------------------------------------------


MOTION = np.repeat(np.arange(20), 10)

UNIT = float(np.linalg.norm(DISCREPANCY.parts))


def at_factor(monkeypatch, factor):
    fixed = replace(DISCREPANCY, least=factor, most=factor)
    monkeypatch.setattr("vsr2.posterior.discrepancy.DISCREPANCY", fixed)


@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_outcomes_turn_as_often_as_a_shifted_normal_variable_changes_side(
    monkeypatch, factor
) -> None:
    from scipy.stats import multivariate_normal, norm

    at_factor(monkeypatch, factor)
    rng = np.random.default_rng(0)
    shift = factor * DISCREPANCY.outcome * UNIT
    turned = []
    for p in (0.5, 0.1):
        outcome = (rng.random((1000, 200)) < p).astype(float)
        blank = np.zeros((1000, 200, 0))
        probability, scatter = np.full(200, p), np.zeros((200, 0))
        found, _, _ = disturbed(outcome, blank, probability, scatter, MOTION, rng)
        turned.append(float((found != outcome).mean()))
    # At even odds arccos(r) / pi, r the correlation of the variable before and after.
    r = 1 / np.sqrt(1 + shift**2)
    assert turned[0] == pytest.approx(np.arccos(r) / np.pi, rel=0.05)
    limit = norm.ppf(0.9)
    both = multivariate_normal([0, 0], [[1, 1], [1, 1 + shift**2]]).cdf
    turns = 0.9 + norm.cdf(limit, scale=np.sqrt(1 + shift**2)) - 2 * both([limit, limit])
    assert turned[1] == pytest.approx(turns, rel=0.08)


def test_disturbances_have_the_moments_that_are_stated(monkeypatch) -> None:
    at_factor(monkeypatch, 1.0)
    rng = np.random.default_rng(1)
    features = np.zeros((1500, 200, 2))
    unknown = np.full((1500, 200), np.nan)
    scatter = np.full((200, 2), [9.0, 0.5])
    outcome, found, _ = disturbed(unknown, features, np.full(200, 0.5), scatter, MOTION, rng)
    assert np.isnan(outcome).all(), "what is unknown stays so"
    tilt, other = found[..., 0], found[..., 1]
    campaign, motion, single = DISCREPANCY.parts
    assert tilt.std() == pytest.approx(UNIT, rel=0.02)
    same, apart = (tilt[:, 0] * tilt[:, 1]).mean(), (tilt[:, 0] * tilt[:, 15]).mean()
    error = 4 * UNIT**2 / np.sqrt(1500)
    assert same == pytest.approx(campaign**2 + motion**2, abs=error)
    assert apart == pytest.approx(campaign**2, abs=error)
    # Means of motions, ten trials each, and of campaigns.
    means = tilt.reshape(1500, 20, 10).mean(axis=2)
    variance = campaign**2 + motion**2 + single**2 / 10
    assert means.var() == pytest.approx(variance, rel=0.05)
    assert tilt.mean(axis=1).var() == pytest.approx(
        campaign**2 + motion**2 / 20 + single**2 / 200, rel=0.15
    )
    assert other.std() == pytest.approx(DISCREPANCY.series * 0.5, rel=0.02)
    r = np.corrcoef(tilt.ravel(), other.ravel())[0, 1]
    assert r == pytest.approx(DISCREPANCY.common, abs=0.02)


def test_sizes_are_drawn_for_each_campaign() -> None:
    rng = np.random.default_rng(2)
    unknown, features = np.full((600, 200), np.nan), np.zeros((600, 200, 1))
    _, found, drawn = disturbed(
        unknown, features, np.full(200, 0.5), np.ones((200, 1)), MOTION, rng
    )
    factor = found[..., 0].std(axis=1) / UNIT
    assert np.corrcoef(np.log(factor), np.log(drawn))[0, 1] > 0.9
    middle = np.sqrt(DISCREPANCY.least * DISCREPANCY.most)
    assert np.median(factor) == pytest.approx(middle, rel=0.15)
    assert factor.min() == pytest.approx(DISCREPANCY.least, rel=0.4)
    assert factor.max() == pytest.approx(DISCREPANCY.most, rel=0.4)


def test_what_turns_loses_its_features_and_what_was_unknown_stays_so() -> None:
    rng = np.random.default_rng(3)
    overturned = (rng.random((400, 200)) < 0.4).astype(float)
    overturned[:, 7] = np.nan
    features = np.where(overturned[..., None] < 0.5, 1.0, np.nan)
    features[:, 3] = np.nan
    found, noted, _ = disturbed(
        overturned, features, np.full(200, 0.4), np.ones((200, 1)), MOTION, rng
    )
    turned = (found != overturned) & np.isfinite(overturned)
    assert turned.any(axis=0).sum() == 199
    assert np.isnan(found[:, 7]).all()
    assert set(np.unique(found[:, :7])) == {0.0, 1.0}
    np.testing.assert_array_equal(
        np.isfinite(noted[..., 0]), ~turned & (overturned == 0) & (np.arange(200) != 3)
    )


def test_effects_are_joined_by_what_the_library_declares_alike() -> None:
    assert with_alike(["table_resonance"], library()) == {"table_pitch", "table_resonance"}
    alike = with_alike(["slenderness", "a stranger"], library())
    assert alike >= {"a stranger", "edge_rounding", "slenderness", "table_gain"}
    assert with_alike([], library()) == set()
