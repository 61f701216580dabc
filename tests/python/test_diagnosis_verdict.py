"""What may be said, and how."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from vsr2.diagnosis.how_far.held_out import Interval, Pair
from vsr2.diagnosis.how_far.resimulation import Resimulation
from vsr2.diagnosis.simulated.library import NONE, free_parameters
from vsr2.diagnosis.verdict.limits import (
    beyond_tolerance,
    equivalents_of_a_pair,
    excluded_equivalents,
    few_sessions,
    insensitive,
    open_sizes,
    repeats_scatter,
)
from vsr2.diagnosis.verdict.rules import Findings, Verdict, decide, disagreement, points_outside
from vsr2.diagnosis.verdict.statements import (
    GapState,
    LimitCode,
    ReasonCode,
    Statement,
    VerdictKind,
)
from vsr2.effects import library as full_library


def verdict_of(kind, *effects):
    return Verdict(VerdictKind(kind), effects, 0.9, ())


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
    assert list(equivalents_of_a_pair(verdict_of("pair", "catch", "com_offset"), library)) == [
        Statement.of(LimitCode.EQUIVALENT_TO_MEMBER, effect=name, others=(other,))
        for name, other in (("catch", "outcome_rule"), ("com_offset", "base_slope"))
    ]
    assert not list(equivalents_of_a_pair(verdict_of("pair", "inertia", "time_scale"), library))
    assert not list(equivalents_of_a_pair(verdict_of("effect", "com_offset"), library))


def test_what_lies_beyond_its_tolerance_may_look_like_an_effect() -> None:
    nuisances = ("slenderness", "inertia", "friction")

    def found(kind, *effects):
        statements = list(beyond_tolerance(verdict_of(kind, *effects), nuisances))
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
    assert few == [Statement.of(LimitCode.FEW_SESSIONS, orders=6, p=1 / 6)]
    eight = (0, 0, 1, 1, 2, 2, 3, 3)
    assert codes(*eight, motion=eight) == []
    motions = (0, 1, 0, 1, 0, 1, 0, 1)
    assert codes(*eight, motion=motions) == [LimitCode.INTERLEAVED_MOTIONS]
    # Each motion once: complete motions are permuted.
    assert codes(*eight, motion=range(8)) == []


DISAGREE = Statement.of(ReasonCode.ROUTE_FAVOURS_OTHER, route="classifier", effect="wear")
CLEAR = Findings(
    gap_low=0.02,
    touches_floor=False,
    gap_p=0.005,
    surprise_p=1.0,
    direction_p=0.005,
    none_probability=0.01,
    none_in_set=True,
    leading=("table_gain",),
    alike=("table_gain",),
    alike_probability=0.9,
    offered=20,
    class_probability=0.9,
    agreement=None,
    pair_agreement=None,
    novelty_p=0.5,
    unknown_probability=0.9,
    favoured="table_gain",
    after_low=-0.01,
    floor=0.05,
    left=0.1,
    left_of_all=0.1,
    pair=None,
    halves=(),
)


BOTH = Pair(("table_gain", "wear"), probability=1.0, left=0.4, closed=0.6, beyond=0.4)


SECOND = {"pair": BOTH, "novelty_p": 0.15, "after_low": 0.01, "left": 0.5}


MISFIT = {"novelty_p": 0.01, "after_low": 0.01, "left": 0.5}


FAINT = {"gap_low": -0.01, "direction_p": 0.3, "none_probability": 0.06, "unknown_probability": 0.1}


def second(**changes):
    return {"pair": dataclasses.replace(BOTH, **changes)}


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({}, "effect"),
        ({"leading": ("table_gain", "slenderness")}, "class"),
        ({"gap_low": -0.01, "direction_p": 0.3}, "unresolved"),
        (
            {
                "gap_low": -0.01,
                "direction_p": 0.3,
                "none_probability": 0.03,
                "unknown_probability": 0.1,
            },
            "none",
        ),
        ({"gap_low": -0.01, "direction_p": 0.3, "none_probability": 0.03}, "unresolved"),
        ({"gap_low": -0.01, "direction_p": 0.005}, "effect"),
        ({"novelty_p": 0.01, "after_low": 0.01, "left": 0.5}, "unknown"),
        (
            {"novelty_p": 0.01, "after_low": 0.01, "left": 0.5, "unknown_probability": 0.25},
            "unresolved",
        ),
        ({"novelty_p": 0.09, "after_low": 0.01, "left": 0.3}, "unresolved"),
        ({"novelty_p": 0.11, "after_low": 0.01, "left": 0.3}, "effect"),
        ({"novelty_p": 0.09, "after_low": -0.01, "left": 0.3}, "effect"),
        ({"novelty_p": 0.01, "after_low": 0.01}, "effect"),
        ({"novelty_p": 0.01}, "effect"),
        ({"after_low": 0.01}, "effect"),
        ({"after_low": 0.01, "left": 0.9}, "unresolved"),
        ({"after_low": 0.01, "left_of_all": 0.9}, "unresolved"),
        ({"gap_low": -0.01, "direction_p": 0.3, "surprise_p": 0.004}, "effect"),
        ({"gap_low": -0.01, "direction_p": 0.3, "surprise_p": 0.006}, "unresolved"),
        ({"after_low": -0.01, "left": 0.9}, "effect"),
        ({"agreement": DISAGREE}, "unresolved"),
        ({"halves": (("table_gain",), ("table_gain", "wear"))}, "effect"),
        ({"after_low": 0.16}, "unresolved"),
        ({"after_low": 0.14}, "effect"),
        ({"resimulation": Resimulation(Interval(0.9, 0.8, 1.0), 0.9, short=False)}, "effect"),
        ({"resimulation": Resimulation(Interval(0.3, 0.2, 0.4), 0.9, short=True)}, "unresolved"),
        (
            SECOND | {"resimulation": Resimulation(Interval(0.3, 0.2, 0.4), 0.9, short=True)},
            "unresolved",
        ),
        ({"halves": (("table_gain",), ("wear", "catch"))}, "unresolved"),
        ({"halves": (("wear",), ("table_gain",)), "leading": ("table_gain", "wear")}, "class"),
        (SECOND | {"halves": (("table_gain",), ("wear", "catch"))}, "pair"),
        # A gap whose size is open has no cause that is named, however it was found.
        ({"touches_floor": True}, "unresolved"),
        (SECOND | {"touches_floor": True}, "unresolved"),
        (MISFIT | {"touches_floor": True}, "unresolved"),
        (FAINT | {"touches_floor": True}, "none"),
        (
            {
                "novelty_p": 0.01,
                "after_low": 0.01,
                "left": 0.5,
                "none_probability": 0.5,
                "unknown_probability": 0.32,
            },
            "unresolved",
        ),
        ({"leading": tuple("abcde")}, "class"),
        ({"leading": tuple("abcdef")}, "unresolved"),
        ({"pair": BOTH}, "effect"),
        (SECOND, "pair"),
        (SECOND | {"agreement": DISAGREE}, "pair"),
        (SECOND | {"pair_agreement": DISAGREE}, "unresolved"),
        # A pair that is not named excuses no contradiction.
        (SECOND | second(closed=0.4) | {"agreement": DISAGREE}, "unresolved"),
        (SECOND | {"novelty_p": 0.3}, "effect"),
        (SECOND | {"after_low": -0.01}, "effect"),
        (SECOND | {"left": 0.1}, "effect"),
        (SECOND | second(closed=0.4), "effect"),
        (SECOND | second(left=0.6), "effect"),
        (MISFIT | second(closed=0.4), "pair"),
        (MISFIT | second(closed=0.4, beyond=0.24), "unresolved"),
        (SECOND | second(beyond=-0.1), "pair"),
        # The tests find no gap, and yet none is not among the answers that hold the truth.
        (FAINT, "none"),
        (FAINT | {"none_in_set": False}, "unresolved"),
        (MISFIT | second(left=0.6), "unresolved"),
    ],
)
def test_the_verdict_follows_its_rules(changes, kind) -> None:
    assert decide(dataclasses.replace(CLEAR, **changes)).kind == kind


def test_what_is_less_probable_is_not_called_indistinguishable() -> None:
    two = dataclasses.replace(CLEAR, leading=("table_gain", "wear"), alike_probability=0.7)
    assert decide(two).reasons[-1] == Statement.of(
        ReasonCode.OTHERS_FIT_WORSE, first=("table_gain",), probability=0.7, wanted=0.8
    )
    same = dataclasses.replace(two, alike=two.leading)
    assert decide(same).reasons[-1].code is ReasonCode.EQUIVALENT_HERE
    many = dataclasses.replace(two, leading=tuple("abcdef"), alike=("a", "b"))
    last = decide(many).reasons[-1]
    assert last.code is ReasonCode.TOO_MANY_NEEDED
    assert (last.values["first"], last.values["count"]) == (("a", "b"), 6)
    flat = dataclasses.replace(many, alike=many.leading)
    assert decide(flat).reasons[-1] == Statement.of(
        ReasonCode.TOO_MANY_EQUIVALENT, count=6, offered=20
    )


def test_a_gap_is_stated_by_the_tests_that_found_it() -> None:
    calm = dataclasses.replace(CLEAR, gap_low=-0.01, direction_p=0.3, surprise_p=0.001)
    first = Statement.of(ReasonCode.SURPRISING_OUTCOMES, p=0.001)
    assert decide(calm).reasons == (first,)
    gap = Statement.of(ReasonCode.GAP, p_size=0.005, p_direction=0.005)
    assert decide(dataclasses.replace(CLEAR, surprise_p=0.001)).reasons == (gap, first)


def test_no_gap_with_a_favoured_effect_says_so() -> None:
    faint = dataclasses.replace(CLEAR, gap_low=-0.01, direction_p=0.3, none_probability=0.2)
    for unknown, outside in ((0.1, False), (0.3, True)):
        verdict = decide(dataclasses.replace(faint, unknown_probability=unknown))
        assert verdict.kind is VerdictKind.NONE
        assert verdict.reasons[1] == Statement.of(
            ReasonCode.NONE_LESS_PROBABLE, favoured="table_gain", out_of_library=outside
        )
    calm = dataclasses.replace(
        CLEAR, gap_p=0.4, direction_p=0.3, none_probability=0.9, unknown_probability=0.1
    )
    assert decide(calm).reasons == (
        Statement.of(ReasonCode.NO_GAP, p_size=0.4, p_direction=0.3, size_significant=False),
    )


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, GapState.FOUND),
        ({"touches_floor": True}, GapState.SIZE_OPEN),
        ({"gap_low": -0.01, "direction_p": 0.3}, GapState.NOT_FOUND),
        ({"gap_low": -0.01, "direction_p": 0.3, "touches_floor": True}, GapState.NOT_FOUND),
        ({"gap_low": -0.01, "direction_p": 0.3, "surprise_p": 0.001}, GapState.FOUND),
    ],
)
def test_the_state_of_the_gap_is_data(changes, state) -> None:
    assert dataclasses.replace(CLEAR, **changes).gap_state is state


def test_routes_that_contradict_each_other_are_stated() -> None:
    assert disagreement(("a",), "a", "b", ("a", "b"), ("b", "a")) is None
    assert disagreement(("a",), "a", "b", ("a",), ("b",)) is not None
    assert disagreement(("a",), "a", "b", ("a",), ("b", "a")) is not None


def test_what_was_left_out_may_stand_behind_what_is_named() -> None:
    effect = verdict_of("effect", "table_resonance")
    assert list(excluded_equivalents(effect, ("catch", "table_pitch"))) == [
        Statement.of(
            LimitCode.EQUIVALENT_EXCLUDED, effect="table_resonance", others=("table_pitch",)
        )
    ]
    assert not list(excluded_equivalents(effect, ("catch",)))
    assert not list(excluded_equivalents(verdict_of("unknown"), ("table_pitch",)))


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
    found = list(open_sizes(library, verdict_of("effect", effect), [row]))
    assert [one.code for one in found] == ([] if code is None else [code])
    for one in found:
        assert (one.values["low"], one.values["high"]) == interval
        assert (one.values["effect"], one.values["parameter"]) == (effect, parameter.name)
    assert not list(open_sizes(library, verdict_of("effect", "wear"), [row]))


@pytest.mark.parametrize(
    ("logit", "shift", "unseen"), [(0.2, 0.1, True), (4.0, 0.1, False), (0.2, 1.0, False)]
)
def test_an_effect_is_seen_by_outcomes_or_by_tilts(logit, shift, unseen) -> None:
    """Of ten even odds a logit of 4 moves 4.8; as many tilts by one sigma have a chi2 of 10."""

    def table(logit, shift):
        nodes = np.array([[0.0], [1.0]]) * np.ones(10)
        layout = SimpleNamespace(
            logit=logit * nodes, centre=[shift * nodes], variance=[np.ones((2, 10))]
        )
        return SimpleNamespace(coarse=layout)

    prepared = SimpleNamespace(tables={NONE: table(0.0, 0.0), "wear": table(logit, shift)})
    assert insensitive(prepared, "wear") is unseen


def test_a_cause_outside_the_library_is_pointed_to_where_it_outweighs_all_else() -> None:
    unsure, named = (verdict_of(kind, "catch") for kind in ("unresolved", "effect"))
    likely, unlikely = (dataclasses.replace(CLEAR, unknown_probability=p) for p in (0.51, 0.49))
    assert points_outside(unsure, likely)
    assert not points_outside(unsure, unlikely)
    assert not points_outside(named, likely)
