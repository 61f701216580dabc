"""Every code has its sentence, and the sentences say what the values say."""

from __future__ import annotations

import re
from enum import Enum
from importlib import import_module
from pkgutil import walk_packages
from types import SimpleNamespace

import pytest

import vsr2
from vsr2 import _native
from vsr2.blind.form.diagnosis_form import FailureCode
from vsr2.blind.form.events import EventCode
from vsr2.calibration.calibrate import NoBaselines
from vsr2.codes import NAMES, NUMBERS, Statement
from vsr2.diagnosis.verdict.next_measurement import BY_EFFECT, BY_STAGE, Instrument
from vsr2.diagnosis.verdict.statements import LimitCode, ReasonCode
from vsr2.diagnosis.where.scan import LocationKind
from vsr2.effects import STAGES
from vsr2.errors import Fault, ResultError
from vsr2.fragility import FitNote
from vsr2.report.messages import (
    agreement,
    blind_packs,
    commands,
    data,
    found_causes,
    progress_lines,
    ros2_import,
    scores,
    verdicts,
)
from vsr2.report.messages.blind_packs import FAILURES, event_text
from vsr2.report.messages.data import scene_note
from vsr2.report.messages.figure_titles import SHOWN_AS_NONE, SHOWN_AS_ON_TIME, tracking_title
from vsr2.report.messages.runs import STATUS_MEANING, fit_note, no_baselines
from vsr2.report.messages.templates import check_worded
from vsr2.report.messages.verdicts import instrument, location, next_measurement, sentence
from vsr2.results import Status
from vsr2.scene import SceneNote

SAMPLES = {
    float: 0.25,
    int: 3,
    str: "wear",
    Fault: Fault.motion,
    NAMES: ("catch", "wear"),
}


@pytest.mark.parametrize(
    ("lag", "words"),
    [
        (float("nan"), "no lag"),
        (-0.5 * SHOWN_AS_ON_TIME, "0 ms late"),
        (2.0 * SHOWN_AS_ON_TIME, "2e-06 ms late"),
        (-0.012, "12 ms early"),
    ],
)
def test_a_lag_within_its_error_is_shown_as_none(lag: float, words: str) -> None:
    found = SimpleNamespace(peak_error=0.001, rms_error=0.5 * SHOWN_AS_NONE, lag=lag)
    assert tracking_title(found) == f"peak 1 mm, rms 0 mm, {words}"


@pytest.mark.parametrize("code", [*ReasonCode, *LimitCode])
def test_every_code_has_a_sentence(code) -> None:
    values = {name: SAMPLES[kind] for name, kind in code.types.items()}
    text = sentence(Statement.of(code, **values).to_json())
    assert len(text) > 15
    assert "{" not in text
    assert text == text.strip()
    # What a code carries is said, but for what only chooses the words.
    for name, value in values.items():
        if code.types[name] is str:
            assert value in text, name
        if isinstance(value, tuple):
            assert all(one in text for one in value), name


@pytest.mark.parametrize(
    ("statement", "text"),
    [
        (
            Statement.of(ReasonCode.NO_GAP, none=0.62, limit=0.31),
            "no gap beyond noise: the probability of none is 0.62, and one gap-free campaign in "
            "twenty has less than 0.31",
        ),
        (
            Statement.of(ReasonCode.GAP, none=0.0123, limit=0.31),
            "a gap beyond noise: the probability of none is 0.012",
        ),
        (
            Statement.of(ReasonCode.GAP, none=5.7e-07, limit=0.31),
            "a gap beyond noise: the probability of none is below 0.001, and one",
        ),
        (
            Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured=("wear", "catch")),
            "wear + catch is more probable than none, but no more than in gap-free campaigns",
        ),
        (
            Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured=()),
            "a cause outside the library is more probable than none",
        ),
        (
            Statement.of(ReasonCode.NAME_REACHED, probability=0.934, wanted=0.9),
            "given a gap, what is named has a probability of 0.93; a name needs 0.9",
        ),
        (
            Statement.of(
                ReasonCode.TOO_MANY_NEEDED,
                effects=("a", "b"), probability=0.7, wanted=0.85, classes=1,
            ),
            "the most probable effects (a, b; 1 class) reach 0.70 given a gap, where a name "
            "needs 0.85",
        ),
        (
            Statement.of(ReasonCode.SECOND_EFFECT_LIKELY, probability=0.6),
            "two effects or more act with a probability of 0.60, but which ones is not sure enough",
        ),
        (
            Statement.of(LimitCode.POSSIBLY_OUT_OF_LIBRARY, probability=0.3, prior=0.15),
            "the chance that the cause lies outside the library is 30 %, from 15 % before",
        ),
        (
            Statement.of(LimitCode.NO_GAIN, effects=("wear", "catch")),
            "with wear and catch added, the loss on motions not seen does not surely fall",
        ),
        (
            Statement.of(LimitCode.LOW_DETECTION_RATE, rate=0.2),
            "of causes outside the library 20 % are recognised as such",
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
            Statement.of(LimitCode.FEW_SESSIONS, permutations=6, p=1 / 6),
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
            Statement.of(LimitCode.EFFECT_UNAVAILABLE, effect="wear", fault=Fault.drive),
            "wear was not looked for, this scene cannot have it: it moves the pedestal beside x",
        ),
        (
            Statement.of(LimitCode.REPEATS_SCATTER, pairs=30, share=0.3, expected=0.1),
            "of 30 pairs of repeats 30 % end otherwise, where the simulations have 10 %",
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
    record = "record the shake table's vertical acceleration"
    assert next_measurement(check | {"kind": "split", "instruments": two}) == (
        f"{film}; or {record}"
    )
    assert next_measurement(check | {"kind": "both", "instruments": two}) == (
        f"{film}; and {record}"
    )
    low = {"kind": "intensity", "values": {"pga_g": "low"}}
    there = {"location": low, "feature": "largest_tilt", "channel": "tilt"}
    outside = {"trial": "T7", "tier": "M", "location": there}
    alone = next_measurement(blank | {"kind": "out_of_library", "out_of_library": outside})
    assert alone == (
        "no effect of the library fits: repeat trial T7, which the best of them explains least, "
        "with instruments beyond tier M (series channel), and film base and edges; the residuals "
        "point to: largest tilt: low PGA"
    )
    both = next_measurement(check | {"out_of_library": outside | {"location": None}})
    assert both.startswith("if the cause lies outside the library: repeat trial T7")
    assert both.endswith(f"film base and edges; otherwise {film}")


@pytest.mark.parametrize(
    ("kind", "values", "text"),
    [
        (LocationKind.ALL_TRIALS, {}, "all trials"),
        (LocationKind.INTENSITY, {"pga_g": "low"}, "low PGA"),
        (LocationKind.INTENSITY, {"pgv_pga_s": "middle"}, "middle PGV/PGA"),
        (LocationKind.INTENSITY, {"pga_g": "low", "pgv_pga_s": "high"}, "low PGA, high PGV/PGA"),
        (LocationKind.TREND, {}, "trend"),
        (LocationKind.STEP, {"session": "day 2"}, "change before session day 2"),
        (LocationKind.SESSION, {"session": "day 2"}, "session day 2"),
        (LocationKind.SPECIMEN, {"specimen": "B"}, "specimen B"),
    ],
)
def test_a_location_is_named_with_its_feature(kind, values, text) -> None:
    place = {"kind": kind, "values": values}
    row = {"location": place, "feature": "largest_tilt", "channel": "tilt"}
    assert location(row) == f"largest tilt: {text}"
    assert location(row | {"feature": "outcome", "channel": "outcome"}) == text


def test_each_reason_for_no_baselines_has_a_sentence_of_its_own() -> None:
    sentences = {no_baselines(why) for why in (None, *NoBaselines)}
    assert len(sentences) == 1 + len(NoBaselines)
    assert no_baselines(None) == ""


@pytest.mark.parametrize("code", SceneNote)
def test_a_note_on_a_scene_says_all_its_values(code) -> None:
    samples = {**SAMPLES, int: 77, float: 0.0123, NUMBERS: (1.5, 2.25)}
    values = {name: samples[kind] for name, kind in code.types.items()}
    text = scene_note(Statement.of(code, **values).to_json())
    for kind, said in ((str, "wear"), (int, "77"), (float, "0123|1.23"), (tuple, "1.5, 2.25")):
        wanted = sum(one is kind for one in code.types.values())
        assert len(re.findall(said, text)) == wanted, kind


@pytest.mark.parametrize("code", EventCode)
def test_an_event_is_reported_with_all_its_values(code) -> None:
    values = {
        name: f"<{name}>" if kind is str else ("a", "b") if kind is NAMES else 7
        for name, kind in code.types.items()
    }
    if code is EventCode.FAILED:
        values["cause"] = "campaign_unusable"
    text = event_text(Statement.of(code, **values))
    values["cause"] = FAILURES.get(values.get("cause"), "")
    assert all(value in text for value in values.values() if isinstance(value, str))
    assert text.count("7") == sum(kind in (int, float) for kind in code.types.values())
    assert text.count("a, b") == sum(kind is NAMES for kind in code.types.values())


def enumerations() -> dict[str, type[Enum]]:
    """All of the package, by name; those of the core among them."""
    found = dict(vars(_native))
    for module in walk_packages(vsr2.__path__, "vsr2."):
        if not module.name.endswith("__main__"):
            found |= vars(import_module(module.name))
    return {
        kind.__name__: kind
        for kind in found.values()
        if isinstance(kind, type) and issubclass(kind, Enum) and "vsr2" in kind.__module__
    }


WORDED = {
    "Assumed": ros2_import.IMPORT_NOTES,
    "Ended": commands._ENDED,
    "EventCode": blind_packs.EVENTS,
    "FailureCode": blind_packs.FAILURES,
    "Fault": verdicts._SECTIONS["faults"],
    "Fitted": agreement.FITTED,
    "NotJudged": found_causes._NOT_JUDGED,
    "Identifiability": agreement.IDENTIFIABILITY,
    "Ignored": ros2_import.IMPORT_NOTES,
    "Instrument": verdicts._SECTIONS["instruments"],
    "Kept": ros2_import.IMPORT_NOTES,
    "LimitCode": verdicts._SECTIONS["limits"],
    "LocationKind": verdicts._SECTIONS["locations"],
    "NotKept": ros2_import.IMPORT_NOTES,
    "Phase": verdicts._SECTIONS["phases"],
    "ReasonCode": verdicts._SECTIONS["reasons"],
    "SceneNote": data.SCENE_NOTES,
    "ScoreCode": scores.SCORES,
    "Stage": progress_lines.STAGES,
    "VerdictKind": verdicts._SECTIONS["verdicts"],
}
"""Where the sentences of an enumeration stand."""
SHOWN_BY_NAME = {
    "BudgetState", "Drive", "EffectAxis", "EngineKind", "EngineName", "FastRefusal",
    "FeatureChannel", "GapState", "HandOver", "Kind", "LocationAxis", "Loss", "MeasurementKind",
    "Objective", "Outcome", "PredictedBy", "Scope", "Third",
}  # fmt: skip
"""Enumerations whose members are words of files and tables, or choose between sentences."""
ELSEWHERE = {"Code", "FitNote", "NoBaselines", "Status"}
"""The base of all codes, and enumerations whose sentences other tests of this module check."""

NEVER_SHOWN = {
    "MarginLevel", "MarginStream", "PackStream", "Stream", "_Draws", "_State"
}  # fmt: skip
"""Numbers of random streams and of levels, and what a search is at."""


def test_every_enumeration_is_worded_or_shown_by_name() -> None:
    assert set(enumerations()) == {*WORDED, *SHOWN_BY_NAME, *ELSEWHERE, *NEVER_SHOWN}


@pytest.mark.parametrize("name", WORDED)
def test_every_member_has_its_sentence(name) -> None:
    lacking = [str(code) for code in enumerations()[name] if not WORDED[name].get(code)]
    assert not lacking


@pytest.mark.parametrize("note", FitNote)
def test_every_note_on_a_fit_has_its_sentence(note) -> None:
    assert len(fit_note(SimpleNamespace(falling=(), note=note))) > 15
    assert fit_note(SimpleNamespace(falling=(), note=None)) == ""


def test_every_status_has_its_meaning() -> None:
    assert list(STATUS_MEANING) == [status.name for status in Status]


def test_a_code_without_a_sentence_is_named_with_the_place_to_add_it() -> None:
    with pytest.raises(TypeError, match=r"here: no sentence for \['no_gap'\], no code for none"):
        check_worded([ReasonCode.NO_GAP, ReasonCode.GAP], {ReasonCode.GAP: "a gap"}, "here")
    with pytest.raises(TypeError, match=r"no sentence for none, no code for \['fap'\]"):
        check_worded([ReasonCode.GAP], {ReasonCode.GAP: "a gap", "fap": "a fap"}, "here")


def test_a_code_of_another_version_is_refused_with_its_remedy() -> None:
    with pytest.raises(ResultError, match="'fap' is none of the limits that this version words"):
        sentence({"code": "fap", "values": {}})
    with pytest.raises(ResultError, match="'free decay' is none of the phases that this version"):
        verdicts.phase("free decay")


def test_events_are_worded_briefly() -> None:
    limit = {"engine": "mujoco", "effect": "wear", "sign": -1, "limit": 0.012345}
    assert event_text(Statement.of(EventCode.DETECTION_LIMIT, **limit)) == (
        "detection limit of mujoco wear -1: 0.0123"
    )
    failed = {"campaign": "c1", "tier": "B", "cause": "campaign_unusable", "message": "no motion"}
    assert event_text(Statement.of(EventCode.FAILED, **failed)) == (
        "c1 B: failed: the campaign cannot be used: no motion"
    )
    assert set(FAILURES) == set(FailureCode)
