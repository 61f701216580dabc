"""Every code has its sentence, and the sentences say what the values say."""

from __future__ import annotations

import pytest

from vsr2.diagnosis.verdict.next_measurement import BY_EFFECT, BY_STAGE, Instrument
from vsr2.diagnosis.verdict.statements import NAMES, LimitCode, ReasonCode, Statement
from vsr2.effects import STAGES
from vsr2.report.messages.verdicts import instrument, location, next_measurement, sentence

SAMPLES = {float: 0.25, int: 3, str: "wear", bool: True, NAMES: ("catch", "wear")}


@pytest.mark.parametrize("code", [*ReasonCode, *LimitCode])
def test_every_code_has_a_sentence(code) -> None:
    values = {name: SAMPLES[kind] for name, kind in code.types.items()}
    text = sentence(Statement.of(code, **values).to_json())
    assert len(text) > 15
    assert "{" not in text
    assert text == text.strip()
    # What a code carries is said, but for what only chooses the words.
    for name, value in values.items():
        if isinstance(value, str):
            assert value in text, name
        if isinstance(value, tuple) and name != "first":
            assert all(one in text for one in value), name


@pytest.mark.parametrize(
    ("statement", "text"),
    [
        (
            Statement.of(ReasonCode.NO_GAP, p_size=0.4, p_direction=0.3, size_significant=False),
            "no gap beyond noise: the loss is no larger than in campaigns simulated without any "
            "effect (p = 0.4), and none of the effects is favoured beyond what such campaigns show "
            "(p = 0.3)",
        ),
        (
            Statement.of(ReasonCode.NO_GAP, p_size=0.04, p_direction=0.3, size_significant=True),
            "(p = 0.04), but over these motions its interval reaches down to the floor, and none",
        ),
        (
            Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured="wear", out_of_library=False),
            "weighed by its prior, wear or another effect is more probable than none",
        ),
        (
            Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured="wear", out_of_library=True),
            "weighed by its prior, a cause outside the library, wear or another effect",
        ),
        (
            Statement.of(
                ReasonCode.OTHERS_FIT_WORSE, first=("wear",), probability=0.7, wanted=0.8
            ),
            "wear has a probability of 0.70 if something is missing; 0.8 takes the others too",
        ),
        (
            Statement.of(
                ReasonCode.TOO_MANY_NEEDED,
                first=("a", "b"), probability=0.7, wanted=0.8, count=6, offered=20,
            ),
            "the class of a has a probability of 0.70 if something is missing; it takes 6 of the "
            "library's 20 effects to reach 0.8",
        ),
        (
            Statement.of(ReasonCode.TOO_MANY_EQUIVALENT, count=6, offered=20),
            "6 of the library's 20 effects cannot be told apart",
        ),
        (Statement.of(ReasonCode.GAP_LEFT, left=1.2), "the best effect leaves 100% of the gap"),
        (
            Statement.of(ReasonCode.RESIMULATION_SHORT, closure=0.3, predicted=0.9),
            "the uncertain trials lose 30% of their gap where the emulator predicts 90%",
        ),
        (
            Statement.of(ReasonCode.PAIR_LEAVES_GAP, effects=("catch", "wear"), left=-0.1),
            "catch and wear together do better there than one effect, but leave 0% of the gap",
        ),
        (
            Statement.of(LimitCode.EQUIVALENT_TO_MEMBER, effect="catch", others=("a", "b")),
            "in place of catch it may be a or b, which theory takes for about the same",
        ),
        (
            Statement.of(LimitCode.BEYOND_TOLERANCE, nuisances=("slenderness", "inertia")),
            "a set-up whose slenderness or inertia lies further off",
        ),
        (
            Statement.of(LimitCode.FEW_SESSIONS, orders=6, p=1 / 6),
            "few sessions: their order can be changed in 6 ways, so that no change over the order "
            "is significant (p of 0.17 at least)",
        ),
        (
            Statement.of(
                LimitCode.SIZE_MAY_BE_NULL,
                effect="table_gain", parameter="change", low=-0.1, high=0.1, unit="1", null=0.0,
            ),
            "the size of table_gain is not determined: its change lies from -0.1 to 0.1, 0 being "
            "no effect",
        ),
        (
            Statement.of(
                LimitCode.SIZE_AS_WIDE_AS_PRIOR,
                effect="catch", parameter="slack", low=6.0, high=24.0, unit="degree",
            ),
            "its slack lies from 6 to 24 degree, nearly all that its prior allows",
        ),
        (
            Statement.of(LimitCode.EFFECT_UNAVAILABLE, effect="wear", error="a {brace}"),
            "wear was not looked for, this scene cannot have it: a {brace}",
        ),
        (
            Statement.of(LimitCode.REPEATS_SCATTER, pairs=30, share=0.3, expected=0.1),
            "of 30 pairs of repeats 30% end otherwise, where the simulations have 10%",
        ),
    ],
)  # fmt: skip
def test_sentences_say_what_the_values_say(statement, text) -> None:
    assert text in sentence(statement.to_json())


def test_every_stage_has_an_instrument_and_every_instrument_a_sentence() -> None:
    assert set(BY_STAGE) == set(STAGES)
    assert {*BY_STAGE.values(), *BY_EFFECT.values()} == set(Instrument)
    assert len({instrument(one) for one in Instrument}) == len(Instrument)


def test_what_to_measure_next_is_worded() -> None:
    blank = {"kind": "check", "instruments": [], "out_of_library": None}
    check = blank | {"instruments": ["film_outcomes"]}
    film = "film every trial and judge all of them again by one rule"
    assert next_measurement(check) == film
    two = ["film_outcomes", "vertical_record"]
    record = "record the table's vertical acceleration"
    assert next_measurement(check | {"kind": "split", "instruments": two}) == (
        f"{film}; or {record}"
    )
    assert next_measurement(check | {"kind": "both", "instruments": two}) == (
        f"{film}; and {record}"
    )
    outside = {"trial": "T7", "tier": "M", "location": "largest_tilt: low PGA"}
    alone = next_measurement(blank | {"kind": "out_of_library", "out_of_library": outside})
    assert alone == (
        "no effect of the library fits: repeat trial T7, which the best of them explains least, "
        "with instruments beyond tier M (series channel), and film base and edges; the residuals "
        "point to: largest_tilt: low PGA"
    )
    both = next_measurement(check | {"out_of_library": outside | {"location": None}})
    assert both.startswith("if the cause lies outside the library: repeat trial T7")
    assert both.endswith(f"film base and edges; otherwise {film}")


def test_a_location_is_named_with_its_feature() -> None:
    row = {"location": "low PGA", "feature": "largest_tilt", "channel": "tilt"}
    assert location(row) == "largest_tilt: low PGA"
    assert location(row | {"feature": "outcome", "channel": "outcome"}) == "low PGA"
