"""What may be said, and how."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from vsr2.diagnosis.how_far.anew import Anew
from vsr2.diagnosis.how_far.shrinkage import Interval, Pair
from vsr2.diagnosis.simulated.library import NONE, free_parameters
from vsr2.diagnosis.verdict.rules import Findings, Verdict, decide, disagreement, points_outside
from vsr2.diagnosis.verdict.summary import (
    _few_sessions,
    _repeated,
    _sizes,
    _unseen,
    beyond_tolerance,
    mates,
    withheld_mates,
)
from vsr2.effects import library as full_library


def test_a_pair_names_what_stands_behind_its_members() -> None:
    pair = Verdict("pair", ("catch", "com_offset"), 0.9, ())
    assert [told.split(",")[0] for told in mates(pair, full_library())] == [
        "in place of catch it may be outcome_rule",
        "in place of com_offset it may be base_slope",
    ]
    assert mates(Verdict("pair", ("inertia", "time_scale"), 0.9, ()), full_library()) == []
    assert mates(Verdict("effect", ("com_offset",), 0.9, ()), full_library()) == []


def test_what_lies_beyond_its_tolerance_may_look_like_an_effect() -> None:
    nuisances = ("slenderness", "inertia", "friction")

    def told(kind, *effects):
        return beyond_tolerance(Verdict(kind, effects, 0.9, ()), nuisances)

    assert "whose slenderness lies further off" in told("effect", "edge_rounding")[0]
    assert "whose slenderness or inertia lies" in told("class", "table_gain", "time_scale")[0]
    assert "whose friction lies" in told("effect", "friction")[0]
    assert told("effect", "catch") == told("none") == told("unresolved", "slenderness") == []


def test_few_sessions_are_told() -> None:
    def told(*sessions, motion=(0, 0, 1, 1, 1, 1)):
        return _few_sessions(np.array(sessions), np.array(motion))

    assert "one session: a change" in told(0, 0, 0, 0)[0]
    assert "motions of one session are" in told(0, 0, 0, 0, motion=(0, 1, 0, 1, 0))[0]
    assert "sessions are interleaved" in told(0, 1, 0, 1, 0)[0]
    assert "few sessions: their order can be changed in 2 ways" in told(0, 0, 1, 1)[0]
    assert "(p of 0.17 at least)" in told(0, 0, 1, 1, 2, 2)[0]
    eight = (0, 0, 1, 1, 2, 2, 3, 3)
    assert told(*eight, motion=eight) == []
    (mixed,) = told(*eight, motion=(0, 1, 0, 1, 0, 1, 0, 1))
    assert "whether one session stands out cannot be told" in mixed
    # Each motion once: whole motions are permuted.
    assert told(*eight, motion=range(8)) == []


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
        ({"agreement": "the routes disagree"}, "unresolved"),
        ({"halves": (("table_gain",), ("table_gain", "wear"))}, "effect"),
        ({"after_low": 0.16}, "unresolved"),
        ({"after_low": 0.14}, "effect"),
        ({"anew": Anew(Interval(0.9, 0.8, 1.0), 0.9, short=False)}, "effect"),
        ({"anew": Anew(Interval(0.3, 0.2, 0.4), 0.9, short=True)}, "unresolved"),
        (SECOND | {"anew": Anew(Interval(0.3, 0.2, 0.4), 0.9, short=True)}, "unresolved"),
        ({"halves": (("table_gain",), ("wear", "catch"))}, "unresolved"),
        ({"halves": (("wear",), ("table_gain",)), "leading": ("table_gain", "wear")}, "class"),
        (SECOND | {"halves": (("table_gain",), ("wear", "catch"))}, "pair"),
        # A gap whose size is not told from zero has no cause that is named, however it is told.
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
        (SECOND | {"agreement": "the routes disagree"}, "pair"),
        (SECOND | {"pair_agreement": "the routes disagree"}, "unresolved"),
        # A pair that is not named excuses no contradiction.
        (SECOND | second(closed=0.4) | {"agreement": "the routes disagree"}, "unresolved"),
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
    assert (
        "table_gain has a probability of 0.70 if something is missing; 0.8 takes"
        in decide(two).reasons[-1]
    )
    same = dataclasses.replace(two, alike=two.leading)
    assert decide(same).reasons[-1] == "this campaign does not tell these effects apart"
    many = dataclasses.replace(two, leading=tuple("abcdef"), alike=("a", "b"))
    assert (
        "the class of a has a probability of 0.70 if something is missing; it takes 6"
        in decide(many).reasons[-1]
    )
    flat = dataclasses.replace(many, alike=many.leading)
    assert "6 of the library's 20 effects cannot be told apart" in decide(flat).reasons[-1]


def test_a_gap_is_told_by_the_tests_that_found_it() -> None:
    calm = dataclasses.replace(CLEAR, gap_low=-0.01, direction_p=0.3, surprise_p=0.001)
    first, *others = decide(calm).reasons
    assert first.startswith("trials did what they never do in simulations")
    assert not others
    both = decide(dataclasses.replace(CLEAR, surprise_p=0.001)).reasons
    assert both[0].startswith("a gap beyond noise: p = 0.005 for its size")
    assert both[1] == first


def test_no_gap_with_a_favoured_effect_says_so() -> None:
    verdict = decide(
        dataclasses.replace(
            CLEAR, gap_low=-0.01, direction_p=0.3, none_probability=0.2, unknown_probability=0.1
        )
    )
    assert verdict.kind == "none"
    assert verdict.reasons[1].startswith("weighed by its prior, table_gain or another effect")
    outside = dataclasses.replace(
        CLEAR, gap_low=-0.01, direction_p=0.3, none_probability=0.2, unknown_probability=0.3
    )
    assert "prior, a cause outside the library, table_gain or" in decide(outside).reasons[1]
    calm = dataclasses.replace(
        CLEAR, gap_p=0.4, direction_p=0.3, none_probability=0.9, unknown_probability=0.1
    )
    assert len(decide(calm).reasons) == 1


def test_routes_that_contradict_each_other_are_told() -> None:
    assert disagreement(("a",), "a", "b", ("a", "b"), ("b", "a")) is None
    assert disagreement(("a",), "a", "b", ("a",), ("b",)) is not None
    assert disagreement(("a",), "a", "b", ("a",), ("b", "a")) is not None


def test_what_was_left_out_may_stand_behind_what_is_named() -> None:
    effect = Verdict("effect", ("table_resonance",), 0.9, ())
    told = withheld_mates(effect, ("catch", "table_pitch"))
    assert len(told) == 1
    assert told[0].startswith("table_pitch, which theory takes for about the same as table_reson")
    assert withheld_mates(effect, ("catch",)) == []
    assert withheld_mates(Verdict("unknown", (), 0.9, ()), ("table_pitch",)) == []


def test_repeats_that_scatter_beyond_the_simulations_are_told() -> None:
    def told(share, expected):
        return _repeated({"physical": share, "physical_expected": expected, "repeats": 30})

    # Three standard deviations of 3 expected are 5.2: 8.2 of 30.
    assert told(8 / 30, 0.1) == []
    assert "of 30 pairs of repeats 30% end otherwise, where the simulations" in told(0.3, 0.1)[0]
    assert told(3 / 30, 0.0) == [], "as if one were expected where none is"
    assert len(told(5 / 30, 0.0)) == 1
    assert "no repeats" in _repeated({"physical": None})[0]


@pytest.mark.parametrize(
    ("effect", "interval", "told"),
    [
        ("table_gain", (-0.1, 0.1), "change lies from -0.1 to 0.1, 0 being no effect"),
        ("table_gain", (0.1, 0.14), None),
        ("table_gain", (-0.14, -0.1), None),
        ("catch", (6.0, 10.0), None),
        ("catch", (6.0, 24.0), "slack lies from 6 to 24 degree, nearly all that its prior allows"),
    ],
)
def test_a_size_is_open_that_may_be_none_or_any(effect, interval, told) -> None:
    library = full_library()
    (parameter,) = free_parameters(library[effect])
    row = {"name": effect, "parameters": {parameter.name: {"ci95": list(interval)}}}

    def found(verdict):
        return _sizes(SimpleNamespace(library=library), verdict, [row])

    expected = [] if told is None else [f"the size of {effect} is not determined: its {told}"]
    assert found(Verdict("effect", (effect,), 0.9, ())) == expected
    assert found(Verdict("effect", ("wear",), 0.9, ())) == []


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
    assert _unseen(prepared, "wear") is unseen


def test_a_cause_outside_the_library_is_pointed_to_where_it_outweighs_all_else() -> None:
    unsure, named = (Verdict(kind, ("catch",), 0.9, ()) for kind in ("unresolved", "effect"))
    likely, unlikely = (dataclasses.replace(CLEAR, unknown_probability=p) for p in (0.51, 0.49))
    assert points_outside(unsure, likely)
    assert not points_outside(unsure, unlikely)
    assert not points_outside(named, likely)
