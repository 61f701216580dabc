"""The diagnosis page and its figures say what the numbers say: content made by hand."""

from __future__ import annotations

import csv
import json
import math
import re
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import jsonschema
import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vsr2.diagnosis import SCHEMA, Diagnosis, schema
from vsr2.report.diagnosis import diagnosis_page, format_diagnosis, write_diagnosis_page
from vsr2.report.diagnosis_figures import (
    GREY,
    RED,
    channels_figure,
    effects_figure,
    losses_figure,
    map_figure,
    order_figure,
    reliability_figure,
    sets_figure,
)
from vsr2.report.messages.verdicts import (
    closure_note,
    corrected_note,
    sentence,
    verdict_sentence,
    with_sentences,
)
from vsr2.report.panels import svg


def estimate(value: float, half: float = 0.01) -> dict:
    return {"value": value, "ci95": [value - half, value + half]}


def control(closure: float, loss: float) -> dict:
    return {"closure": estimate(closure), "loss": estimate(loss)}


def effect(name: str, probability: float, acts: float) -> dict:
    size = {"mean": 0.11, "median": 0.12, "ci90": [0.06, 0.16], "ci95": [0.05, 0.17], "unit": "1"}
    return {
        "name": name,
        "probability": probability,
        "acts": acts,
        "parameters": {"size": size},
    }


def location(
    values: dict, feature: str, channel: str, phase: str, size: float, p: float, **found: Any
) -> dict:
    return {
        "location": {"kind": "intensity" if values else "all_trials", "values": values},
        "axis": "conditions",
        "feature": feature,
        "channel": channel,
        "phase": phase,
        "effect_size": size,
        "p_familywise": p,
        "concentration": 1.0,
        "trials": None,
        **found,
    }


NONE_CAN_BE = {"value": None, "ci95": None}
GAP = {"code": "gap", "values": {"none": 0.01, "limit": 0.3}}
LOW_PGA = location(
    {"pga": "low"}, "outcome", "outcome", "whole response", 0.9, 0.004,
    concentration=2.4, trials=["A", "B"],
)  # fmt: skip
CONTENT = {
    "schema": SCHEMA,
    "campaign": {
        "name": "hand", "trials": 4, "tier": "T", "motions": 2, "sessions": 2,
        "responding_trials": 4,
    },
    "gap": {
        "state": "found",
        "effects": ["wear"],
        "before": estimate(0.8),
        "after": estimate(0.3),
        "floor": estimate(0.2),
        "closure": estimate(0.83),
        "excess": estimate(0.6),
        "excess_after": estimate(0.1),
        "gain": estimate(0.5),
        "headline": estimate(0.5),
        "layers": {
            "numerical": 0.02, "time_step": 0.03, "solver": None, "input": 0.04, "nuisance": 0.05,
            "physical": None, "physical_expected": None, "trials": 4, "repeats": 0,
        },
    },
    "where": [
        LOW_PGA,
        location({}, "outcome", "outcome", "whole response", 0.6, 0.01),
        location(
            {"pga": "high"}, "outcome", "outcome", "whole response", 0.5, 0.02, concentration=1.4
        ),
        location({}, "largest_tilt", "tilt", "strong shaking", -0.3, 0.5),
    ],
    "verdict": {"kind": "effect", "effects": ["wear"], "probability": 0.9, "reasons": [GAP]},
    "effects": [effect("wear", 0.76, 0.8), effect("catch", 0.09, 0.12)],
    "sets": [
        {"effects": ["wear"], "probability": 0.72},
        {"effects": ["unknown"], "probability": 0.1},
        {"effects": ["catch", "wear"], "probability": 0.08},
        {"effects": [], "probability": 0.05},
        {"effects": ["catch"], "probability": 0.05},
    ],
    "none_probability": 0.05,
    "conformal_set_90": ["wear"],
    "negative_control": {"recalibrated": control(0.17, 0.7), "dealt": control(0.33, 0.6)},
    "unknown": {"probability": 0.1, "detection_rate": 0.4},
    "posterior": {
        "temperature": 1.1, "none_limit": 0.3, "least_name": 0.85, "set_level": 0.95,
        "wrong": 0.09, "named": 0.62, "detection_rate": 0.4, "campaigns": 2000,
    },
    "next_measurement": {
        "kind": "split",
        "splits": ["wear", "catch"],
        "instruments": ["repeat_first_trials", "slack"],
        "repetition": {"trial": "T7", "information_per_repeat": 1.0, "repeats": 3},
        "others": [
            {
                "name": "table_gain",
                "instrument": "table_sensors",
                "repetition": {"trial": "T8", "information_per_repeat": 1.0, "repeats": 4},
            },
            {
                "name": "friction",
                "instrument": "push_and_rock",
                "repetition": {"trial": "T9", "information_per_repeat": 0.0, "repeats": None},
            },
        ],
        "out_of_library": None,
    },
    "limits": [{"code": "one_session", "values": {}}],
    "corrected": {
        "effects": {"wear": {"loss": 0.08}}, "among": ["wear"],
        "scene": {"friction": {"factor": 0.8}, "wear": {"loss": 0.08}},
    },
    "provenance": {
        "versions": {"vsr2": "1"},
        "budget": {
            "state": "sufficient", "simulations": 9, "allowed": 10, "cost_s": 0.1, "simulated": 9,
            "reused": 0, "campaigns": 2000,
        },
        "detection_limits": {"wear +": 0.1},
        "constants": {"look": {"trials": 40}},
        "excluded": [],
        "references": [],
        "held_out": True,
        "nuisances": ["friction"],
        "simulator": "0",
        "seed": 0,
        "wall_time_s": 1.0,
    },
}  # fmt: skip
TRIALS = (
    ("A", "s1", 1, 1.0, 0, 0.9, 0.2, 2.3, 0.22),
    ("B", "s1", 2, 1.0, 1, 0.9, 0.8, 0.1, 0.22),
    ("C", "s2", 3, 1.4, 1, 0.1, 0.8, 2.3, 0.22),
    ("D", "s2", 4, 1.4, 1, 0.1, 0.8, 2.3, 0.22),
)
ROWS = tuple(
    {
        "trial": name,
        "motion": "m",
        "session": session,
        "order": order,
        "log_pga": pga,
        "log_ratio": -2.0 + 0.1 * order,
        "overturned": overturned,
        "uncertain": 1,
        "before": before,
        "after": after,
        "loss_before": loss,
        "loss_after": after_loss,
        "floor": 0.1,
    }
    for name, session, order, pga, overturned, before, after, loss, after_loss in TRIALS
)


def marks(figure: Figure) -> dict[str, Any]:
    """Marks of the figure by the text that a browser shows on them."""
    [panel] = figure.axes
    found = {
        unquote(artist.get_gid().removeprefix("tooltip-")): artist
        for artist in panel.get_children()
        if artist.get_gid()
    }
    assert panel.get_legend() or figure.legends, "no legend"
    return found


def at(mark: Line2D) -> tuple[float, float]:
    return float(mark.get_xdata()[0]), float(mark.get_ydata()[0])


def test_the_bars_are_as_high_as_the_losses() -> None:
    figure = losses_figure(CONTENT)
    height = {text.split(":")[0]: bar.get_height() for text, bar in marks(figure).items()}
    wanted = {"before": 0.8, "after": 0.3, "recalibrated": 0.7, "dealt": 0.6, "floor": 0.2}
    assert height == wanted
    ends = [line.get_ydata() for line in figure.axes[0].lines]
    assert ends == [pytest.approx([v - 0.01, v + 0.01]) for v in wanted.values()]
    assert figure.axes[0].get_ylabel() == "loss a trial [nat]"


def test_where_nothing_is_named_there_are_before_and_floor_alone() -> None:
    bare = {"closure": NONE_CAN_BE, "loss": NONE_CAN_BE}
    content = CONTENT | {
        "gap": CONTENT["gap"] | {"after": NONE_CAN_BE},
        "negative_control": {"recalibrated": bare, "dealt": bare},
    }
    assert list(marks(losses_figure(content))) == ["before: 0.800", "floor: 0.200"]


def test_effects_are_ordered_by_whether_they_act_and_the_set_is_filled() -> None:
    figure = effects_figure(CONTENT)
    bars = marks(figure)
    assert list(bars) == ["wear: 0.800", "catch: 0.120", "unknown: 0.100", "none: 0.050"]
    assert [bar.get_width() for bar in bars.values()] == [0.8, 0.12, 0.1, 0.05]
    hollow = {text.split(":")[0] for text, bar in bars.items() if bar.get_facecolor()[3] == 0}
    assert hollow == {"unknown", "none", "catch"}
    top, bottom = (figure.axes[0].transData.transform((0, y))[1] for y in (0, 3))
    assert top > bottom, "the most probable is not on top"


def test_sets_are_shown_as_what_acts_together() -> None:
    [panel] = sets_figure(CONTENT).axes
    assert [text.get_text() for text in panel.get_yticklabels()] == [
        "wear", "unknown", "catch + wear", "none", "catch",
    ]  # fmt: skip
    assert [bar.get_width() for bar in panel.patches] == [0.72, 0.1, 0.08, 0.05, 0.05]


def test_no_more_than_ten_hypotheses_are_drawn() -> None:
    many = [effect(f"e{i}", 0.05, 0.05) for i in range(12)]
    assert len(marks(effects_figure({**CONTENT, "effects": many}))) == 10


def test_the_map_fills_what_overturned_and_reddens_what_surprised() -> None:
    by_trial = {text[0]: mark for text, mark in marks(map_figure(ROWS)).items()}
    filled = {name for name, one in by_trial.items() if one.get_markerfacecolor() != "none"}
    assert filled == {"B", "C", "D"}
    assert {name for name, one in by_trial.items() if one.get_color() == RED} == set()
    red = {name for name, one in by_trial.items() if one.get_markeredgecolor() == RED}
    assert red == {"A", "C", "D"}
    assert at(by_trial["A"]) == pytest.approx((math.e / 9.80665, math.exp(-1.9)))
    assert by_trial["A"].get_markersize() > by_trial["B"].get_markersize()


def test_the_order_shows_observed_minus_predicted_and_the_sessions_means() -> None:
    figure = order_figure(ROWS)
    found = {trial: at(mark) for trial, mark in marks(figure).items()}
    wanted = {"A": (1, -0.9), "B": (2, 0.1), "C": (3, 0.9), "D": (4, 0.9)}
    assert found == {name: pytest.approx(xy) for name, xy in wanted.items()}
    means = [line for line in figure.axes[0].lines if not line.get_gid()]
    assert [list(line.get_xdata()) for line in means] == [[1, 2], [3, 4]]
    assert [line.get_ydata()[0] for line in means] == pytest.approx([-0.4, 0.9])


def test_channels_that_stand_out_are_filled() -> None:
    bars = marks(channels_figure(CONTENT))
    filled = {text: bar.get_facecolor()[3] > 0 for text, bar in bars.items()}
    assert filled == {
        "all trials: +0.60, family-wise p 0.010": True,
        "largest_tilt: all trials: -0.30, family-wise p 0.500": False,
    }
    assert [bar.get_width() for bar in bars.values()] == [0.6, -0.3]


def test_reliability_draws_before_as_crosses_and_after_as_dots() -> None:
    points = [
        (mark.get_marker(), unquote(mark.get_gid().removeprefix("tooltip-")), at(mark))
        for mark in reliability_figure(ROWS).axes[0].lines
        if mark.get_gid()
    ]
    # All three that the model with the effect gives 0.8 overturned, the one with 0.2 did not.
    assert points == [
        ("x", "before: 2 trials", pytest.approx((0.1, 1.0))),
        ("x", "before: 2 trials", pytest.approx((0.9, 0.5))),
        ("o", "after: 1 trials", pytest.approx((0.2, 0.0))),
        ("o", "after: 3 trials", pytest.approx((0.8, 1.0))),
    ]


def test_a_drawing_is_xml_with_its_tooltips_and_always_the_same() -> None:
    rows = [row | {"trial": f'<b>{row["trial"]}</b> & "co"'} for row in ROWS]
    drawing = svg(order_figure(rows), 'a "map" of <what>')
    root = ElementTree.fromstring(drawing)
    assert root.get("aria-label") == 'a "map" of <what>'
    assert root.get("viewBox")
    assert root.get("width") is None
    titles = [one.text for one in root.iter("{http://www.w3.org/2000/svg}title")]
    assert titles == [row["trial"] for row in rows]
    assert svg(order_figure(rows), 'a "map" of <what>') == drawing


def test_the_page_shows_the_numbers() -> None:
    page = diagnosis_page(Diagnosis(CONTENT, ROWS))
    text = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    for part in (
        "The gap is 0.60 [0.59, 0.61] nat",
        "With wear added the loss falls by 0.50 [0.49, 0.51] nat. Closure 0.83 [0.82, 0.84]",
        "recalibration 0.17 [0.16, 0.18], the response dealt to wrong trials 0.33 [0.32, 0.34]",
        "Headline, closure minus the better of these, or 0: 0.50 [0.49, 0.51]",
        "repeat trial T7, where wear and catch differ most; about 3 repeats would",
        "table gain record the table beside the specimen",
        "drives the simulation T8 4",
        "decay of rocking T9 no number",
        "starts moved by 1e-6 to 1e-4 m and rad: 2.0%",
        "half the time step: 3.0%",
        "low PGA conditions outcome, whole response 2 +0.90 2.4 0.004",
        "On 2000 simulated campaigns",
        "A name needs a probability of 0.85, given a gap: 9 % of names",
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
    assert headings[:2] == ["How far the gap shrinks", "What to measure next"]
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
        ({}, "wear explains the gap (90%): added, it closes 83% of the gap on motions not seen."),
        ({"probability": 0.9988}, "(over 99%)"),
        ({"headline": estimate(-0.02)}, "(90%); on motions not seen it does not surely shrink"),
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
        ({"kind": "class", "names": ["wear", "catch"]}, "added, the first closes 83%"),
        ({"kind": "class", "names": ["wear", "catch"], "alike": True}, "cannot tell them apart"),
        ({"kind": "pair", "names": ["wear", "catch"]}, "Wear and catch together explain the gap"),
        ({"kind": "unknown", "names": [], "probability": 0.6}, "the library explains it (60%)."),
        ({"kind": "none", "names": []}, "but residuals stand out: low PGA (family-wise p 0.004)"),
        (
            {"kind": "none", "names": [], "where": CONTENT["where"][1:], "probability": 0.23},
            "gives no reason to change the model, and does not exclude what is too weak to show "
            "(none: 23%).",
        ),
    ],
)
def test_the_sentence_claims_no_more_than_the_numbers(changes, sentence) -> None:
    alike = [{"code": "equivalent_here", "values": {}}] if changes.get("alike") else []
    verdict = CONTENT["verdict"] | {
        "kind": changes.get("kind", "effect"),
        "effects": changes.get("names", ["wear"]),
        "probability": changes.get("probability", 0.9),
        "reasons": [GAP, *alike],
    }
    gap = CONTENT["gap"] | {k: changes[k] for k in ("closure", "headline") if k in changes}
    where = changes.get("where", CONTENT["where"])
    content = CONTENT | {"verdict": verdict, "gap": gap, "where": where}
    assert sentence in verdict_sentence(content)


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
    [panel] = map_figure([row | {"log_pga": math.nan} for row in ROWS]).axes
    assert [text.get_text() for text in panel.texts] == ["no trial has intensity measures"]


def test_trials_that_never_lift_off_are_no_surprise() -> None:
    still = {"uncertain": 0, "before": math.nan, "loss_before": math.nan, "floor": math.nan}
    rows = [ROWS[0] | still, *ROWS[1:]]
    by_trial = {text[0]: mark for text, mark in marks(map_figure(rows)).items()}
    assert by_trial["A"].get_markeredgecolor() == GREY
    assert "A" not in marks(order_figure(rows))


def test_hostile_names_stay_text() -> None:
    bad = "<script>alert('x')</script>"
    rows = [row | {"trial": bad, "session": bad} for row in ROWS]
    repetition = {"trial": bad, "information_per_repeat": 1.0, "repeats": 1}
    measure = CONTENT["next_measurement"] | {"repetition": repetition, "splits": [bad, "wear"]}
    measure["others"] = [{"name": bad, "instrument": "slack", "repetition": repetition}]
    there = location({"pga": bad, "pgv_pga": bad}, bad, bad, bad, 0.6, 0.01, trials=[bad])
    measure["out_of_library"] = {"trial": bad, "tier": "M", "location": there}
    content = CONTENT | {
        "campaign": CONTENT["campaign"] | {"name": bad, "tier": bad},
        "gap": CONTENT["gap"] | {"effects": [bad]},
        "verdict": CONTENT["verdict"] | {"effects": [bad]},
        "effects": [effect(bad, 0.8, 0.8)],
        "sets": [{"effects": [bad], "probability": 0.8}],
        "conformal_set_90": [bad],
        "where": [there],
        "next_measurement": measure,
        "provenance": {bad: bad},
    }
    content["effects"][0]["parameters"] = {bad: content["effects"][0]["parameters"]["size"]}
    page = diagnosis_page(Diagnosis(content, tuple(rows)))
    assert "<script" not in page.lower()
    assert page.count("&lt;script&gt;") > 15


def test_a_page_goes_with_the_diagnosis_that_it_shows(tmp_path) -> None:
    found, page = Diagnosis(CONTENT, ROWS), tmp_path / "index.html"
    page.write_text("mine")
    found.save(tmp_path)
    assert page.read_text() == "mine"
    assert write_diagnosis_page(found, tmp_path) == page
    assert page.read_text() == diagnosis_page(found)
    found.save(tmp_path)
    assert not page.exists()
