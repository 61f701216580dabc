"""HOW FAR: losses of ensembles, before and after on held-out motions, controls, the noise floor."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from diagnosis_samples import linear, linear_rehearsal, quick_training
from planar.planar_library import PLANAR_LIBRARY
from planted import shaken_campaign
from vsr2.analysis.probability import outcome_loss
from vsr2.diagnosis.how_far import held_out as module
from vsr2.diagnosis.how_far.ensemble_losses import (
    Ensemble,
    LossInterval,
    by_kind,
    feature_scores,
    resampled_means,
    share_of_gap,
)
from vsr2.diagnosis.how_far.held_out import (
    HELD_OUT,
    HowFar,
    Inferred,
    Loss,
    judge,
    rows,
    simulations,
)
from vsr2.diagnosis.how_far.negative_controls import recalibrated
from vsr2.diagnosis.how_far.waterfall import FullInference, Waterfall, waterfall
from vsr2.ensemble.noise_floor import NOISE_FLOOR, noise_floor
from vsr2.ensemble.observed.observations import observe_campaign
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.simulator import Responses
from vsr2.posterior.training import train
from vsr2.report.messages.verdicts import interval

# --- losses --------------------------------------------------------------------------------------


def test_outcomes_are_judged_by_the_share_of_simulations() -> None:
    simulated = Ensemble(np.array([[1, 0, 1], [1, 0, 0], [1, 0, np.nan]]), np.zeros((3, 3, 0)))
    # (3 + 1/2) of 4, (0 + 1/2) of 4, (1 + 1/2) of 3.
    np.testing.assert_allclose(simulated.probability, [3.5 / 4, 0.5 / 4, 1.5 / 3])
    found = outcome_loss(simulated.probability, np.array([1, 1, np.nan]))
    np.testing.assert_allclose(found, [-np.log(3.5 / 4), -np.log(0.5 / 4), 0.0])
    assert len(simulated.take([0, 2])) == 2


@pytest.mark.parametrize("members", [3, 24])
def test_the_ensemble_s_score_is_that_of_its_distribution(members) -> None:
    """CRPS of a standard normal at 0.5 is 0.3314 whatever the number of members, on average."""
    x = np.random.default_rng(1).standard_normal((members, 40_000, 1))
    score = feature_scores(x, np.full((40_000, 1), 0.5))
    # phi(0.5) = 0.3521, Phi(0.5) = 0.6915: 0.5 (2 Phi - 1) + 2 phi - 1 / sqrt(pi).
    assert score.mean() == pytest.approx(0.3314, abs=4 * score.std() / 200)


def test_a_feature_needs_two_simulations_and_an_observation() -> None:
    x = np.array([[1.0, 1.0, 1.0], [np.nan, 2.0, 2.0], [np.nan, np.nan, 3.0]])[..., None]
    score = feature_scores(x, np.array([[1.0], [1.0], [np.nan]]))
    assert np.isnan(score[[0, 2], 0]).all()
    # Members 1 and 2 about 1: a mean distance of 1/2, less half the mean distance of two.
    assert score[1, 0] == pytest.approx(0.5 - 0.5)
    three = feature_scores(np.array([[0.0], [1.0], [5.0]])[:, None], np.array([[2.0]]))
    # (2 + 1 + 3) / 3 less half the mean distance of pairs, (1 + 5 + 4) / 3.
    assert three[0, 0] == pytest.approx(2 - 5 / 3)


def test_the_tilt_counts_once_and_what_the_series_tells_by_its_mean() -> None:
    scores = np.array([[1.0, 2.0, np.nan, 4.0], [np.nan, 3.0, 3.0, 3.0]])
    np.testing.assert_allclose(by_kind(scores), [1 + 6 / 3, 3.0])
    np.testing.assert_allclose(by_kind(scores[:, :1]), [1.0, 0.0])
    np.testing.assert_array_equal(by_kind(np.zeros((2, 0))), 0.0)


def test_means_are_resampled_by_complete_motions() -> None:
    motion = np.array([0, 0, 0, 1, 1])
    draws = resampled_means(np.array([[1.0, 1, 1, 0, 0]]), motion, replicates=4000)[:, 0]
    # Both motions, or one of them twice: 3/5, 1 or 0 in half, a quarter and a quarter.
    values, counts = np.unique(np.round(draws, 9), return_counts=True)
    np.testing.assert_allclose(values, [0.0, 0.6, 1.0])
    np.testing.assert_allclose(counts / 4000, [0.25, 0.5, 0.25], atol=0.03)


# --- what is made of losses ----------------------------------------------------------------------


def losses_of(names=("wear",), **given):
    values = {name: np.array(given[name], dtype=float) for name in Loss}
    count = values["before"].size
    blank = np.full(count, 0.5)
    return HowFar(values, blank, blank, np.arange(count), np.arange(count) % 2, names)


GIVEN = {
    "before": [1.0, 1.0, 1.0, 1.0],
    "after": [0.2, 0.6, 0.2, 0.6],
    "recalibrated": [0.8] * 4,
    "dealt": [1.1] * 4,
    "floor": [0.1] * 4,
}


def test_closure_s_interval_is_over_motions() -> None:
    """A quarter of the resamples of two motions holds either one twice."""
    found = losses_of(**GIVEN)
    closure = found.closure("after")
    assert closure.value == pytest.approx(0.6 / 0.9)
    assert (closure.low, closure.high) == pytest.approx((0.4 / 0.9, 0.8 / 0.9))
    assert found.closure("recalibrated").value == pytest.approx(0.2 / 0.9)
    assert found.closure("dealt").value == pytest.approx(-0.1 / 0.9)
    assert found.gain() == LossInterval(*(pytest.approx(v) for v in (0.6, 0.4, 0.8)))
    assert found.excess("after") == LossInterval(*(pytest.approx(v) for v in (0.3, 0.1, 0.5)))
    assert found.mean("floor").to_json() == {"value": pytest.approx(0.1), "ci95": [0.1, 0.1]}


@pytest.mark.parametrize(
    ("controls", "spared"),
    [
        ({}, 0.2),
        ({"dealt": [0.5] * 4}, 0.5),
        # Controls that make it worse add nothing.
        ({"dealt": [1.2] * 4, "recalibrated": [1.4] * 4}, 0.0),
    ],
)
def test_the_headline_is_closure_minus_the_better_control_s(controls, spared) -> None:
    headline = losses_of(**(GIVEN | controls)).headline()
    assert headline.value == pytest.approx((0.6 - spared) / 0.9)
    assert headline.low == pytest.approx((0.4 - spared) / 0.9)


def test_there_is_no_closure_where_there_is_no_gap() -> None:
    calm = losses_of(**(GIVEN | {"floor": [1.0] * 4}))
    for found in (calm.closure("after"), calm.headline()):
        assert found.to_json() == {"value": None, "ci95": None}
    nothing = losses_of((), **(GIVEN | {n: [np.nan] * 4 for n in ("after", "dealt")}))
    assert nothing.headline().to_json()["value"] is None
    assert nothing.closure("after").to_json()["value"] is None
    assert nothing.excess("before").value == pytest.approx(0.9)


# --- trials simulated again ----------------------------------------------------------------------


class Judged:
    """A linear simulator, a trained posterior, and campaigns planted by another seed."""

    def __init__(self):
        self.rehearsal = linear_rehearsal(400)
        self.posterior = self.rehearsal.posterior("M")
        self.truth = linear(seed=1000)

    def seen(self, *effects, nuisance=3):
        return self.rehearsal.observed(self.truth, effects, tier="M", nuisance=nuisance)

    def judge(self, seen, *names, store=None):
        found = self.rehearsal.infer(seen)
        trials = self.rehearsal.trials
        inferred = Inferred(self.posterior, found.residuals, trials)
        return judge(store or self.rehearsal.cache, seen, trials, inferred, names)


@pytest.fixture(scope="module")
def judged():
    with quick_training():
        yield Judged()


def test_a_gap_free_campaign_loses_the_floor(judged) -> None:
    excess, floor = [], []
    for nuisance in range(1, 21):
        found = judged.judge(judged.seen(nuisance=nuisance))
        assert np.isnan(found.after).all()
        assert np.isfinite(found.before).all()
        excess.append(found.excess("before").value)
        floor.append(found.mean("floor").value)
    assert np.mean(floor) > 0.05
    # Campaigns share the nuisance: the error is that of twenty.
    assert np.mean(excess) == pytest.approx(0, abs=3.5 * np.std(excess) / np.sqrt(20))
    assert np.std(excess) < 0.5 * np.mean(floor)


STRONG = ("wear", (0.12,))


def test_the_true_effect_closes_the_gap_and_its_response_dealt_to_others_does_not(judged) -> None:
    closure, dealt, wrong, scaled = [], [], [], []
    for nuisance in (3, 4, 5):
        seen = judged.seen(STRONG, nuisance=nuisance)
        found = judged.judge(seen, "wear")
        closure.append(found.closure("after").value)
        dealt.append(found.closure("dealt").value)
        scaled.append(found.closure("recalibrated").value)
        assert found.headline().low > 0
        assert found.headline().value <= found.closure("after").value + 1e-12
        wrong.append(judged.judge(seen, "inertia").closure("after").value)
    # Parameters are those of other motions, nuisances fresh, and sizes known to a factor or so.
    assert np.mean(closure) > 0.55
    assert np.mean(dealt) < 0.25
    assert np.mean(scaled) < 0.4
    assert np.mean(wrong) < 0.3


def test_a_group_s_own_trials_have_no_part_in_the_parameters_it_is_judged_with(
    judged, monkeypatch
) -> None:
    calls, requests = [], []
    draw = module._drawn_effects

    def noting(inferred, known, names, rng):
        def drawn(given):
            return draw(inferred._replace(residuals=given), known, names, copy.deepcopy(rng))

        residuals = inferred.residuals
        effects = drawn(residuals)
        blank = np.where(np.tile(known, residuals.size // known.size), residuals, 9.9)
        assert drawn(blank) == effects
        other = np.where(np.tile(known, residuals.size // known.size), -residuals, residuals)
        assert drawn(other) != effects
        calls.append((known, effects))
        return effects

    class Noting(SimulationCache):
        def run(self, wanted, **options):
            requests.extend(wanted)
            return super().run(wanted, **options)

    monkeypatch.setattr(module, "_drawn_effects", noting)
    seen = judged.seen(STRONG)
    with Noting(linear()) as store:
        judged.judge(seen, "wear", store=store)
    kept = judged.rehearsal.trials
    motion = seen.motion[kept]
    assert len(calls) == HELD_OUT.groups
    np.testing.assert_array_equal(np.sum([~known for known, _ in calls], axis=0), 1)
    later = [r for r in requests if r.replicate == HELD_OUT.replicate]
    assert len(later) == simulations(kept.size) == HELD_OUT.members * kept.size
    for known, effects in calls:
        # Complete motions are held out.
        assert not set(motion[known]) & set(motion[~known])
        for trial in kept[~known]:
            own = [r for r in later if r.trial == trial]
            assert [r.effects for r in own] == effects
            draws = [r.nuisance for r in own]
            assert draws == list(range(HELD_OUT.nuisances, HELD_OUT.nuisances + HELD_OUT.members))


def test_a_group_is_rescaled_by_the_others_alone() -> None:
    rng = np.random.default_rng(0)
    group = np.repeat(np.arange(4), 50)
    p = rng.uniform(0.05, 0.95, 200)
    # Odds that are three times as high, and logits that are half as steep.
    from scipy.special import expit, logit

    outcome = (rng.random(200) < expit(np.log(3) + 0.5 * logit(p))).astype(float)
    found = recalibrated(p, outcome, group)
    flipped = np.where(group == 1, 1 - outcome, outcome)
    again = recalibrated(p, flipped, group)
    np.testing.assert_array_equal(again[group == 1], found[group == 1])
    assert np.abs(again - found)[group != 1].mean() > 0.02
    line = np.polyfit(logit(p[group == 2]), logit(found[group == 2]), 1)
    assert line == pytest.approx([0.5, np.log(3)], abs=0.45)
    unknown = np.where(np.arange(200) % 2, outcome, np.nan)
    assert np.isfinite(recalibrated(p, unknown, group)).all()


def test_a_pair_is_simulated_with_both_effects(judged) -> None:
    effects = (("wear", (0.1,)), ("table_gain", (0.1,)))
    seen = judged.seen(*effects[::-1])
    both = judged.judge(seen, "table_gain", "wear")
    one = judged.judge(seen, "wear")
    assert both.names == ("table_gain", "wear")
    assert both.mean("after").value < one.mean("after").value < one.mean("before").value
    assert both.closure("after").value > 0.7


def test_rows_are_those_of_all_trials(judged) -> None:
    seen = judged.seen(STRONG)
    found = judged.judge(seen, "wear")
    kept = judged.rehearsal.trials
    part = replace(
        found,
        losses={name: values[1:] for name, values in found.losses.items()},
        before=found.before[1:], after=found.after[1:], trials=kept[1:], motion=found.motion[1:],
    )  # fmt: skip
    table = rows(part, seen, {int(kept[3]): 0.25})
    assert [row["trial"] for row in table] == [t.trial for t in seen.campaign.trials]
    assert [row["uncertain"] for row in table] == [int(i in kept[1:]) for i in range(len(seen))]
    i = int(kept[5])
    assert table[i]["after"] == found.after[5]
    assert table[i]["loss_before"] == found.losses["before"][5]
    assert table[i]["floor"] == found.losses["floor"][5]
    assert table[i]["overturned"] == seen.overturned[i]
    assert np.isnan(table[int(kept[0])]["before"])
    assert [row["predicted"] for row in table if np.isfinite(row["predicted"])] == [0.25]
    assert table[int(kept[3])]["predicted"] == 0.25


# --- the noise floor -----------------------------------------------------------------------------


class Jittery:
    """Trials 0 to 9 of forty fall if perturbed, 10 to 14 with other placement, all by nuisances."""

    library = PLANAR_LIBRARY
    identity = "jittery"
    variants = ()
    nuisance_names = ("a",)

    def nuisance_draw(self, index):
        return np.array([0.1 * index])

    def run(self, requests):
        down = [
            r.nuisance > 0
            or (r.trial < 10 if r.replicate < 0 else r.replicate > 0 and 10 <= r.trial < 15)
            for r in requests
        ]
        return Responses(np.array(down, dtype=float), np.zeros(len(down)), None)


def standing(**changes):
    campaign = shaken_campaign(10, 4, duration=1.5)
    trials = [replace(t, overturned=False) for t in campaign.trials]
    for i, change in changes.items():
        trials[int(i[1:])] = replace(trials[int(i[1:])], **change(trials))
    return observe_campaign(replace(campaign, trials=tuple(trials)), "B")


def test_the_noise_floor_s_layers_are_kept_apart(monkeypatch) -> None:
    with SimulationCache(Jittery()) as store:
        layers = noise_floor(store, standing(), np.arange(40), np.full(40, 0.5))
        assert store.asked == (1 + 3 * NOISE_FLOOR.replicates) * 40
    assert (layers["numerical"], layers["input"], layers["nuisance"]) == (0.25, 0.125, 1.0)
    assert layers["time_step"] is layers["solver"] is None
    assert layers["trials"] == 40
    assert layers["physical"] is layers["physical_expected"] is None
    # The most uncertain ones first: nearest to one in two.
    odds = np.where(np.arange(40) < 20, 0.5, 0.01)
    fewer = replace(NOISE_FLOOR, most_trials=20)
    monkeypatch.setattr("vsr2.ensemble.noise_floor.NOISE_FLOOR", fewer)
    with SimulationCache(Jittery()) as store:
        few = noise_floor(store, standing(), np.arange(40), odds)
    assert (few["trials"], few["numerical"], few["input"]) == (20, 0.5, 0.25)


def test_repeats_are_expected_to_differ_as_often_as_gap_free_campaigns_say() -> None:
    def again(of):
        return lambda trials: {
            "motion_file": trials[of].motion_file, "motion": trials[of].motion, "overturned": True,
        }  # fmt: skip

    seen = standing(t20=again(2), t30=again(5))
    trials = np.array([i for i in range(40) if i != 5])
    probability = np.where(trials == 2, 0.3, 0.01)
    with SimulationCache(Jittery()) as store:
        layers = noise_floor(store, seen, trials, probability)
    assert (layers["repeats"], layers["physical"]) == (2, 1.0)
    # Of trial 2 one in 0.42, of trial 5, which never lifts off, none.
    assert layers["physical_expected"] == pytest.approx(0.21)


# --- cause by cause ------------------------------------------------------------------------------


def falls_of(losses) -> Waterfall:
    values = np.array(losses)
    trials = values.shape[1]
    zero = np.zeros(trials)
    return Waterfall(("a", "b"), values, values[-1], zero, zero, np.arange(trials))


def test_shares_are_means_over_permutations_and_add_up() -> None:
    # None, a, b, both: b is worth more where a acts already.
    found = falls_of([[1.0, 1.0], [0.6, 0.6], [0.9, 0.9], [0.2, 0.2]])
    assert found.share("a").value == pytest.approx((0.4 + 0.7) / 2)
    assert found.share("b").value == pytest.approx((0.1 + 0.4) / 2)
    assert [one.value for one in found.ends("b")] == pytest.approx([0.1, 0.4])
    assert found.order() == ("a", "b")
    assert found.closure().value == pytest.approx(0.8)
    steps = found.to_json()["steps"]
    assert [step["effects"] for step in steps] == [[], ["a"], ["a", "b"]]
    assert [step["loss"]["value"] for step in steps] == pytest.approx([1.0, 0.6, 0.2])


def test_each_of_two_causes_is_found_on_motions_not_seen(judged, monkeypatch) -> None:
    # A training for each group of motions.
    monkeypatch.setattr(
        "vsr2.diagnosis.how_far.waterfall.motion_groups", lambda motion, outcome: motion % 4
    )
    effects = (("table_gain", (0.1,)), ("wear", (0.12,)))
    seen = judged.seen(*effects)
    rehearsal, found = judged.rehearsal, judged.rehearsal.infer(seen)
    floor = judged.judge(seen).losses[Loss.FLOOR]

    def fall(**changes):
        given = {"seen": seen, **changes}
        return waterfall(
            rehearsal.cache, given["seen"], rehearsal.trials, rehearsal.campaigns,
            FullInference(judged.posterior, found), floor,
        )  # fmt: skip

    falls = fall()
    assert set(falls.order()[:2]) == {"table_gain", "wear"}
    shares = [falls.share(name) for name in falls.names]
    before, after = falls.loss(()), falls.loss(falls.names)
    assert sum(one.value for one in shares) == pytest.approx(before.value - after.value)
    assert min(falls.share(name).low for name in ("table_gain", "wear")) > 0
    assert falls.closure().value > 0.6
    # A motion's own outcomes have no part in its prediction.
    first = seen.motion[rehearsal.trials] == seen.motion[rehearsal.trials][0]
    turned = np.where(seen.motion == seen.motion[rehearsal.trials][0], 1 - seen.overturned,
                      seen.overturned)  # fmt: skip
    one, other = fall(), fall(seen=replace(seen, overturned=turned))
    np.testing.assert_array_equal(other.probability[first], one.probability[first])
    assert (other.probability != one.probability).any()


def test_an_effect_that_no_campaign_had_is_neither_drawn_nor_judged(judged, monkeypatch) -> None:
    """Few campaigns of many effects leave some out; the posterior still gives these a chance."""

    def lacking(posterior):
        known = posterior.parameters
        rows, values = (
            {name: own for name, own in one.items() if name != "wear"}
            for one in (known.rows, known.values)
        )
        return replace(posterior, parameters=replace(known, rows=rows, values=values))

    monkeypatch.setattr(
        "vsr2.diagnosis.how_far.waterfall.train", lambda *a, **k: lacking(train(*a, **k))
    )
    seen, rehearsal = judged.seen(STRONG), judged.rehearsal
    posterior, found = lacking(judged.posterior), rehearsal.infer(seen)
    assert "wear" not in posterior.parameters.known
    leads = posterior.sets.names[int(posterior.sets.marginal(found.probability).argmax())]
    assert leads == "wear", "it is the likeliest, and the first to be judged and drawn"
    falls = waterfall(
        rehearsal.cache, seen, rehearsal.trials, rehearsal.campaigns,
        FullInference(posterior, found), judged.judge(seen).losses[Loss.FLOOR],
    )  # fmt: skip
    assert falls.names
    assert "wear" not in falls.names
    assert np.isfinite(falls.losses).all()


def test_a_share_of_a_gap_that_may_be_nothing_has_no_bounds() -> None:
    rng = np.random.default_rng(3)
    for gap, bounded in ((0.5, True), (0.1, False)):
        resampled = gap + 0.1 * rng.standard_normal(500)
        found = share_of_gap(np.append(0.2, 0.4 * resampled), np.append(gap, resampled))
        assert found.value == pytest.approx(0.2 / gap)
        assert (found.to_json()["ci95"] is not None) == bounded
        if bounded:
            assert (found.low, found.high) == pytest.approx((0.4, 0.4))
        else:
            assert interval(found.to_json()) == f"{found.value:.2f} [no bounds]"
    # The gap's interval lies above zero, and the end of the share's falls on replicates without.
    gaps = np.append(np.full(25, -1e-6), np.linspace(0.2, 0.4, 975))
    edge = share_of_gap(np.append(0.2, np.full(1000, 0.2)), np.append(0.3, gaps))
    assert edge.value == pytest.approx(0.2 / 0.3)
    assert edge.to_json()["ci95"] is None
    nothing = share_of_gap(np.ones(9), np.full(9, -0.1))
    assert nothing.to_json() == {"value": None, "ci95": None}
    assert interval(nothing.to_json()) == "not given"
