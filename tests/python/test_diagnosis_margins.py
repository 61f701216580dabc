"""What acts by margins: coordinates, the search, the emulator, likelihood, and the sampler."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import norm

from vsr2.analysis.overturning_margin import MARGIN
from vsr2.diagnosis.margins import held_out_causes
from vsr2.diagnosis.margins.acting_posterior import sample_posterior
from vsr2.diagnosis.margins.cause_space import cause_space, draw_scene
from vsr2.diagnosis.margins.held_out_causes import HeldOutCauses, held_out_probability
from vsr2.diagnosis.margins.margin_emulator import emulator_of, fit_emulator
from vsr2.diagnosis.margins.margin_kernel import KernelLoss, fit_kernel, parts
from vsr2.diagnosis.margins.margin_levels import Level, margin_levels
from vsr2.diagnosis.margins.margin_search import SEARCH, search_margins
from vsr2.diagnosis.margins.outcome_model import (
    OUTCOME_MODEL,
    OutcomeModel,
    Particles,
    acting_share,
    emulated_nuisances,
)
from vsr2.diagnosis.margins.simulated_scenes import SCENES, _alone
from vsr2.diagnosis.margins.trial_groups import TRIAL_GROUPS, TrialGroups, trial_groups
from vsr2.effects import library

# --- coordinates ----------------------------------------------------------------------------------


def test_a_point_where_nothing_acts_has_no_features_and_no_effects() -> None:
    space = cause_space(library())
    rng = np.random.default_rng(0)
    points = space.draw(50, rng)
    nothing = np.zeros((50, len(space.names)), dtype=bool)
    assert not space.features(points, nothing).any()
    assert space.effects(points[0], nothing[0]) == ()
    assert len(space.feature_names) == space.features(points, ~nothing).shape[1]


def test_values_lie_in_their_priors_and_reach_their_ends() -> None:
    space = cause_space(library())
    points = space.draw(400, np.random.default_rng(1))
    for name in space.names:
        rows = np.array([space.values(name, point) for point in points])
        for k, p in enumerate(space.library[name].parameters):
            if p.prior == "fixed":
                continue
            own = rows[:, k][rows[:, k] != p.null]
            assert (own >= p.lower - 1e-12).all(), p.name
            assert (own <= p.upper + 1e-12).all(), p.name
            low, high = (p.ppf(q) for q in (0.1, 0.9))
            assert own.max() > low, p.name
            assert own.min() < high, p.name
        assert all(
            len(effects) == 1 for effects in [space.effects(points[0], rows_on(space, name))]
        )


def rows_on(space, name):
    return np.array([other == name for other in space.names])


@pytest.mark.parametrize("ends", [None, (0.0, 360.0), (-90.0, 270.0)])
def test_a_primary_angle_is_known_by_where_it_points(ends) -> None:
    effect = library()["registration"]
    if ends is not None:
        effect = effect.with_prior("yaw", *ends)
    space = cause_space({"registration": effect})
    points = space.draw(200, np.random.default_rng(14))
    points[:, 1] = 0  # So that the yaw is the farthest from its null.
    features = space.features(points, np.ones((200, 1), dtype=bool))
    yaw = np.radians([space.values("registration", point)[0] for point in points])
    columns = [space.feature_names.index(f"registration.yaw.{part}") for part in ("cos", "sin")]
    expected = np.stack([np.cos(yaw) - 1, np.sin(yaw)], axis=1)
    np.testing.assert_allclose(features[:, columns], expected, atol=1e-8)


def test_every_effect_moves_features_of_its_own_alone() -> None:
    space = cause_space(library())
    points = space.draw(30, np.random.default_rng(2))
    owner = np.array([label.partition(".")[0] for label in space.feature_names])
    for name in space.names:
        acts = np.tile(rows_on(space, name), (30, 1))
        features = space.features(points, acts)
        assert features[:, owner == name].any(), name
        assert not features[:, owner != name].any(), name


def test_scenes_can_be_drawn_alone_and_the_first_is_nominal() -> None:
    space = cause_space(library())
    acts = np.stack([draw_scene(space, row, 3)[1] for row in range(40)])
    for one, again in zip(draw_scene(space, 17, 3), draw_scene(space, 17, 3), strict=True):
        np.testing.assert_array_equal(one, again)
    assert (acts[17] != acts[18]).any()
    assert not acts[0].any()
    assert acts[1:].any(axis=0).all(), "each effect acts somewhere"


# --- search ---------------------------------------------------------------------------------------


def searched(margins, guess):
    """Found margins of rocks with known ones, and how often each was shaken."""
    shaken = np.zeros(margins.size, dtype=int)

    def overturns(rows, logs):
        np.add.at(shaken, rows, 1)
        return np.where(np.isnan(margins.ravel()[rows]), np.nan, logs > margins.ravel()[rows])

    return search_margins(overturns, guess), shaken.reshape(margins.shape)


@pytest.mark.parametrize("guess", [-1.0, 0.0, 0.31, 1.0])
def test_margins_are_found_from_any_guess(guess) -> None:
    margins = np.random.default_rng(4).normal(0.0, 0.7, (20, 15))
    found, shaken = searched(margins, np.full(margins.shape, guess))
    clipped = np.clip(margins, -SEARCH.reach, SEARCH.reach)
    assert np.abs(found - clipped).max() <= 0.5 * SEARCH.width + 1e-12
    # Eight doublings and halvings reach any place from anywhere.
    assert shaken.max() <= 10


def test_what_always_stands_is_shaken_once_where_that_is_known() -> None:
    found, shaken = searched(np.full((1, 4), 3.0), np.ones((1, 4)))
    assert (found == SEARCH.reach).all()
    assert (shaken == 1).all()


def test_a_simulation_that_fails_leaves_no_margin() -> None:
    found, _ = searched(np.array([[0.2, np.nan]]), np.zeros((1, 2)))
    assert np.isfinite(found[0, 0])
    assert np.isnan(found[0, 1])


def test_where_nothing_is_known_the_search_begins_from_the_motion_as_it_is() -> None:
    margins = np.array([[0.2, -0.4]])
    first = []

    def overturns(rows, logs):
        first.append(logs.copy())
        return (logs > margins.ravel()[rows]).astype(float)

    found = search_margins(overturns, np.array([[np.nan, 0.25]]))
    np.testing.assert_array_equal(first[0], [0.0, 0.25])
    assert np.abs(found - margins).max() <= 0.5 * SEARCH.width + 1e-12


# --- groups and levels ----------------------------------------------------------------------------


def test_each_group_has_trials_of_every_motion() -> None:
    motions = np.repeat(["a", "b", "c", "d"], [9, 8, 10, 2])
    groups = trial_groups(motions)
    assert len(groups) == 8.5 // TRIAL_GROUPS.asked
    assert groups.asked.any(axis=0).all(), "each trial is asked for"
    for k in range(groups.motions):
        counts = groups.asked[:, groups.motion == k].sum(axis=1)
        assert counts.min() >= 1
        assert np.ptp(counts) <= 1
    assert np.ptp(groups.asked.sum(axis=1)) <= groups.motions


def test_trials_of_motions_of_their_own_are_asked_for_in_every_scene() -> None:
    groups = trial_groups(np.array(["a", "b", "c"]))
    assert len(groups) == 1
    assert groups.asked.all()


def three_levels(scenes, rng):
    """Margins that are sums of a scene's, a motion's and a trial's, and those asked for."""
    groups = trial_groups(np.repeat([f"m{i}" for i in range(5)], 6))
    group = np.arange(scenes) % len(groups)
    common = rng.normal(0, 0.3, scenes)
    by_motion = rng.normal(0, 0.2, (scenes, 5))
    by_trial = rng.normal(0, 0.05, (scenes, 30))
    centre = rng.normal(0, 1, 30)
    margins = centre + common[:, None] + by_motion[:, groups.motion] + by_trial
    return np.where(groups.asked[group], margins, np.nan), group, groups


def test_levels_sum_to_the_margins_that_were_found() -> None:
    asked, group, groups = three_levels(40, np.random.default_rng(3))
    levels = margin_levels(asked, group, groups)
    assert np.abs(levels.by_motion.sum(axis=1)).max() < 1e-12
    for one in levels.by_trial:
        rows = np.ix_(one.scenes, one.trials)
        motion = groups.motion[one.trials]
        total = levels.centre[one.trials] + levels.common[one.scenes, None]
        total = total + levels.by_motion[one.scenes][:, motion] + one.deviations
        np.testing.assert_allclose(total, asked[rows], atol=1e-12)
        assert one.free == one.trials.size - groups.motions


def test_a_motion_whose_margins_never_differ_is_left_out() -> None:
    asked, group, groups = three_levels(30, np.random.default_rng(5))
    asked[:, groups.motion == 2] = np.where(np.isfinite(asked[:, groups.motion == 2]), 1.0, np.nan)
    levels = margin_levels(asked, group, groups)
    assert levels.varied.tolist() == [True, True, False, True, True]
    assert not levels.by_motion[:, 2].any()
    assert {one.count for one in parts(levels)} == {1, 3, 4}


# --- emulator -------------------------------------------------------------------------------------


def quadratic(features):
    """Margins of three trials, with a square and a product."""
    x, y = features[:, 0], features[:, 1]
    return np.stack([0.3 * x + 0.1 * y, 0.2 - 0.4 * x * y, 0.2 * y**2 - 0.3 * x], axis=1)


def fitted(features, margins, motions=None):
    """Every scene was asked for all trials."""
    motion = np.arange(margins.shape[1]) if motions is None else np.asarray(motions)
    groups = TrialGroups(motion, np.ones((1, motion.size), dtype=bool))
    return fit_emulator(features, margins, np.zeros(len(features), dtype=int), groups)


def told(emulator, features):
    return emulator(features, np.zeros(len(features)))


@pytest.fixture(scope="module")
def emulator():
    features = np.random.default_rng(5).uniform(-1, 1, (80, 6))
    return fitted(features, quadratic(features))


def test_an_emulator_learns_squares_and_products(emulator) -> None:
    features = np.random.default_rng(6).uniform(-1, 1, (200, 6))
    mean, by_motion, by_trial = told(emulator, features)
    errors = mean - quadratic(features)
    # The least noise of a level is exp(-4) = 0.018; its mean error is a part of that.
    assert np.sqrt((errors**2).mean()) < 0.01
    assert (by_motion >= emulator.kernel.noise[Level.MOTION] ** 2).all()
    assert not by_trial.any(), "each trial is the only one of its motion"
    used, idle = emulator.kernel.weights[:2], emulator.kernel.weights[2:]
    assert idle.max() < 0.05 * used.min()


def grouped(rng, scenes=60):
    """Effects of all trials, of motions and of single trials, of which a part is asked for."""
    groups = trial_groups(np.repeat([f"m{i}" for i in range(6)], 6))
    features = rng.uniform(-1, 1, (scenes, 5))
    slopes = np.tile(np.array([0.4, -0.2, 0.0, 0.0, 0.0])[:, None], 36)
    slopes[2:4] += rng.normal(0, 0.2, (2, 6))[:, groups.motion]
    slopes[:2] += rng.normal(0, 0.05, (2, 36))
    margins = features @ slopes + rng.normal(0, 0.03, (scenes, 36))
    group = np.arange(scenes) % len(groups)
    return features, margins, np.where(groups.asked[group], margins, np.nan), group, groups


def test_trials_that_were_not_asked_for_are_told_by_those_of_their_motion() -> None:
    """A third of the margins serves nearly as all, and better than a third of the scenes."""
    rng = np.random.default_rng(7)
    features, margins, asked, group, groups = grouped(rng, 90)
    train, rest = slice(0, 60), slice(60, 90)
    third = fit_emulator(features[train], asked[train], group[train], groups)
    few = fitted(features[:20], margins[:20], groups.motion)
    every = fitted(features[train], margins[train], groups.motion)
    error = {
        name: np.sqrt(((told(one, features[rest])[0] - margins[rest]) ** 2).mean())
        for name, one in (("third", third), ("few", few), ("every", every))
    }
    assert error["every"] <= error["third"] < error["few"]
    # The noise of a margin is 0.03; twenty scenes tell slopes of single trials to some 0.02.
    assert error["third"] < 0.05


def test_errors_of_scenes_left_out_are_those_of_an_emulator_without_them() -> None:
    rng = np.random.default_rng(8)
    features, _, asked, group, groups = grouped(rng)
    levels = margin_levels(asked, group, groups)
    whole = emulator_of(fit_kernel(features, levels), features, levels)
    for row in (0, 7):
        rest = np.arange(len(features)) != row
        others = replace(margin_levels(asked[rest], group[rest], groups), centre=levels.centre)
        without = emulator_of(whole.kernel, features[rest], others)
        mean, by_motion, by_trial = told(without, features[[row]])
        own = groups.asked[group[row]]
        # The mean of a trial has moved a little, and numbers of trials are typical ones.
        np.testing.assert_allclose(whole.errors[row, own], (asked[row] - mean[0])[own], atol=0.03)
        common = without.processes[Level.ALL].variance(features[[row]] * whole.kernel.weights)
        spread = np.sqrt(by_motion[0] + by_trial[0] + common[0])
        np.testing.assert_allclose(whole.expected[row, own], spread, rtol=0.15)
    assert np.isnan(whole.errors[0][~groups.asked[group[0]]]).all()


def test_an_error_that_all_trials_share_moves_all_of_them(emulator) -> None:
    features = np.random.default_rng(6).uniform(-2, 2, (5, 6))
    plain, moved = (emulator(features, np.full(5, error))[0] for error in (0.0, 1.0))
    shift = moved - plain
    variance = emulator.processes[Level.ALL].variance(features * emulator.kernel.weights)
    np.testing.assert_allclose(shift, np.tile(np.sqrt(variance)[:, None], 3), rtol=1e-9)


def test_the_gradient_of_the_loss_of_a_kernel() -> None:
    rng = np.random.default_rng(8)
    features, _, asked, group, groups = grouped(rng, 24)
    loss = KernelLoss(features, tuple(parts(margin_levels(asked, group, groups))))
    logs = loss.start() + rng.normal(0, 0.3, loss.start().size)
    assert logs.size == len(loss.ends()) == 5 + 2 + 2 + 3
    gradient = loss(logs)[1]
    for k in range(logs.size):
        step = 1e-6 * np.eye(logs.size)[k]
        ends = [loss(logs + sign * step)[0] for sign in (1, -1)]
        assert gradient[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-3)


def test_a_failed_margin_counts_as_the_mean(emulator) -> None:
    features = np.random.default_rng(5).uniform(-1, 1, (80, 6))
    margins = quadratic(features)
    margins[4, 1] = np.nan
    assert np.isfinite(told(fitted(features, margins), features)[0]).all()


def test_margins_that_are_equal_everywhere_have_no_error() -> None:
    features = np.random.default_rng(5).uniform(-1, 1, (30, 2))
    same = fitted(features, np.ones((30, 3))).quality()
    assert same["used"] == 30
    assert same["spread"] is same["error"] is same["error_over_expected"] is None
    varied = fitted(features, quadratic(np.tile(features, 3))).quality()
    assert 0 < varied["error"] < varied["spread"]


# --- likelihood and sampler -----------------------------------------------------------------------

NAMES = ("slenderness", "friction")


def toy(overturned, motions, emulator=None, **changes) -> OutcomeModel:
    """Trials whose margins grow with slenderness and not with friction."""
    space = replace(cause_space(library()), names=NAMES)
    overturned = np.asarray(overturned, dtype=bool)
    if emulator is None:
        rng = np.random.default_rng(9)
        points = space.draw(60, rng)
        acts = rng.random((60, 2)) < 0.7
        nuisances = rng.standard_normal((60, 1))
        features = np.hstack([space.features(points, acts), emulated_nuisances(nuisances)])
        offsets = np.linspace(-0.4, 0.4, overturned.size)
        emulator = fitted(features, offsets + 0.5 * features[:, :1])
    return OutcomeModel(space, emulator, overturned, np.asarray(motions), 1, **changes)


def at(space, slenderness, *, acts=True, scatter=(0.0, 0.0)) -> Particles:
    point = np.zeros((1, len(space.coordinates)))
    point[0, 0] = slenderness
    on = np.array([[acts, False, False]])
    return Particles(point, on, np.zeros((1, 1)), np.zeros(1), np.array([scatter]), np.zeros(1))


def test_a_trial_of_its_own_motion_has_the_probability_of_a_normal_margin() -> None:
    model = toy([True, False, True], ["a", "b", "c"])
    given = at(model.space, 0.3)
    mean, of_motion, of_trial = model.margins(given)
    spread = np.sqrt(OUTCOME_MODEL.motion**2 + OUTCOME_MODEL.trial**2 + of_motion[0] + of_trial[0])
    chance = (1 - MARGIN.lapse) * ndtr(-mean[0] / spread) + 0.5 * MARGIN.lapse
    np.testing.assert_allclose(model.probability(given, np.arange(3)), chance, rtol=1e-12)
    expected = np.log(chance[0]) + np.log(1 - chance[1]) + np.log(chance[2])
    # The ends left out, beyond 4 standard deviations, hold 6e-5 of each of three probabilities.
    assert model.log_likelihood(given, np.arange(3))[0] == pytest.approx(expected, abs=5e-4)


def test_the_sum_over_a_motion_s_part_is_its_integral() -> None:
    """Where motions scatter three times as trials do, and its outcomes contradict one another."""
    outcomes = np.array([True, False, True, False])
    model = toy(outcomes, ["a"] * 4)
    ratio = 3.0 * OUTCOME_MODEL.trial / OUTCOME_MODEL.motion
    given = at(model.space, 0.3, scatter=(np.log(ratio) / OUTCOME_MODEL.spread, 0.0))
    mean, of_motion, of_trial = model.margins(given)
    (by_motion,), (by_trial,) = model.scatter(given)
    common = np.hypot(by_motion, np.sqrt(of_motion[0]))
    by_trial = np.hypot(by_trial, np.sqrt(of_trial[0]))

    def likelihood(part: float) -> float:
        chance = ndtr(np.where(outcomes, 1, -1) * (part * common - mean[0]) / by_trial)
        return float(np.prod((1 - MARGIN.lapse) * chance + 0.5 * MARGIN.lapse) * norm.pdf(part))

    expected = np.log(quad(likelihood, -8, 8, epsabs=1e-12, limit=200)[0])
    assert model.log_likelihood(given, np.arange(4))[0] == pytest.approx(expected, abs=2e-4)


def test_trials_of_one_motion_are_not_witnesses_of_their_own() -> None:
    alone, together = (toy([True] * 3, motions) for motions in (["a", "b", "c"], ["a"] * 3))
    given = at(alone.space, -0.6, scatter=(3.0, 0.0))
    rows = np.arange(3)
    # Their common part makes equal outcomes likelier.
    assert together.log_likelihood(given, rows)[0] > alone.log_likelihood(given, rows)[0] + 0.1
    order = np.array([2, 0, 1])
    assert together.log_likelihood(given, order)[0] == pytest.approx(
        together.log_likelihood(given, rows)[0]
    )


def test_a_stronger_motion_takes_its_logarithm_off_all_margins() -> None:
    model = toy([True, False], ["a", "b"])
    plain = at(model.space, 0.0)
    acts = plain.acts.copy()
    acts[0, -1] = True
    strong = replace(plain, acts=acts, strength=np.ones(1))
    shift = model.margins(plain)[0] - model.margins(strong)[0]
    np.testing.assert_allclose(shift, OUTCOME_MODEL.strength)
    assert model.log_strength(plain)[0] == 0


def test_a_trial_without_a_margin_tells_nothing() -> None:
    motions = ["a", "a", "b"]
    given, rows = at(toy([True] * 3, motions).space, 0.3), np.arange(3)
    found = {}
    for outcome in (True, False):
        model = toy([True, outcome, False], motions)
        emulator = model.emulator
        centre = np.where(rows == 1, np.nan, emulator.levels.centre)
        levels = replace(emulator.levels, centre=centre)
        model = replace(model, emulator=replace(emulator, levels=levels))
        found[outcome] = model.log_likelihood(given, rows)[0]
        assert model.probability(given, rows)[1] == 0.5
        rest = model.log_likelihood(given, np.array([0, 2]))[0]
        assert found[outcome] == pytest.approx(rest + np.log(0.5), abs=1e-12)
        posterior = sample_posterior(model, rows, np.random.default_rng(3), particles=30)
        assert np.isfinite(posterior.log_evidence)


def test_evidence_and_what_acts_are_those_of_a_sum_over_the_prior() -> None:
    """By plain Monte Carlo over the prior, which few parameters and outcomes allow."""
    outcomes = np.arange(8) < 1
    model = toy(outcomes, [f"m{i}" for i in range(8)])
    rows, rng = np.arange(8), np.random.default_rng(10)
    drawn = model.draw(40_000, rng)
    weight = np.exp(model.log_likelihood(drawn, rows))
    expected = weight @ drawn.acts / weight.sum()
    found = [sample_posterior(model, rows, np.random.default_rng(seed)) for seed in range(8)]
    acting = np.mean([one.particles.acts.mean(axis=0) for one in found], axis=0)
    # 4,800 particles, of which some hundreds are independent: 0.02 is a standard deviation.
    np.testing.assert_allclose(acting, expected, atol=0.07)
    evidence = np.mean([one.log_evidence for one in found])
    # Evidences of single seeds scatter by 0.07.
    assert evidence == pytest.approx(np.log(weight.mean()), abs=0.1)
    assert expected[0] > model.prior[0] + 0.05, "outcomes say that slenderness acts"
    assert abs(expected[1] - model.prior[1]) < 0.05, "and nothing of friction"


def test_what_may_not_act_does_not() -> None:
    model = toy(np.arange(6) < 3, [f"m{i}" for i in range(6)], allowed=frozenset({"friction"}))
    found = sample_posterior(model, np.arange(6), np.random.default_rng(11))
    share = acting_share(found.particles, model.names)
    assert share["slenderness"] == 0
    assert share["table_gain"] == 0
    assert share["friction"] > 0
    assert model.looked_for == ("friction",)
    none = replace(model, allowed=frozenset())
    particles = sample_posterior(none, np.arange(6), np.random.default_rng(11)).particles
    assert not particles.acts.any()


def test_what_acts_for_sure_does() -> None:
    """The rest is as likely as where all outcomes were of scenes that have it."""
    model = toy(np.arange(6) < 3, [f"m{i}" for i in range(6)], certain=frozenset({"friction"}))
    for seed in range(3):
        found = sample_posterior(model, np.arange(6), np.random.default_rng(seed)).particles
        assert found.acts[:, model.names.index("friction")].all()
        assert 0 < found.acts[:, model.names.index("slenderness")].mean() < 1


def test_half_a_likelihood_leaves_what_acts_less_sure() -> None:
    outcomes = np.arange(10) < 10
    model = toy(outcomes, [f"m{i}" for i in range(10)])
    rows = np.arange(10)
    drawn = model.draw(40_000, np.random.default_rng(15))
    logs, acting = model.log_likelihood(drawn, rows), []
    for power in (0.5, 1.0):
        weight = np.exp(power * logs)
        expected = weight @ drawn.acts / weight.sum()
        found = [
            sample_posterior(model, rows, np.random.default_rng(seed), power=power)
            for seed in range(6)
        ]
        acting.append(np.mean([one.particles.acts.mean(axis=0) for one in found], axis=0))
        # 3,600 particles, of which some hundreds are independent: 0.025 is a standard deviation.
        np.testing.assert_allclose(acting[-1], expected, atol=0.08)
    assert acting[0][-1] < acting[1][-1] - 0.05, "all overturned: the motion is stronger"


def test_each_effect_comes_alone_where_it_explains_the_outcomes() -> None:
    """Rocks that overturn more often than the scene's are slender; friction tells nothing."""
    model = toy(np.ones(12, dtype=bool), [f"m{i}" for i in range(12)])
    chosen = _alone(model, 60, 1.0, np.random.default_rng(16))
    assert len(chosen) == 60
    effects = chosen.acts[:, :-1]
    assert (effects.sum(axis=1) == 1).all()
    assert effects.sum(axis=0).tolist() == [30, 30]
    coordinate = model.space.effect_of
    slender = chosen.points[effects[:, 0]][:, coordinate == 0]
    free = chosen.points[effects[:, 1]][:, coordinate == 1]
    assert slender[:, 0].mean() < -0.1, "a slender rock has smaller margins"
    # Thirty draws from the prior: their mean scatters by a tenth of the range.
    assert (
        abs(
            free[:, 0].mean()
            - model.space.draw(4000, np.random.default_rng(0)).mean(axis=0)[coordinate == 1][0]
        )
        < 0.35
    )


def test_shares_of_scenes_leave_none_out() -> None:
    for count in (SCENES.least, 60, SCENES.usual):
        single, several = SCENES.ends(count)
        ends = [SCENES.at_random(count), *single, *several]
        assert ends == sorted(ends)
        assert ends[-1] == count


def test_a_motion_is_predicted_by_the_others_alone(monkeypatch) -> None:
    rng = np.random.default_rng(12)
    motions = np.repeat([f"m{i}" for i in range(6)], 4)
    fold = np.repeat([0, 1, 2], 8)
    monkeypatch.setattr(held_out_causes, "grouped_folds", lambda *_: fold)
    outcomes = rng.random(24) < 0.4
    model = toy(outcomes, motions)
    found = held_out_probability(model, 0)
    assert ((found > 0) & (found < 1)).all()
    other = np.where(motions == "m2", ~outcomes, outcomes)
    changed = held_out_probability(replace(model, overturned=other), 0)
    np.testing.assert_array_equal(changed[fold == 1], found[fold == 1])
    assert (changed[fold != 1] != found[fold != 1]).all()


def test_shares_sum_to_what_all_causes_take_off() -> None:
    rng = np.random.default_rng(13)
    overturned = rng.random(30) < 0.5
    names = ("a", "b", "c")
    sets = [frozenset(chosen) for k in range(4) for chosen in combinations(names, k)]
    given = {one: rng.uniform(0.1, 0.9, 30) for one in sets}
    judged = HeldOutCauses(names, given, rng.uniform(0.1, 0.9, 30), overturned, np.arange(30) % 5)
    total = sum(judged.share(name) for name in names)
    np.testing.assert_allclose(total, judged.loss(frozenset()) - judged.loss(frozenset(names)))


def test_what_does_not_act_keeps_its_prior() -> None:
    """Coordinates and strength of what ceases to act are drawn again."""
    outcomes = np.arange(8) < 7
    model = toy(outcomes, [f"m{i}" for i in range(8)])
    idle = []
    for seed in range(4):
        drawn = sample_posterior(model, np.arange(8), np.random.default_rng([14, seed])).particles
        idle.append(drawn.strength[~drawn.acts[:, -1]])
        assert drawn.strength[drawn.acts[:, -1]].mean() > 0.2, "seven of eight overturned"
    values = np.concatenate(idle)
    # Some hundreds are independent: 0.05 is a standard deviation.
    assert abs(values.mean()) < 0.2
    assert values.std() == pytest.approx(1.0, abs=0.15)
