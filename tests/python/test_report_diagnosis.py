"""The diagnosis page and its figures say what the numbers say: content made by hand."""

from __future__ import annotations

import csv
import json
import math
import re

import jsonschema
import pytest

from diagnosis_content import (
    CONTENT,
    GAP,
    NONE_CAN_BE,
    ROWS,
    effect,
    estimate,
    named_throughout,
)
from vsr2.diagnosis import Diagnosis, schema
from vsr2.diagnosis.verdict.document import CHECK_FILES
from vsr2.report.diagnosis_figures import (
    map_figure,
)
from vsr2.report.diagnosis_page import diagnosis_page, format_diagnosis, write_diagnosis_page
from vsr2.report.messages.verdicts import (
    closure_note,
    corrected_note,
    sentence,
    verdict_sentence,
    with_sentences,
)


def test_the_page_shows_the_numbers() -> None:
    page = diagnosis_page(Diagnosis(CONTENT, ROWS))
    text = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    for part in (
        "The gap is 0.60 [0.59, 0.61] nat",
        "With wear added the loss falls by 0.50 [0.49, 0.51] nat. Closure 0.83 [0.82, 0.84]",
        "recalibration 0.17 [0.16, 0.18], the response dealt to wrong trials 0.33 [0.32, 0.34]",
        "Headline, closure minus the better of these, or 0: 0.50 [0.49, 0.51]",
        "repeat trial T7, where wear and catch differ most; about 3 repeats would",
        "table gain record the shake table beside the specimen",
        "drives the simulation T8 4",
        "decay of rocking T9 no number",
        "starts moved by 1e-6 to 1e-4 m and rad: 2.0 %",
        "half the time step: 3.0 %",
        "low PGA conditions outcome, response 2 +0.90 2.4 [2.1, 2.9] 0.004",
        "On 2000 simulated campaigns",
        "The name of one cause needs a probability of 0.85, given a gap.",
        "Names of causes that act together need 0.50. 9 % of names",
        "Of causes outside the library 40 % are said to be so",
        "90 % set: wear. corrected.yaml is the scene with wear (loss 0.08).",
    ):
        assert part in text, part
    assert "twice the solver's iterations" not in text
    assert "high PGA" not in text, "significant, but holds no more than its share"
    row = re.search(r"<tr><td>wear</td>.*?</tr>", page, re.DOTALL).group()
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells == ["wear", "0.800", "0.760", "size 0.12 [0.06, 0.16]"]


def test_verdict_losses_and_next_measurement_come_first() -> None:
    page = diagnosis_page(Diagnosis(CONTENT, ROWS))
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings[:3] == [
        "What to measure next",
        "How far the gap shrinks",
        "Where: the conditions",
    ]
    assert page.index("wear explains the gap") < page.index(headings[0])


def test_the_terminal_gets_the_same_in_short() -> None:
    lines = format_diagnosis(Diagnosis(CONTENT, ROWS)).splitlines()
    assert lines[0] == "hand: 4 trials, tier T"
    assert lines[2].startswith("loss a trial: before 0.80 [0.79, 0.81], after 0.30")
    assert lines[3] == (
        "closure 0.83 [0.82, 0.84], of a recalibration 0.17 [0.16, 0.18], dealt to wrong trials "
        "0.33 [0.32, 0.34], headline 0.50 [0.49, 0.51]"
    )
    assert "   0.80  wear                 size 0.12 [0.06, 0.16]" in lines
    assert lines[-1] == f"limit: {sentence(CONTENT['limits'][0])}"


@pytest.mark.parametrize(
    ("corrected", "said"),
    [
        (None, ""),
        (
            {"effects": {"wear": {"loss": 0.08}}, "among": ["wear", "change_point"], "scene": {}},
            "corrected.yaml is the scene with wear (loss 0.08), the first of wear or change point.",
        ),
        (
            {"effects": {"table_resonance": {"amplification": 1.2}}, "among": ["table_resonance"],
             "scene": None},
            "There is no corrected scene: no study states table resonance beside the scene's own "
            "effects.",
        ),
        (
            {"effects": {"wear": {"loss": 0.0801234}, "input_filter": {"input": "fused"}},
             "among": ["wear", "input_filter"], "scene": {}},
            "corrected.yaml is the scene with wear (loss 0.0801) and input filter (input fused).",
        ),
    ],
)  # fmt: skip
def test_what_the_corrected_scene_holds_is_said(corrected, said) -> None:
    assert corrected_note(CONTENT | {"corrected": corrected}) == said
    text = format_diagnosis(Diagnosis(CONTENT | {"corrected": corrected}, ROWS))
    assert said in text
    assert ("corrected" in text) == bool(said)


def test_tables_hold_numbers_and_codes() -> None:
    content = CONTENT | {"effects": [effect("wear", 0.8, 0.9), effect("catch", 0.1, 0.1)]}
    content["effects"][1]["parameters"] = {}
    tables = {
        name: list(csv.DictReader(text.splitlines()))
        for name, text in Diagnosis(content, ROWS).tables().items()
    }
    wear, catch = tables["effects.csv"]
    assert wear == {
        "effect": "wear", "probability": "0.8", "acts": "0.9", "parameter": "size",
        "mean": "0.11", "median": "0.12", "ci90_low": "0.06", "ci90_high": "0.16",
        "ci95_low": "0.05", "ci95_high": "0.17", "unit": "1",
    }  # fmt: skip
    assert (catch["effect"], catch["parameter"], catch["mean"]) == ("catch", "", "")
    locations = [(row["location"], row["values"]) for row in tables["where.csv"]]
    assert locations[:2] == [("intensity", "low"), ("all_trials", "")]


def test_hand_made_content_has_the_form_of_the_schema() -> None:
    validator = jsonschema.Draft202012Validator(schema())
    validator.check_schema(schema())
    validator.validate(json.loads(json.dumps(CONTENT)))
    validator.validate(json.loads(json.dumps(with_sentences(CONTENT))))


@pytest.mark.parametrize(
    ("part", "change"),
    [
        ("schema", "vsr2.diagnosis/2"),
        ("none_probability", 1.2),
        ("verdict", CONTENT["verdict"] | {"kind": "perhaps"}),
        ("verdict", CONTENT["verdict"] | {"reasons": [{"code": "gap", "values": {}}]}),
        ("verdict", CONTENT["verdict"] | {"reasons": [CONTENT["limits"][0]]}),
        ("limits", [{"code": "few_trials", "values": {"count": "three"}}]),
        ("gap", {k: v for k, v in CONTENT["gap"].items() if k != "closure"}),
        ("gap", CONTENT["gap"] | {"closure_resimulated": NONE_CAN_BE}),
        ("effects", [effect("wear", 0.8, 0.8) | {"class": "wear"}]),
        ("next_measurement", CONTENT["next_measurement"] | {"instruments": ["crystal_ball"]}),
        ("provenance", {}),
    ],
)
def test_the_schema_refuses(part, change) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json.loads(json.dumps(CONTENT | {part: change})), schema())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, "wear explains the gap (90 %): added, it closes 83 % of the gap on motions not seen."),
        ({"probability": 0.9988}, "(over 99 %)"),
        ({"headline": estimate(-0.02)}, "(90 %); on motions not seen it does not surely shrink"),
        ({"closure": estimate(0.005)}, "does not surely shrink the gap more than a negative"),
        ({"closure": NONE_CAN_BE}, "does not surely shrink the gap more than a negative"),
        (
            {"kind": "unresolved"},
            "There is a gap, but its cause is not resolved; the leading candidate is wear.",
        ),
        (
            {"kind": "unresolved", "names": ["wear", "catch", "friction", "inertia", "lag"]},
            "candidates are wear, catch, friction, inertia and 1 more.",
        ),
        ({"kind": "class", "names": ["wear", "catch"]}, "does not decide between them"),
        ({"kind": "class", "names": ["wear", "catch"]}, "added, the first closes 83 %"),
        ({"kind": "class", "names": ["wear", "catch"], "alike": True}, "cannot tell them apart"),
        ({"kind": "pair", "names": ["wear", "catch"]}, "Wear and catch together explain the gap"),
        (
            {"kind": "several", "names": [["wear", "catch"], ["friction"], ["inertia"]]},
            "Wear or catch, friction and inertia together explain the gap (90 %): added, they",
        ),
        ({"kind": "unknown", "names": [], "probability": 0.6}, "the library explains it (60 %)."),
        ({"kind": "none", "names": []}, "but residuals stand out: low PGA (family-wise p 0.004)"),
        (
            {"kind": "none", "names": [], "where": CONTENT["where"][1:], "probability": 0.23},
            "gives no reason to change the model, and does not exclude what is too weak to show "
            "(probability that no effect acts: 23 %).",
        ),
    ],
)
def test_the_sentence_claims_no_more_than_the_numbers(changes, sentence) -> None:
    code = "equivalent_here" if changes.get("alike") else None
    more = [] if code is None else [{"code": code, "values": {}}]
    kind, names = changes.get("kind", "effect"), changes.get("names", ["wear"])
    findings = names if kind == "several" else [[n] for n in names] if kind == "pair" else [names]
    verdict = CONTENT["verdict"] | {
        "kind": kind,
        "effects": [name for finding in findings for name in finding],
        "findings": findings,
        "probability": changes.get("probability", 0.9),
        "reasons": [GAP, *more],
    }
    gap = CONTENT["gap"] | {k: changes[k] for k in ("closure", "headline") if k in changes}
    where = changes.get("where", CONTENT["where"])
    content = CONTENT | {"verdict": verdict, "gap": gap, "where": where}
    assert sentence in verdict_sentence(content)


@pytest.mark.parametrize(
    ("before", "said"),
    [
        (0.06, "The loss before is below it: the campaign lies within the scatter"),
        (0.12, "A loss before that lies a little above it may be chance."),
    ],
)
def test_where_nothing_is_found_it_is_said_what_the_numbers_mean(before, said) -> None:
    verdict = CONTENT["verdict"] | {"kind": "none", "effects": [], "findings": []}
    gap = CONTENT["gap"] | {"effects": [], "before": estimate(before), "floor": estimate(0.11)}
    content = CONTENT | {"verdict": verdict, "gap": gap, "corrected": None}
    content["conformal_set_90"] = ["none", "catch", "wear", "unknown"]
    found = Diagnosis(content, ROWS)
    for text in (format_diagnosis(found), diagnosis_page(found)):
        assert "90 % set: none, catch, wear, unknown" in text
        assert "holds what the data cannot exclude, here 2 effects." in text
        assert "a low probability that no effect acts is no sign of a gap" in text
        assert said in text
    # And only there.
    assert "no sign of a gap" not in diagnosis_page(Diagnosis(CONTENT, ROWS))


@pytest.mark.parametrize(
    ("gap", "text"),
    [
        ({"effects": [], "closure": NONE_CAN_BE}, "Nothing is named, so that nothing was added."),
        ({"closure": NONE_CAN_BE}, "No closure is given, because the loss before is not above"),
    ],
)
def test_without_a_closure_it_is_said_why(gap, text) -> None:
    assert text in closure_note(CONTENT | {"gap": CONTENT["gap"] | gap})


def test_a_trial_to_repeat_with_new_instruments_separates_no_effects() -> None:
    split = CONTENT["next_measurement"]
    outside = {"trial": "T7", "tier": "M", "location": None}
    alone = split | {
        "kind": "out_of_library",
        "splits": [],
        "instruments": [],
        "repetition": None,
        "others": [],
        "out_of_library": outside,
    }
    for measure, there in ((alone, False), (split, True)):
        page = diagnosis_page(Diagnosis(CONTENT | {"next_measurement": measure}, ROWS))
        assert ("Without new instruments" in page) == there


def test_trials_without_measures_are_reported() -> None:
    [panel] = map_figure([row | {"log_pga_g": math.nan} for row in ROWS]).axes
    assert [text.get_text() for text in panel.texts] == ["no trial has intensity measures"]


def test_hostile_names_stay_text() -> None:
    page = diagnosis_page(named_throughout("<script>alert('x')</script>"))
    assert "<script" not in page.lower()
    assert page.count("&lt;script&gt;") > 15


def test_a_page_goes_with_the_diagnosis_that_it_shows(tmp_path) -> None:
    found, page = Diagnosis(CONTENT, ROWS), tmp_path / "index.html"
    page.write_text("mine")
    found.save(tmp_path)
    assert page.read_text() == "mine"
    assert write_diagnosis_page(found, tmp_path) == page
    assert page.read_text() == diagnosis_page(found)
    check = tmp_path / CHECK_FILES[0]
    check.write_text("of its posterior")
    found.save(tmp_path)
    assert not page.exists()
    assert not check.exists()
