"""The diagnosis page and its figures say what the numbers say: content made by hand."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import pytest

from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.report.diagnosis import diagnosis_page
from vsr2.report.diagnosis_figures import (
    bars_figure,
    channels_figure,
    map_figure,
    order_figure,
    posterior_figure,
    reliability_figure,
)
from vsr2.report.messages import verdict_sentence


def estimate(value: float, half: float = 0.01) -> dict:
    return {"value": value, "ci95": [value - half, value + half]}


def effect(name: str, probability: float, group: str, closure: float) -> dict:
    size = {"mean": 0.11, "mode": 0.12, "ci95": [0.05, 0.17], "unit": "1"}
    return {
        "name": name,
        "probability": probability,
        "class": group,
        "parameters": {"size": size},
        "closure": estimate(closure),
    }


def location(feature: str, channel: str, phase: str, size: float, p: float) -> dict:
    return {
        "location": "all trials",
        "axis": "conditions",
        "feature": feature,
        "channel": channel,
        "phase": phase,
        "effect_size": size,
        "p_familywise": p,
        "trials": None,
    }


GAP = {"code": "gap", "values": {"p_size": 0.01, "p_direction": 0.02}}
CONTENT = {
    "campaign": {"name": "hand", "trials": 4, "tier": "T", "motions": 2, "sessions": 2},
    "gap": {
        "state": "found",
        "before": estimate(0.8),
        "after": estimate(0.3),
        "floor": estimate(0.2),
        "closure": estimate(0.83),
        "excess": estimate(0.6),
        "excess_after": estimate(0.1),
        "headline": estimate(0.5),
        "closure_resimulated": estimate(0.95),
        "layers": {"numerical": 0.02, "time_step": 0.03, "solver": None, "physical": None},
    },
    "where": [
        location("outcome", "outcome", "whole response", 0.6, 0.01),
        location("largest_tilt", "tilt", "strong shaking", -0.3, 0.5),
    ],
    "verdict": {"kind": "effect", "effects": ["wear"], "probability": 0.9, "reasons": [GAP]},
    "effects": [effect("wear", 0.8, "wear", 0.83), effect("catch", 0.05, "catch", 0.33)],
    "none_probability": 0.05,
    "conformal_set_90": ["wear"],
    "negative_control": {
        "effect": "catch",
        "closure": estimate(0.33),
        "recalibration": estimate(0.17),
        "loss": estimate(0.6),
        "recalibration_loss": estimate(0.7),
    },
    "unknown": {"probability": 0.1},
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
    "provenance": {},
}
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


def shapes(figure: str, tag: str) -> dict[str, ElementTree.Element]:
    """Shapes with a note, by it."""
    root = ElementTree.fromstring(figure)
    return {one[0].text: one for one in root.iter(tag) if len(one)}


def lines(figure: str) -> list[list[tuple[float, float]]]:
    root = ElementTree.fromstring(figure)
    return [
        [tuple(map(float, point.split(","))) for point in one.get("points").split()]
        for one in root.iter("polyline")
    ]


def test_the_bars_are_as_high_as_the_losses() -> None:
    bars = shapes(bars_figure(CONTENT), "rect")
    height = {text.split(":")[0]: float(one.get("height")) for text, one in bars.items()}
    unit = height["before"] / 0.8
    wanted = {
        "before": 0.8,
        "after": 0.3,
        "negative control": 0.6,
        "recalibrated": 0.7,
        "floor": 0.2,
    }
    assert height == pytest.approx({name: unit * v for name, v in wanted.items()}, abs=0.2)


def test_the_posterior_shows_every_hypothesis_and_the_set() -> None:
    bars = shapes(posterior_figure(CONTENT), "rect")
    assert set(bars) == {"wear: 0.800", "unknown: 0.100", "none: 0.050", "catch: 0.050"}
    assert float(bars["wear: 0.800"].get("width")) == pytest.approx(
        8 * float(bars["unknown: 0.100"].get("width")), rel=0.02
    )
    hollow = {text.split(":")[0] for text, one in bars.items() if one.get("fill") == "#fff"}
    assert hollow == {"unknown", "none", "catch"}


def test_the_map_fills_what_overturned_and_reddens_what_surprised() -> None:
    marks = shapes(map_figure(ROWS), "circle")
    by_trial = {text[0]: one for text, one in marks.items()}
    assert {name for name, one in by_trial.items() if one.get("fill") != "none"} == {"B", "C", "D"}
    red = {name for name, one in by_trial.items() if one.get("stroke") == "#c8553d"}
    assert red == {"A", "C", "D"}
    assert float(by_trial["A"].get("cx")) < float(by_trial["C"].get("cx"))
    assert float(by_trial["A"].get("r")) > float(by_trial["B"].get("r"))


def test_the_order_shows_observed_minus_predicted_and_the_sessions_means() -> None:
    figure = order_figure(ROWS)
    height = {text: float(one.get("cy")) for text, one in shapes(figure, "circle").items()}
    # Upwards is smaller: B and C, D overturned against lower predictions, A did not.
    assert height["C"] == height["D"] < height["B"] < height["A"]
    first, second = (points[0][1] for points in lines(figure))
    assert first == pytest.approx(0.5 * (height["A"] + height["B"]), abs=0.1)
    assert second == pytest.approx(height["C"], abs=0.1)


def test_channels_that_stand_out_are_filled() -> None:
    bars = shapes(channels_figure(CONTENT), "rect")
    filled = {text: one.get("fill") != "#fff" for text, one in bars.items()}
    assert filled == {
        "all trials: +0.60, family-wise p 0.010": True,
        "largest_tilt: all trials: -0.30, family-wise p 0.500": False,
    }
    left, right = (float(bars[text].get("x")) for text in reversed(list(filled)))
    assert left < right


def test_reliability_draws_before_as_crosses_and_after_as_dots() -> None:
    figure = reliability_figure(ROWS)
    crosses = [path[0].text for path in ElementTree.fromstring(figure).iter("path") if len(path)]
    assert crosses == ["before: 2 trials", "before: 2 trials"]
    dots = shapes(figure, "circle")
    assert set(dots) == {"after: 1 trials", "after: 3 trials"}
    # All three that the model with the effect gives 0.8 overturned, the one with 0.2 did not.
    assert float(dots["after: 3 trials"].get("cy")) < float(dots["after: 1 trials"].get("cy"))


def test_the_page_shows_the_numbers() -> None:
    page = diagnosis_page(Diagnosis(CONTENT, ROWS))
    text = re.sub(r"<[^>]+>", " ", page)
    for part in (
        "Closure 0.83 [0.82, 0.84]; negative control 0.33 [0.32, 0.34] (catch); recalibration 0.17",
        "Headline, closure minus the better of these, or 0: 0.50 [0.49, 0.51]",
        "The gap is 0.60 [0.59, 0.61] nat",
        "judged by simulations alone: closure 0.95 [0.94, 0.96].",
        "repeat trial T7, where wear and catch differ most; about 3 repeats would",
        "table gain  record the table beside the specimen",
        "drives the simulation  T8  4",
        "decay of rocking  T9  no number",
        "starts moved by 1e-6 to 1e-4 m and rad: 2.0%",
        "half the time step: 3.0%",
    ):
        assert part in text, part
    assert "twice the solver's iterations" not in text
    row = re.search(r"<tr><td>wear</td>.*?</tr>", page).group()
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells == [
        "wear",
        "0.800",
        "wear",
        "size 0.12, 0.11 [0.05, 0.17]",
        "0.83 [0.82, 0.84]",
    ]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, "wear explains the gap (90%): added, it closes 83% of the gap on motions"),
        ({"probability": 0.9988}, "(over 99%)"),
        ({"headline": -0.02}, "but not surely better than a wrong effect"),
        ({"closure": 0.005}, "but not surely better than a wrong effect"),
        (
            {"kind": "unresolved", "state": "size_open"},
            "There are signs of a gap, but its size is not told from zero; the leading candidate "
            "is wear.",
        ),
        ({"kind": "unresolved", "state": "not_found"}, "Whether there is a gap is not resolved;"),
        ({"kind": "unresolved"}, "There is a gap, but its cause is not resolved; the leading"),
        (
            {"kind": "unresolved", "outside": 0.97},
            "its cause is not resolved; most probable is a cause outside the library (97%), before "
            "wear.",
        ),
        ({"kind": "class", "names": ["wear", "catch"]}, "does not decide between them"),
        ({"kind": "class", "names": ["wear", "catch"], "one": True}, "cannot tell them apart"),
        ({"kind": "unknown", "probability": 0.4}, "no effect of the library explains it (40%)"),
        ({"kind": "none", "names": []}, "but residuals stand out: all trials (family-wise p 0.01)"),
        (
            {"kind": "none", "names": [], "where": [], "probability": 0.23},
            "gives no reason to change the model, and does not exclude what is too weak to show "
            "(none: 23%).",
        ),
    ],
)
def test_the_sentence_claims_no_more_than_the_numbers(changes, sentence) -> None:
    verdict = CONTENT["verdict"] | {
        "kind": changes.get("kind", "effect"),
        "effects": changes.get("names", ["wear"]),
        "probability": changes.get("probability", 0.9),
    }
    gap = CONTENT["gap"] | {"state": changes.get("state", "found")}
    for name in ("closure", "headline"):
        if name in changes:
            gap[name] = estimate(changes[name])
    effects = [dict(row) for row in CONTENT["effects"]]
    if changes.get("one"):
        effects[1]["class"] = "wear"
    content = CONTENT | {"verdict": verdict, "gap": gap, "effects": effects}
    content["where"] = changes.get("where", CONTENT["where"])
    content["unknown"] = {"probability": changes.get("outside", 0.1)}
    assert sentence in verdict_sentence(content)


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


def test_locations_without_measures_are_stated() -> None:
    blank = [row | {"log_pga": math.nan} for row in ROWS]
    assert map_figure(blank) == "<p>No trial has intensity measures.</p>"
