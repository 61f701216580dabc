"""The diagnosis from end to end on campaigns of planar blocks whose cause is known."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from markupsafe import escape
from threadpoolctl import threadpool_info, threadpool_limits

from planar.library import PLANAR_LIBRARY
from planar.simulator import PlanarSimulator
from planted import Rehearsal, observe, shaken_campaign
from vsr2.campaign import MeasurementNoise, save_campaign, simulate_campaign
from vsr2.cli.main import main
from vsr2.config import study_from_mapping
from vsr2.diagnosis import (
    Budget,
    Execution,
    Hypotheses,
    diagnose,
    diagnose_with,
    schema,
    with_deviations,
)
from vsr2.diagnosis.how_far.held_out import judge
from vsr2.diagnosis.likelihood.emulator import fit_emulator
from vsr2.diagnosis.likelihood.equivalence import (
    CONFOUNDED,
    INSEPARABLE,
    expected_campaign,
    separations,
)
from vsr2.diagnosis.likelihood.evidence import Data, posterior, predict
from vsr2.diagnosis.observed.observations import observe_campaign
from vsr2.diagnosis.pipeline import Stage
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulated.simulator import FINE_SOLVER, HALF_STEP, PERTURBED, Request
from vsr2.diagnosis.verdict.limits import LIMITS
from vsr2.diagnosis.verdict.next_measurement import (
    Instrument,
    Measurement,
    MeasurementKind,
    Rival,
    next_measurement,
)
from vsr2.diagnosis.verdict.rules import points_outside
from vsr2.diagnosis.which.routes import infer, prepare
from vsr2.effects import library as full_library
from vsr2.errors import DiagnosisError
from vsr2.report.diagnosis import (
    diagnosis_page,
    format_diagnosis,
    write_diagnosis_page,
)
from vsr2.report.messages.verdicts import next_measurement as next_sentence
from vsr2.report.messages.verdicts import sentence, verdict_sentence, with_sentences
from vsr2.simulation import run_batch

NAMES = ("table_gain", "slenderness", "restitution", "com_offset", "wear", "catch")
DRAWS = 12


class Bench:
    """One schedule of motions, prepared once for every tier."""

    def __init__(self):
        campaign = shaken_campaign(12, 8, duration=3.0, pga=(0.55, 1.15), session_size=12)
        library = {name: PLANAR_LIBRARY[name] for name in NAMES}
        self.truth = PlanarSimulator(campaign, series=True, seed=99)
        self.rehearsal = Rehearsal(
            PlanarSimulator(campaign, library=library, series=True, seed=1),
            campaign,
            draws=DRAWS,
            series=True,
        )
        self._prepared = {}

    def prepared(self, tier, without=()):
        key = tier, tuple(without)
        if key not in self._prepared:
            self._prepared[key] = self.rehearsal.prepared(tier, without=without)
        return self._prepared[key]

    def judge(self, tier, *effects, nuisance, without=()):
        seen = self.rehearsal.observed(self.truth, effects, nuisance=nuisance)
        return self.rehearsal.judge(self.prepared(tier, without), seen, tier)


@pytest.fixture(scope="module")
def bench():
    return Bench()


PLANTED = {
    "B": [("catch", (0.12,)), ("table_gain", (0.12,)), ("table_gain", (-0.1,))],
    "M": [
        ("catch", (0.12,)),
        ("table_gain", (0.12,)),
        ("wear", (0.14,)),
        ("com_offset", (0.014,)),
        ("restitution", (0.68,)),
    ],
    "T": [
        ("catch", (0.12,)),
        ("wear", (0.14,)),
        ("com_offset", (0.014,)),
        ("restitution", (0.7,)),
    ],
}


@pytest.mark.parametrize("tier", sorted(PLANTED))
def test_planted_effects_are_named(bench, tier) -> None:
    named = inside = wrong = count = 0
    for planted in PLANTED[tier]:
        for nuisance in (1, 2, 3):
            judged = bench.judge(tier, planted, nuisance=nuisance)
            verdict = judged.evidence.verdict
            named += planted[0] in verdict.named
            wrong += bool(verdict.named) and planted[0] not in verdict.named
            inside += planted[0] in judged.inference.conformal["both"]
            count += 1
    # Of 60 such campaigns 50 were named, none wrongly: fewer than half of 9 happen once in 100
    # then, as fewer than two thirds of sets that hold the truth nine times in ten.
    assert named >= 0.5 * count
    assert wrong <= 1
    assert inside >= 2 / 3 * count


@pytest.mark.parametrize(
    ("tier", "effect", "values"),
    [("B", "table_gain", (0.12,)), ("M", "wear", (0.14,)), ("T", "com_offset", (0.014,))],
)
def test_sizes_that_are_left_open_are_stated(bench, tier, effect, values) -> None:
    judged = bench.judge(tier, (effect, values), nuisance=2)
    assert judged.evidence.verdict.probability > 0.8
    # What the sizes and the set leave open is stated, and nothing else is.
    content, open_sizes = judged.diagnosis.content, set()
    for row in content["effects"]:
        entry = bench.rehearsal.library[row["name"]]
        priors = {parameter.name: parameter for parameter in entry.parameters}
        for name, value in row["parameters"].items():
            low, high = value["ci95"]
            assert low <= value["mode"] <= high
            prior = priors[name]
            wide = high - low > LIMITS.all_of_prior * (prior.upper - prior.lower)
            if row["name"] in content["verdict"]["effects"] and (wide or low <= prior.null <= high):
                open_sizes.add(row["name"])
    codes = {}
    for limit in content["limits"]:
        codes.setdefault(limit["code"], []).append(limit["values"])
    sizes = codes.get("size_may_be_null", []) + codes.get("size_as_wide_as_prior", [])
    assert {values["effect"] for values in sizes} == open_sizes
    outside = set(content["verdict"]["effects"]) - set(content["conformal_set_90"])
    assert ("not_in_set" in codes) == bool(outside and content["verdict"]["kind"] == "class")


def test_campaigns_without_gap_are_left_alone(bench) -> None:
    alarms, excess = 0, []
    for tier in "BMT":
        for nuisance in range(11, 21):
            judged = bench.judge(tier, nuisance=nuisance)
            alarms += judged.evidence.verdict.kind != "none"
            excess.append(judged.diagnosis.content["gap"]["excess"]["value"])
    # 5 % of 30 is 1.5; more than four happen once in 60.
    assert alarms <= 4
    # The loss is the floor's on average, trials screened_out as certain included: the mean of ten
    # campaigns has a standard error of 0.005.
    assert abs(np.mean(excess)) < 0.015


@pytest.mark.parametrize(
    ("tier", "effect", "nuisance", "kind"),
    [
        ("B", ("table_gain", (-0.1,)), 0, "class"),
        ("B", ("table_gain", (0.08,)), 2, "class"),
        # Too weak for the interval of its gap to lie above zero, but they lead together.
        ("M", ("slenderness", (-0.06,)), 3, "unresolved"),
    ],
)
def test_gain_and_slenderness_come_out_as_one_class(bench, tier, effect, nuisance, kind) -> None:
    # The planar equation holds the motion only through a / (g alpha).
    judged = bench.judge(tier, effect, nuisance=nuisance)
    evidence, same = judged.evidence, {"table_gain", "slenderness"}
    assert evidence.verdict.kind == kind, evidence.verdict
    assert set(evidence.verdict.effects) == same
    measure = evidence.next_measurement
    assert Instrument.SCAN_AND_TILT in measure.instruments
    outside = points_outside(evidence.verdict, evidence.findings)
    assert (measure.out_of_library is not None) == outside
    assert next_sentence(measure.to_json()).startswith("if the cause lies outside") == outside
    assert set(measure.splits) == same
    assert set(judged.inference.classes[0]) >= same
    assert set(judged.diagnosis.content["conformal_set_90"]) >= same, "none wins alone"


def test_the_trial_to_repeat_is_the_one_that_separates_most(bench, monkeypatch) -> None:
    planted = ("table_gain", (0.12,))
    seen = bench.rehearsal.observed(bench.truth, (planted,), nuisance=2)
    judged, prepared = bench.judge("M", planted, nuisance=2), bench.prepared("M")
    found, kept = judged.inference, bench.rehearsal.screening.kept
    members = ["table_gain", "wear"]
    measure = next_measurement(members, prepared, found, seen, kept)
    stated = measure.repetition
    # All trials together separate them by so much: the best one by more than the average.
    observed = Data(seen.overturned[None, kept], seen.features[None, kept, :1])
    apart = separations(members[0], prepared.tables, found.posteriors, observed)[members[1]]
    assert stated.information_per_repeat > found.exponent * apart / kept.size > 0
    # There the two foretell another tilt, or another outcome, than in most trials.
    ahead, _ = expected_campaign(prepared.tables[members[0]], found.posteriors[members[0]])
    table = prepared.tables[members[1]]
    behind = posterior(table, ahead)
    rival, deviation = expected_campaign(table, behind)[0], predict(table, behind).deviation
    tilts = ((ahead.features - rival.features) / deviation)[0, :, 0] ** 2
    unlike = 4 * (ahead.overturned - rival.overturned)[0] ** 2 + tilts
    location = [seen.campaign.trials[int(i)].trial for i in kept].index(stated.trial)
    assert unlike[location] > np.quantile(unlike, 0.8)
    assert stated.repeats == np.ceil(INSEPARABLE / stated.information_per_repeat)
    less = replace(found, exponent=0.5 * found.exponent)
    half = next_measurement(members, prepared, less, seen, kept).repetition
    assert half.trial == stated.trial
    assert half.information_per_repeat == pytest.approx(0.5 * stated.information_per_repeat)
    assert half.repeats in (2 * stated.repeats - 1, 2 * stated.repeats)
    # Of three the leader is separated from each as it is from that one alone.
    three = next_measurement([*members, "catch"], prepared, found, seen, kept)
    assert replace(three, others=()) == measure
    alone = next_measurement(["table_gain", "catch"], prepared, found, seen, kept)
    check = next_measurement(["catch"], prepared, found, seen, kept)
    assert check == Measurement(MeasurementKind.CHECK, ("catch",), (Instrument.SLACK,))
    assert three.others == (Rival("catch", Instrument.SLACK, alone.repetition),)
    # What theory takes for the same stays one class until it is separated five times as well.
    location = "vsr2.diagnosis.verdict.next_measurement.takes_for_alike"
    monkeypatch.setattr(location, lambda: lambda one, other: True)
    often = next_measurement(members, prepared, found, seen, kept).repetition.repeats
    assert often == np.ceil(CONFOUNDED * INSEPARABLE / stated.information_per_repeat)


def test_halves_of_the_draws_are_fitted_alone(bench) -> None:
    prepared = bench.prepared("B")
    design = bench.rehearsal.design("B")
    for half, parity in zip(prepared.halves, (1, 0), strict=True):
        own = fit_emulator(
            prepared.library, design.take(np.flatnonzero(bench.rehearsal.draws % 2 == parity))
        )
        np.testing.assert_array_equal(half.emulator.outcome.mean, own.outcome.mean)
        assert half.emulator.wrong == prepared.emulator.wrong
        assert half.calibration is prepared.calibration
        assert not half.halves
    # One campaign of an effect less, and its half is too small to tell anything.
    draws = bench.rehearsal.draws
    rows = np.flatnonzero((design.effect != "catch") | (draws > 1))
    parts = prepared.library, design.take(rows), draws[rows], prepared.conditions, prepared.motion
    assert prepare(*parts).halves == ()


def test_tilts_may_differ_as_those_of_another_simulator(bench, monkeypatch) -> None:
    own = bench.prepared("M")
    design = bench.rehearsal.design("M")
    parts = own.library, design, bench.rehearsal.draws, own.conditions, own.motion
    monkeypatch.setattr("vsr2.diagnosis.which.routes.disturbed", lambda features, *_: features)
    alike = prepare(*parts)
    # Residuals of largest tilts, over a scatter that is part of their deviation.
    for wide, narrow in (
        (own.drawn[0], alike.drawn[0]),
        (own.calibration.null[0], alike.calibration.null[0]),
    ):
        assert wide[:, 1].std() > 1.1 * narrow[:, 1].std()


def test_what_is_written_is_what_was_concluded(bench, monkeypatch) -> None:
    judged = bench.judge("B", ("table_gain", (-0.1,)), nuisance=0)
    content, verdict = judged.diagnosis.content, judged.evidence.verdict
    assert verdict.kind in ("effect", "class")
    known = 1 - content["unknown"]["probability"]
    assert known < 1
    assert content["verdict"]["probability"] == pytest.approx(verdict.probability * known)
    classes = {row["name"]: row["class"] for row in content["effects"]}
    for group in judged.inference.classes:
        assert {classes[name] for name in group} == {group[0]}
    # Of halves each is judged by its own fit.
    seen = bench.rehearsal.observed(bench.truth, (("table_gain", (-0.1,)),), nuisance=0)
    kept, prepared = bench.rehearsal.screening.kept, bench.prepared("B")
    observed = Data(seen.overturned[None, kept], np.zeros((1, kept.size, 0)))
    stated = [infer(half, observed).classes[0] for half in prepared.halves]
    assert judged.evidence.findings.halves == tuple(tuple(group) for group in stated)
    # What theory takes for the same has the odds that a class allows.
    monkeypatch.setattr("vsr2.diagnosis.likelihood.equivalence.MOST_ODDS", 1.0)
    even = infer(prepared, observed)
    stated = dict(zip(even.labels, even.probability, strict=True))
    assert stated["table_gain"] == pytest.approx(stated["slenderness"])
    monkeypatch.undo()
    # Two tests of misfit: the smaller of one and twice the other.
    assert judged.evidence.findings.novelty_p == judged.inference.novelty_p > 0.07
    monkeypatch.setattr(sys.modules["vsr2.diagnosis.conclusion"], "surprise_p", lambda *_: 0.03)
    again = bench.judge("B", ("table_gain", (-0.1,)), nuisance=0)
    assert again.evidence.findings.novelty_p == 0.06


def test_no_more_draws_calibrate_than_are_needed(bench, monkeypatch) -> None:
    reference = bench.prepared("B")
    monkeypatch.setattr("vsr2.diagnosis.which.routes.CALIBRATED", (8, 20))
    prepared = bench.rehearsal.prepared("B")
    counts = np.bincount(prepared.calibration.truth)
    assert counts.tolist() == [20, *[8] * len(NAMES)]
    # The models themselves know all draws.
    np.testing.assert_array_equal(prepared.emulator.outcome.mean, reference.emulator.outcome.mean)
    assert np.bincount(reference.calibration.truth).tolist() == [48, *[DRAWS] * len(NAMES)]
    assert len(prepared.calibration.gap) == 20 + 8 * len(NAMES)
    assert len(prepared.drawn[0]) >= 999


@pytest.mark.parametrize(
    ("first", "second"),
    [(("wear", (0.14,)), ("catch", (0.12,))), (("com_offset", (0.014,)), ("catch", (0.1,)))],
)
def test_a_planted_pair_is_named(bench, first, second) -> None:
    evidence = bench.judge("T", first, second, nuisance=3).evidence
    assert evidence.verdict.kind == "pair", evidence.verdict
    assert set(evidence.verdict.effects) == {first[0], second[0]}
    held_out = evidence.held_out
    assert held_out.pair is not None
    assert held_out.pair.mean() < held_out.after.mean()


def test_a_pair_that_leaves_most_of_the_gap_is_not_named(bench) -> None:
    effects = (("restitution", (0.7,)), ("com_offset", (0.014,)))
    evidence = bench.judge("M", *effects, nuisance=3).evidence
    held_out = evidence.held_out
    # A second effect helps, on motions that its choice did not see, but explains little.
    assert held_out.pair is not None
    assert held_out.pair.mean() < held_out.after.mean()
    assert evidence.verdict.kind == "unknown"


def test_an_effect_that_the_library_lacks_is_not_given_a_wrong_name(bench) -> None:
    judged = bench.judge("M", ("catch", (0.1,)), nuisance=5, without=("catch",))
    assert judged.evidence.verdict.kind in ("unknown", "unresolved"), judged.evidence.verdict
    assert judged.evidence.findings.novelty_p <= 0.05


@pytest.mark.parametrize("tier", ["B", "M"])
def test_permuted_labels_are_at_chance(bench, tier) -> None:
    design = bench.rehearsal.design(tier)
    order = np.random.default_rng(0).permutation(len(design.effect))
    shuffled = replace(design, overturned=design.overturned[order], features=design.features[order])
    fitted = bench.rehearsal.prepared(tier, design=shuffled).calibration

    def hits(calibration):
        effect = calibration.truth > 0
        best = 1 + calibration.probability[:, 1:].argmax(axis=1)
        return (best == calibration.truth)[effect].mean()

    chance = 1 / len(NAMES)
    # Three binomial standard errors around chance.
    assert abs(hits(fitted) - chance) < 3 * np.sqrt(chance * (1 - chance) / (DRAWS * len(NAMES)))
    assert hits(bench.prepared(tier).calibration) > 2 * chance


def test_stated_probabilities_are_those_at_which_labels_are_right(bench) -> None:
    calibration = bench.prepared("B").calibration
    best = calibration.probability.argmax(axis=1)
    weight = calibration.weight / calibration.weight.sum()
    stated = (weight * calibration.probability.max(axis=1)).sum()
    assert stated == pytest.approx((weight * (best == calibration.truth)).sum(), abs=0.12)


def test_an_order_effect_is_distinguished_from_its_absence_under_one_schedule(bench) -> None:
    worn = bench.judge("M", ("wear", (0.14,)), nuisance=2).evidence
    assert "wear" in worn.verdict.effects
    fired = named = 0
    for nuisance in range(21, 29):
        plain = bench.judge("M", nuisance=nuisance).evidence
        fired += any(p.p_familywise <= 0.05 for p in plain.where if "order" in p.axis)
        named += "wear" in plain.verdict.effects
    # 5 % of 8 is 0.4; more than two happen once in 170.
    assert fired <= 2
    assert named <= 2


def test_how_far_is_judged_on_motions_that_were_not_seen(bench) -> None:
    held_out = bench.judge("B", ("catch", (0.12,)), nuisance=7).evidence.held_out
    assert set(held_out.chosen["after"]) == {"catch"}
    assert "catch" not in held_out.chosen["negative_control"]
    assert held_out.after.mean() < held_out.negative_control.mean() < held_out.before.mean() + 0.05
    # A tether that holds most of what should overturn: a shift of the logits alone helps a lot.
    assert held_out.after.mean() < held_out.recalibrated.mean() < 0.7 * held_out.before.mean()


def test_no_group_s_outcomes_reach_the_models_that_judge_it(bench) -> None:
    prepared = bench.prepared("M")
    seen = bench.rehearsal.observed(bench.truth, (("catch", (0.12,)),), nuisance=7)
    kept = bench.rehearsal.screening.kept
    data = Data(seen.overturned[None, kept], seen.features[None, kept, :1])
    group = prepared.motion % 4

    def judged(observed, *alike):
        return judge(
            prepared.library,
            prepared.emulator,
            prepared.tables,
            observed,
            group,
            ("catch", *alike),
            np.eye(prepared.emulator.nuisances),
            pairs=True,
        )

    plain = judged(data)
    flipped = np.where(group == 1, 1 - data.overturned, data.overturned)
    changed = judged(Data(flipped, np.where(group[:, None] == 1, np.nan, data.features)))
    mine = group == 1
    for name in ("predicted_before", "predicted_after", "predicted_pair"):
        there, here = getattr(plain, name), getattr(changed, name)
        np.testing.assert_array_equal(there[mine], here[mine])
        assert (there[~mine] != here[~mine]).any()
    for name in ("after", "negative_control", "pair"):
        assert plain.chosen[name][1] == changed.chosen[name][1]
    # Fitted to the others, by predictions that know of the group's outcomes through nuisances.
    np.testing.assert_allclose(plain.scaling[1], changed.scaling[1], atol=0.1)
    assert (np.abs(plain.scaling - changed.scaling).max(axis=1) > 1.0).sum() == 3
    for found in (plain, changed):
        first = [next(n for n in names if n != "catch") for names in found.ranked]
        assert found.chosen["negative_control"] == first, "the best of the others"
    assert (plain.before[mine] != changed.before[mine]).all()
    second = plain.ranked[0][1]
    assert plain.chosen["negative_control"][0] == second
    wider = judged(data, second)
    assert wider.chosen["after"] == plain.chosen["after"]
    assert wider.chosen["negative_control"][0] == plain.ranked[0][2], "none of the verdict's class"


def test_a_pair_is_stated_by_its_own_model_throughout(bench) -> None:
    judged = bench.judge("T", ("wear", (0.14,)), ("catch", (0.12,)), nuisance=3)
    content, held_out = judged.diagnosis.content, judged.evidence.held_out
    assert content["verdict"]["kind"] == "pair"
    assert content["negative_control"]["effect"] not in ("wear", "catch")
    assert content["next_measurement"]["kind"] == "both"
    kept = [row for row in judged.diagnosis.trials if row["uncertain"]]
    after = np.array([row["after"] for row in kept])
    np.testing.assert_array_equal(after, held_out.predicted_pair)
    assert (after != held_out.predicted_after).any()
    assert content["gap"]["closure"]["value"] > 0.5


# --- end to end ----------------------------------------------------------------------------------


def small(simulations=2500, seed=0, cache=None, report=None):
    campaign = shaken_campaign(8, 6, duration=2.5, pga=(0.55, 1.15), session_size=12)
    observed = observe(
        campaign, PlanarSimulator(campaign, seed=99), (("catch", (0.12,)),), nuisance=2
    )
    library = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "catch", "wear")}
    simulator = PlanarSimulator(observed, library=library, seed=1)
    return diagnose_with(
        simulator,
        observed,
        budget=Budget(simulations=simulations),
        seed=seed,
        cache=cache,
        report=report,
    )


@pytest.fixture(scope="module")
def found():
    return small()


def without_times(diagnosis):
    content = json.loads(diagnosis.to_json())
    content["provenance"].pop("wall_time_s")
    for key in ("simulated", "reused", "cost_s"):
        content["provenance"]["budget"].pop(key)
    return content


def test_the_result_follows_its_schema(found, tmp_path) -> None:
    path = found.save(tmp_path)
    content = json.loads(path.read_text())
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.validate(content, schema())
    assert set(content) == set(schema()["properties"])
    for part, change in (
        ("verdict", {"kind": "guess"}),
        ("verdict", {"kind": "class", "effects": ["catch"]}),
        ("verdict", {"probability": 1.2}),
        ("verdict", {"probabilty": 0.9}),
        ("gap", {"closure": {"value": 0.5}}),
        ("campaign", {"tier": "X"}),
        ("negative_control", {"effect": 3}),
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(content | {part: content[part] | change}, schema())
    beside = content["none_probability"] + content["unknown"]["probability"]
    assert sum(e["probability"] for e in content["effects"]) + beside == pytest.approx(1)
    assert {p.name for p in tmp_path.iterdir()} >= {"effects.csv", "where.csv", "trials.csv"}
    assert len((tmp_path / "trials.csv").read_text().splitlines()) == 49


def test_a_page_of_an_earlier_diagnosis_does_not_stay(found, tmp_path) -> None:
    page = write_diagnosis_page(found, tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    jsonschema.validate(written, schema())
    assert all(one["text"] for one in (*written["verdict"]["reasons"], *written["limits"]))
    assert written == json.loads(replace(found, content=with_sentences(found.content)).to_json())
    found.save(tmp_path)
    assert not page.exists()
    page.write_text("<title>My own</title>")
    found.save(tmp_path)
    assert page.read_text() == "<title>My own</title>", "a page of somebody else's"


def test_linear_algebra_has_the_same_bits_on_any_machine() -> None:
    """Over threads BLAS sums in another order: one thread, whatever it had before."""

    def threads():
        return {b["num_threads"] for b in threadpool_info() if b["user_api"] == "blas"}

    seen = []

    def stop(progress):
        seen.append(threads())
        raise KeyboardInterrupt

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(KeyboardInterrupt):
            small(report=stop)
        assert threads() == before == {2}
    assert seen == [{1}]


def test_an_interruption_loses_nothing_and_changes_nothing(found, tmp_path) -> None:
    seen = []

    def stop(progress):
        seen.append(progress.stage)
        if progress.stage is Stage.SIMULATION and progress.share > 0.4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        small(cache=tmp_path / "simulations.jsonl", report=stop)
    assert Stage.SCREENING in seen
    again = small(cache=tmp_path / "simulations.jsonl")
    assert again.content["provenance"]["budget"]["reused"] > 400
    assert without_times(again) == without_times(found)


def test_the_page_says_it_all_and_needs_nothing_else(found) -> None:
    page = diagnosis_page(found)
    assert escape(verdict_sentence(found.content)) in page
    open_gap = {"kind": "unresolved", "effects": ["catch"], "probability": 0.9}
    starts = {
        "not_found": "Whether",
        "size_open": "There are signs of a",
        "found": "There is a gap",
    }
    for state, start in starts.items():
        gap = found.content["gap"] | {"state": state}
        content = {**found.content, "verdict": open_gap, "gap": gap}
        assert verdict_sentence(content).startswith(start)
    assert page.count("<svg") == page.count("</svg>") == 6
    # Names of the drawings' format are no addresses that a browser asks for.
    assert not re.search(r"src=|href=\"[^#]|@import|url\([^#]", page)
    assert set(re.findall(r"https?://[^\"]*", page)) == {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    for limit in found.content["limits"]:
        assert escape(sentence(limit)) in page
    assert "catch" in format_diagnosis(found)


@pytest.mark.parametrize("trials", [30, 39])
def test_too_small_a_campaign_is_refused(trials: int) -> None:
    campaign = shaken_campaign(8, 6, duration=3.0)
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1)
    part = observed.select([i < trials for i in range(len(observed))])
    with pytest.raises(DiagnosisError, match="needs 40 of 4 motions"):
        observe_campaign(part)


def test_a_few_missing_tilts_cost_no_tier() -> None:
    campaign = shaken_campaign(8, 6, duration=3.0, pga=(0.55, 1.15))
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1, tier="M")
    standing = [i for i, trial in enumerate(observed.trials) if not trial.overturned]

    def without(indices):
        trials = [
            replace(trial, peak_tilt=None) if i in indices else trial
            for i, trial in enumerate(observed.trials)
        ]
        return replace(observed, trials=tuple(trials))

    overturned = set(range(len(observed))) - set(standing)
    seen = observe_campaign(without({*overturned, standing[3]}))
    assert seen.tier == "M"
    assert np.isnan(seen.features[:, 0]).sum() == len(overturned) + 1
    many = without(set(standing[: len(standing) // 5 + 1]))
    assert observe_campaign(many).tier == "B"
    first = observed.trials[standing[0]].trial
    with pytest.raises(DiagnosisError, match=rf"not M: \d+ trials have no largest tilt .*{first}"):
        observe_campaign(many, "M")


def test_a_tier_that_was_not_measured_is_refused() -> None:
    campaign = shaken_campaign(8, 6, duration=3.0)
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1)
    with pytest.raises(DiagnosisError, match="reaches tier B"):
        observe_campaign(observed, "T")


# --- real scenes --------------------------------------------------------------------------------

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 3.0},
}
STILL = with_deviations({"yaw": 0.0, "offset": 0.0})


@pytest.fixture(scope="module")
def shaken():
    return shaken_campaign(5, 8, duration=2.0, pga=(0.6, 1.3), session_size=10)


@pytest.mark.parametrize("noise", [None, 1e-5])
def test_a_scene_that_says_nothing_of_recordings_is_driven_as_recorded(tmp_path, noise) -> None:
    """Where the campaign states noise, without it; so a simulated campaign comes out again."""
    cosines = {
        "mode": "grid_cosine",
        "pga": {"min": 0.5, "max": 0.6, "step": 0.1},
        "pgv_pga": {"min": 0.08, "max": 0.14, "step": 0.02},
    }
    study = study_from_mapping(BOX | {"motion": cosines}, base=tmp_path)
    simulated = simulate_campaign(study)
    campaign = replace(simulated, noise=MeasurementNoise(displacement=noise))
    simulator = SceneSimulator(
        campaign, study, hypotheses=Hypotheses({"wear": full_library()["wear"]})
    )
    found = simulator.run([Request(i, (), 0, 0) for i in range(len(campaign))])
    apart = np.abs(found.peak_tilt - [trial.peak_tilt for trial in campaign.trials])
    if noise is None:
        # The record comes at the simulation's own step: the motion is the same, to rounding.
        assert apart.max() < 1e-9
    else:
        # The band-pass rounds the steps at the cosines' ends.
        assert apart.max() > 0.01


def test_real_trials_answer_alike_alone_and_together(shaken, tmp_path) -> None:
    study = study_from_mapping(BOX, base=tmp_path)
    simulator = SceneSimulator(
        shaken, study, hypotheses=Hypotheses({"wear": full_library()["wear"]})
    )
    requests = [Request(i, (("wear", (0.1,)),), 2, 1) for i in (0, 20, 39)]
    together = simulator.run([*requests, Request(20, (), 2, 1), Request(20, (), 0, -1)])
    alone = simulator.run([requests[1]])
    assert alone.peak_tilt[0] == together.peak_tilt[1]
    # Wear has not begun at the first trial.
    first = simulator.run([Request(0, (), 2, 1)])
    assert first.peak_tilt[0] == together.peak_tilt[0]
    assert together.peak_tilt[3] != together.peak_tilt[1]


def test_rest_features_are_those_of_the_batch(shaken, tmp_path) -> None:
    library = {"off_axis_motion": full_library()["off_axis_motion"]}
    study = study_from_mapping(BOX, base=tmp_path)
    simulator = SceneSimulator(shaken, study, hypotheses=Hypotheses(library), series=True)
    some = [14, 22, 37]
    given = [Request(i, (), 0, 0) for i in some]
    found = simulator.run(given)
    built = simulator._built((), 0, 0, set(some))
    batch = run_batch([built[i] for i in some])
    assert found.features is not None
    np.testing.assert_allclose(found.features[:, -1], batch["final_slip"], atol=1e-8)
    np.testing.assert_allclose(found.features[:, -2], np.abs(batch["final_yaw"]), atol=1e-6)
    assert (found.features[:, -1] > 0.01).all()
    # Numerical variants: near the plain ones, but not the same.
    for variant in (HALF_STEP, FINE_SOLVER, PERTURBED):
        other = simulator.run([Request(i, (), 0, variant) for i in some])
        assert (other.peak_tilt != found.peak_tilt).all()
        np.testing.assert_allclose(other.peak_tilt, found.peak_tilt, rtol=0.05)


def test_a_real_campaign_is_diagnosed_from_the_command_line(shaken, tmp_path, capsys) -> None:
    study = study_from_mapping(BOX, base=tmp_path)
    library = {name: full_library()[name] for name in ("table_gain", "catch")}
    still = Hypotheses(library, nuisances=STILL)
    simulator = SceneSimulator(shaken, study, hypotheses=still, seed=5)
    truth = simulator.run([Request(i, (), 3, 1) for i in range(len(shaken))])
    observed = replace(
        shaken,
        trials=tuple(
            replace(trial, overturned=bool(truth.overturned[i]))
            for i, trial in enumerate(shaken.trials)
        ),
    )
    result = diagnose(
        observed,
        study,
        out=tmp_path / "out",
        budget=Budget(simulations=500),
        hypotheses=still,
        execution=Execution(threads=2),
    )
    assert result.content["campaign"]["tier"] == "B"
    assert result.kind in ("none", "unresolved")
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    jsonschema.validate(content, schema())
    layers = content["gap"]["layers"]
    assert all(0 <= layers[name] <= 1 for name in ("numerical", "time_step", "solver", "input"))
    save_campaign(observed, tmp_path / "campaign")
    scene = tmp_path / "scene.yaml"
    scene.write_text("rock: {shape: box, size: [1, 1, 1]}\n")
    out = str(tmp_path / "x")
    code = main(["diagnose", str(tmp_path / "campaign"), "--scene", str(scene), "--out", out])
    assert code == 2
    assert "scene.yaml" in capsys.readouterr().err
