"""What may be said, and how: verdict and reasons, limits, estimates, the next measurement."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planted import shaken_campaign
from vsr2.codes import Statement
from vsr2.diagnosis.verdict.compose import _estimate, _samples, shown, unrolled
from vsr2.diagnosis.verdict.limits import (
    LIMITS,
    beyond_tolerance,
    equivalents_of_several,
    excluded_equivalents,
    few_sessions,
    limits_of_names,
    limits_of_the_verdict,
    open_sizes,
    repeats_scatter,
)
from vsr2.diagnosis.verdict.next_measurement import (
    MEASUREMENT,
    Instrument,
    Measurement,
    MeasurementKind,
    Rival,
    measurement_of_several,
    measurement_out_of_library,
    next_measurement,
)
from vsr2.diagnosis.verdict.rules import Verdict, verdict_of
from vsr2.diagnosis.verdict.statements import GapState, LimitCode, ReasonCode, VerdictKind
from vsr2.diagnosis.where.scan import OUTCOME, Location, LocationKind, Third
from vsr2.effects import library as full_library
from vsr2.ensemble.observed.observations import observe_campaign
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.posterior.naming import NamingLimits, candidates, decide
from vsr2.posterior.sets import Sets, declared_alike


def verdict_with(kind, *effects):
    findings = tuple((one,) for one in effects) if kind == "pair" else (effects,)
    return Verdict(VerdictKind(kind), findings, 0.9, GapState.FOUND, ())


def test_a_statement_has_the_values_that_its_code_declares() -> None:
    assert Statement.of(LimitCode.FEW_TRIALS, count=3).to_json() == {
        "code": "few_trials",
        "values": {"count": 3},
    }
    with pytest.raises(TypeError, match="few_trials: has values"):
        Statement.of(LimitCode.FEW_TRIALS, number=3)
    with pytest.raises(TypeError, match="few_trials: count is 'many'"):
        Statement.of(LimitCode.FEW_TRIALS, count="many")


def test_a_pair_names_what_stands_behind_its_members() -> None:
    library = full_library()
    assert list(equivalents_of_several(verdict_with("pair", "catch", "com_offset"), library)) == [
        Statement.of(LimitCode.EQUIVALENT_TO_MEMBER, effect=name, others=others)
        for name, others in (
            ("catch", ("outcome_rule",)),
            ("com_offset", ("base_slope", "registration")),
        )
    ]
    assert not list(equivalents_of_several(verdict_with("pair", "inertia", "time_scale"), library))
    assert not list(equivalents_of_several(verdict_with("effect", "com_offset"), library))


def test_what_lies_beyond_its_tolerance_may_look_like_an_effect() -> None:
    nuisances = ("slenderness", "inertia", "friction")

    def found(kind, *effects):
        statements = list(beyond_tolerance(verdict_with(kind, *effects), nuisances))
        assert {one.code for one in statements} <= {LimitCode.BEYOND_TOLERANCE}
        return [one.values["nuisances"] for one in statements]

    assert found("effect", "edge_rounding") == [("slenderness",)]
    assert found("class", "table_gain", "time_scale") == [("slenderness", "inertia")]
    assert found("effect", "friction") == [("friction",)]
    assert found("effect", "catch") == found("none") == found("unresolved", "slenderness") == []


def test_few_sessions_are_stated() -> None:
    def codes(*sessions, motion=(0, 0, 1, 1, 1, 1)):
        return [one.code for one in few_sessions(np.array(sessions), np.array(motion))]

    assert codes(0, 0, 0, 0) == [LimitCode.ONE_SESSION]
    mixed = (0, 1, 0, 1, 0)
    assert codes(0, 0, 0, 0, motion=mixed) == [LimitCode.INTERLEAVED_IN_ONE_SESSION]
    assert codes(0, 1, 0, 1, 0)[0] is LimitCode.INTERLEAVED_SESSIONS
    few = list(few_sessions(np.array([0, 0, 1, 1, 2, 2]), np.arange(6)))
    assert few == [Statement.of(LimitCode.FEW_SESSIONS, permutations=6, p=1 / 6)]
    eight = (0, 0, 1, 1, 2, 2, 3, 3)
    assert codes(*eight, motion=eight) == []
    motions = (0, 1, 0, 1, 0, 1, 0, 1)
    assert codes(*eight, motion=motions) == [LimitCode.INTERLEAVED_MOTIONS]
    # Each motion once: complete motions are permuted.
    assert codes(*eight, motion=range(8)) == []


def test_what_was_left_out_may_stand_behind_what_is_named() -> None:
    effect = verdict_with("effect", "table_resonance")
    assert list(excluded_equivalents(effect, ("catch", "table_pitch"))) == [
        Statement.of(
            LimitCode.EQUIVALENT_EXCLUDED, effect="table_resonance", others=("table_pitch",)
        )
    ]
    assert not list(excluded_equivalents(effect, ("catch",)))
    assert not list(excluded_equivalents(verdict_with("unknown"), ("table_pitch",)))


def test_repeats_that_scatter_beyond_the_simulations_are_stated() -> None:
    def found(share, expected):
        layers = {"physical": share, "physical_expected": expected, "repeats": 30}
        return list(repeats_scatter(layers))

    # Three standard deviations of 3 expected are 5.2: 8.2 of 30.
    assert found(8 / 30, 0.1) == []
    assert found(0.3, 0.1) == [
        Statement.of(LimitCode.REPEATS_SCATTER, pairs=30, share=0.3, expected=0.1)
    ]
    assert found(3 / 30, 0.0) == [], "as if one were expected where none is"
    assert len(found(5 / 30, 0.0)) == 1
    assert [one.code for one in repeats_scatter({"physical": None})] == [LimitCode.NO_REPEATS]


@pytest.mark.parametrize(
    ("effect", "interval", "code"),
    [
        ("table_gain", (-0.1, 0.1), LimitCode.SIZE_MAY_BE_NULL),
        ("table_gain", (0.1, 0.14), None),
        ("table_gain", (-0.14, -0.1), None),
        ("catch", (6.0, 10.0), None),
        ("catch", (6.0, 24.0), LimitCode.SIZE_AS_WIDE_AS_PRIOR),
    ],
)
def test_a_size_is_open_that_may_be_none_or_any(effect, interval, code) -> None:
    library = full_library()
    (parameter,) = free_parameters(library[effect])
    row = {"name": effect, "parameters": {parameter.name: {"ci95": list(interval)}}}
    found = list(open_sizes(library, verdict_with("effect", effect), [row]))
    assert [one.code for one in found] == ([] if code is None else [code])
    for one in found:
        assert (one.values["low"], one.values["high"]) == interval
        assert (one.values["effect"], one.values["parameter"]) == (effect, parameter.name)
    assert not list(open_sizes(library, verdict_with("effect", "wear"), [row]))


# --- the verdict and its reasons -----------------------------------------------------------------

LIBRARY = {n: full_library()[n] for n in ("com_offset", "base_slope", "wear", "catch", "friction")}
SETS = Sets(tuple(LIBRARY))
ALIKE = declared_alike(LIBRARY)
LEVELS = SimpleNamespace(none_limit=0.3, least_name=0.8, least_together=0.79)
POSTERIOR = SimpleNamespace(sets=SETS, levels=LEVELS, parameters=SimpleNamespace(library=LIBRARY))


def found(*given, outside=0.0, fit=1.0):
    """What is left over is none's."""
    p = np.zeros(len(SETS))
    for *names, value in given:
        p[SETS.index(names)] = value
    p[-1] = outside
    p[0] = 1 - p.sum()
    limits = NamingLimits(LEVELS.none_limit, LEVELS.least_name, LEVELS.least_together)
    said = decide(candidates(p, SETS, ALIKE), limits, ALIKE, fit=fit)
    return SimpleNamespace(probability=p, fit=fit, naming=said)


@pytest.mark.parametrize(
    ("one", "kind", "effects", "codes"),
    [
        (found(("wear", 0.2)), "none", (), ["no_gap"]),
        (found(("wear", 0.6)), "none", (), ["no_gap", "none_less_probable"]),
        (found(outside=0.6), "none", (), ["no_gap", "none_less_probable"]),
        (found(("wear", 0.9)), "effect", ("wear",), ["gap", "name_reached"]),
        (
            found(("wear", 0.9), fit=0.005),
            "effect",
            ("wear",),
            ["gap", "misfit", "name_reached"],
        ),
        (found(("wear", 0.2), fit=0.02), "none", (), ["no_gap"]),
        (found(("wear", 0.6), fit=0.005), "effect", ("wear",), ["misfit", "name_reached"]),
        (found(outside=0.3, fit=0.005), "unknown", (), ["misfit", "outside_outweighs"]),
        (found(("wear", 0.1), outside=0.8), "unknown", (), ["gap", "outside_outweighs"]),
        (
            found(("com_offset", 0.85), ("base_slope", 0.1)),
            "class",
            ("com_offset", "base_slope"),
            ["gap", "name_reached", "equivalent_here"],
        ),
        (
            found(("wear", 0.5), ("catch", 0.4)),
            "class",
            ("wear", "catch"),
            ["gap", "name_reached"],
        ),
        (
            found(("wear", "catch", 0.7), ("wear", "friction", 0.2)),
            "effect",
            ("wear",),
            ["gap", "name_reached", "second_effect_likely"],
        ),
        (found(("wear", "catch", 0.9)), "pair", ("wear", "catch"), ["gap", "together_reached"]),
        (found(("wear", 0.3), outside=0.5), "unknown", (), ["gap", "outside_outweighs"]),
        (
            found(*((n, 0.2) for n in ("base_slope", "wear", "catch", "friction"))),
            "unresolved",
            ("base_slope", "wear", "catch"),
            ["gap", "too_many_needed"],
        ),
    ],
)
def test_a_verdict_says_what_was_decided_and_why(one, kind, effects, codes) -> None:
    verdict = verdict_of(one, POSTERIOR)
    assert verdict.kind == kind
    assert verdict.effects == effects
    assert [str(reason.code) for reason in verdict.reasons] == codes
    assert verdict.gap is (GapState.NOT_FOUND if kind == "none" else GapState.FOUND)
    assert verdict.named == (effects if kind in ("effect", "class", "pair") else ())
    wanted = one.probability[0] if kind == "none" else one.naming.probability
    assert verdict.probability == pytest.approx(wanted)
    assert verdict.reasons[0].values["none"] == pytest.approx(one.probability[0])
    if kind == "unresolved":
        values = verdict.reasons[-1].values
        assert values["classes"] == 3
        assert values["probability"] < values["wanted"] == 0.8


def test_what_is_favoured_beside_no_gap_is_named() -> None:
    def favoured(one):
        return verdict_of(one, POSTERIOR).reasons[1]

    for given, names in (
        (found(("wear", 0.6)), ("wear",)),
        (found(("wear", "catch", 0.6)), ("wear", "catch")),
        (found(outside=0.6), ()),
    ):
        assert favoured(given) == Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured=names)


def test_doubts_about_what_is_named_are_stated() -> None:
    def codes(one, gain, headline):
        how_far = SimpleNamespace(
            names=("wear",),
            gain=lambda: SimpleNamespace(low=gain),
            headline=lambda: SimpleNamespace(low=headline),
        )
        verdict = verdict_of(one, POSTERIOR)
        row = {
            "name": "wear",
            "parameters": {
                p.name: {"ci95": [p.upper / 2, p.upper / 1.5]}
                for p in free_parameters(LIBRARY["wear"])
            },
        }
        found = limits_of_the_verdict(verdict, how_far, one, POSTERIOR, [row], {})
        return [str(limit.code) for limit in found]

    sure, unsure = found(("wear", 0.9)), found(("wear", 0.75), outside=0.18)
    assert codes(sure, 0.1, 0.1) == []
    assert codes(sure, 0.1, -0.1) == ["control_closes_as_much"]
    assert codes(sure, -0.1, -0.1) == ["no_gain"]
    assert codes(unsure, 0.1, 0.1) == ["possibly_out_of_library"]
    assert codes(found(("wear", 0.1)), -0.1, -0.1) == [], "nothing is named"


def test_where_names_are_none_or_often_wrong_it_is_said() -> None:
    def codes(named, wrong, detected):
        levels = SimpleNamespace(named=named, wrong=wrong, detection_rate=detected)
        return [str(limit.code) for limit in limits_of_names(levels)]

    assert codes(0.3, 0.1, 0.6) == []
    assert codes(0.3, 0.1, 0.2) == ["low_detection_rate"]
    assert codes(0.3, 0.1, 0.0) == ["no_detection_rate"]
    assert codes(0.1, 0.15, 0.6) == ["often_wrong"]
    assert codes(0.1, 0.15, 0.0) == ["often_wrong", "no_detection_rate"]
    assert codes(0.0, 0.0, 0.0) == ["no_names"]


# --- estimates -----------------------------------------------------------------------------------


def test_angles_are_averaged_as_directions() -> None:
    np.testing.assert_allclose(
        unrolled(np.array([350.0, 10.0, 10.0, 30.0]), 0.0, 360.0), [-10, 10, 10, 30], atol=1e-9
    )
    # About a mean within the prior: -10, not 350; and 175 beside the ends.
    np.testing.assert_allclose(
        unrolled(np.array([-40.0, -10.0, 20.0]), -180.0, 180.0), [-40, -10, 20], atol=1e-9
    )
    np.testing.assert_allclose(
        unrolled(np.array([160.0, 175.0, -170.0]), -180.0, 180.0), [160, 175, 190], atol=1e-9
    )
    # Beyond half a turn: about a mean of 300 degrees, 60 lies at 420.
    found = unrolled(np.array([*[290.0, 310.0] * 1000, 60.0]), 0.0, 360.0)
    np.testing.assert_allclose(found[[0, 1, -1]], [290, 310, 420], atol=1e-6)


def test_estimates_are_quantiles_of_samples() -> None:
    (gain,) = full_library()["table_gain"].parameters
    samples = np.linspace(-0.05, 0.05, 2001)
    seen = _estimate(gain, samples)
    assert seen["mean"] == pytest.approx(0, abs=1e-12)
    assert seen["ci90"] == pytest.approx([-0.045, 0.045])
    assert seen["ci95"] == pytest.approx([-0.0475, 0.0475])
    assert seen["unit"] == gain.unit
    azimuth = next(p for p in full_library()["com_offset"].parameters if p.name == "azimuth")
    east = _estimate(azimuth, np.array([355.0, 5.0] * 100))
    assert east["mean"] % 360 == pytest.approx(0, abs=1e-6) or east["mean"] == pytest.approx(360)
    assert np.ptp(east["ci95"]) == pytest.approx(10)


def test_what_has_an_infinite_null_is_averaged_as_its_inverse() -> None:
    corner, _ = free_parameters(full_library()["table_bandwidth"])
    found = _estimate(corner, np.array([10.0, 10.0, 20.0, 20.0, np.inf]))
    assert found["mean"] == pytest.approx(1 / (0.3 / 5))
    assert found["median"] == pytest.approx(20.0)
    low, high = found["ci95"]
    assert low == pytest.approx(10.0)
    assert high > 150
    # No corner at all in most of them.
    assert _estimate(corner, np.array([10.0] + [np.inf] * 99))["median"] == np.inf


def test_no_axis_and_no_channel_is_left_out_of_the_locations_shown() -> None:
    table = replace_feature("gain", "table")
    many = [Location(LocationKind.INTENSITY, {}, table, 1.0, 0.01 + i / 1e4) for i in range(40)]
    late = [
        Location(LocationKind.TREND, {}, OUTCOME, 0.5, 0.2),
        Location(LocationKind.STEP, {}, OUTCOME, 0.4, 0.3),
        Location(LocationKind.ALL_TRIALS, {}, OUTCOME, 0.1, 0.9),
    ]
    assert shown(many + late) == [*many[: LIMITS.locations], late[0], late[2]]


def replace_feature(name, channel):
    return OUTCOME._replace(name=name, channel=channel)


def test_estimates_and_samples_are_of_the_diagnosis_own_seed() -> None:
    parameters = SimpleNamespace(sample=lambda name, residuals, rng: rng.random(3))
    evidence = SimpleNamespace(
        posterior=SimpleNamespace(parameters=parameters), found=SimpleNamespace(residuals=None)
    )
    first, again, other = (_samples(evidence, "wear", seed).tolist() for seed in (1, 1, 2))
    assert first == again == generator(1, Stream.PARAMETERS).random(3).tolist()
    assert first != other


# --- what to measure next ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def forty():
    campaign = shaken_campaign(8, 5, duration=1.5)
    trials = tuple(replace(t, overturned=False) for t in campaign.trials)
    return observe_campaign(replace(campaign, trials=trials), "B")


def test_the_trial_to_repeat_is_the_one_that_separates_most(forty) -> None:
    trials = np.arange(5, 40)
    expected = {name: np.zeros((2, 35)) for name in LIBRARY}
    # Outcome and tilt of trial 12 differ by 0.6 and 0.8, of trial 30 one of them by 0.9.
    expected["wear"][:, 7] = 0.6, 0.8
    expected["wear"][0, 25] = 0.9
    expected["catch"][0, 3] = 2.0
    parameters = SimpleNamespace(
        library=LIBRARY, expected=lambda name, residuals: expected[name].ravel()
    )
    posterior, seen = SimpleNamespace(parameters=parameters), SimpleNamespace(residuals=None)

    def measure(*members):
        return next_measurement(members, posterior, seen, forty, trials)

    ids = [trial.trial for trial in forty.campaign.trials]
    two = measure("wear", "friction")
    assert two.kind is MeasurementKind.SPLIT
    assert two.splits == ("wear", "friction")
    assert two.repetition.trial == ids[12]
    # Half the squared distance, in standard deviations.
    assert two.repetition.information_per_repeat == pytest.approx(0.5)
    assert two.repetition.repeats == np.ceil(MEASUREMENT.enough / 0.5)
    three = measure("wear", "friction", "catch")
    assert replace(three, others=()) == two
    assert three.others == (Rival("catch", Instrument.SLACK, measure("wear", "catch").repetition),)
    assert three.others[0].repetition.trial == ids[8]
    # What theory takes for the same stays one class until it is separated five times as well.
    alike = measure("com_offset", "base_slope").repetition
    assert alike.repeats is None, "nothing separates them"
    expected["base_slope"][0, 0] = 1.0
    alike = measure("com_offset", "base_slope").repetition
    assert alike.repeats == np.ceil(MEASUREMENT.alike * MEASUREMENT.enough / 0.5)
    check = measure("catch")
    assert check == Measurement(MeasurementKind.CHECK, ("catch",), (Instrument.SLACK,))


def test_a_pair_needs_both_instruments_and_an_unknown_cause_a_look_at_what_is_left(forty) -> None:
    both = measurement_of_several(("catch", "wear"), LIBRARY)
    assert both.kind is MeasurementKind.BOTH
    assert both.instruments == (Instrument.SLACK, Instrument.REPEAT_FIRST_TRIALS)
    excess = np.zeros(40)
    excess[17] = 1.0
    locations = [
        Location(LocationKind.INTENSITY, {"pga_g": Third.HIGH}, OUTCOME, 1.0, p, 3.0, (2.5, 4.0))
        for p in (0.01, 0.2)
    ]
    name = forty.campaign.trials[17].trial
    for given, location in ((locations, locations[0].to_json()), (locations[1:], None), ([], None)):
        found = measurement_out_of_library(forty, excess, given)
        assert (found.trial, found.tier, found.location) == (name, "B", location)
