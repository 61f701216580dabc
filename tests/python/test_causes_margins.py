"""What acts by margins: coordinates, the search, the emulator, likelihood, and the sampler."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import norm

from margin_samples import fitted
from vsr2.analysis.overturning_margin import MARGIN
from vsr2.causes.margins import held_out_causes
from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.cause_space import cause_space, draw_scene
from vsr2.causes.margins.held_out_causes import HeldOutCauses, held_out_probability, judge_causes
from vsr2.causes.margins.margin_search import SEARCH, search_margins
from vsr2.causes.margins.outcome_model import (
    OUTCOME_MODEL,
    OutcomeModel,
    Particles,
    acting_share,
    emulated_nuisances,
)
from vsr2.causes.margins.simulated_scenes import SCENES, _alone
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


def test_likely_causes_are_chosen_by_the_other_motions(monkeypatch) -> None:
    """All of one fold overturns and most of the rest: slenderness is likely where that is seen."""
    motions = np.repeat([f"m{i}" for i in range(6)], 4)
    fold = np.repeat([0, 1, 2], 8)
    monkeypatch.setattr(held_out_causes, "grouped_folds", lambda *_: fold)
    outcomes = fold != 1
    model = toy(outcomes, motions)
    shares: list[float] = []
    judged = judge_causes(model, (), likely=0.5, progress=shares.append)
    assert len(shares) == 9, "each fold without a cause, with all effects, and with the likely ones"
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert set(judged.likely_in) == {0, 1, 2}
    # Without the fold that stood, only a stronger motion or a more slender rock explain the rest.
    assert judged.likely_in[1]
    for k, names in judged.likely_in.items():
        sure = replace(model, allowed=names, certain=names)
        alone = held_out_probability(sure, 0)
        np.testing.assert_array_equal(judged.likely[fold == k], alone[fold == k])
    other = judge_causes(replace(model, overturned=np.ones(24, dtype=bool)), (), likely=0.5)
    assert other.likely_in[1] == judged.likely_in[1]
    np.testing.assert_array_equal(other.likely[fold == 1], judged.likely[fold == 1])
    assert judge_causes(model, (), likely=0.0).likely_in[0] == frozenset(model.names)


def test_shares_sum_to_what_all_causes_take_off() -> None:
    rng = np.random.default_rng(13)
    overturned = rng.random(30) < 0.5
    names = ("a", "b", "c")
    sets = [frozenset(chosen) for k in range(4) for chosen in combinations(names, k)]
    given = {one: rng.uniform(0.1, 0.9, 30) for one in sets}
    everything, fold = rng.uniform(0.1, 0.9, 30), np.arange(30) % 5
    judged = HeldOutCauses(names, given, everything, everything, {}, overturned, fold)
    total = sum(judged.gains(name)["share"] for name in names)
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
