"""The diagnosis page and its figures say what the numbers say: content made by hand."""

from __future__ import annotations

import math
import re
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.report.diagnosis import diagnosis_page
from vsr2.report.diagnosis_figures import (
    RED,
    bars_figure,
    channels_figure,
    map_figure,
    order_figure,
    posterior_figure,
    reliability_figure,
)
from vsr2.report.messages.verdicts import verdict_sentence
from vsr2.report.panels import svg


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
    figure = bars_figure(CONTENT)
    height = {text.split(":")[0]: bar.get_height() for text, bar in marks(figure).items()}
    wanted = {
        "before": 0.8,
        "after": 0.3,
        "negative control": 0.6,
        "recalibrated": 0.7,
        "floor": 0.2,
    }
    assert height == wanted
    ends = [line.get_ydata() for line in figure.axes[0].lines]
    assert ends == [pytest.approx([v - 0.01, v + 0.01]) for v in wanted.values()]
    assert figure.axes[0].get_ylabel() == "loss a trial [nat]"


def test_the_posterior_shows_every_hypothesis_and_the_set() -> None:
    figure = posterior_figure(CONTENT)
    bars = marks(figure)
    assert list(bars) == ["wear: 0.800", "unknown: 0.100", "none: 0.050", "catch: 0.050"]
    assert [bar.get_width() for bar in bars.values()] == [0.8, 0.1, 0.05, 0.05]
    hollow = {text.split(":")[0] for text, bar in bars.items() if bar.get_facecolor()[3] == 0}
    assert hollow == {"unknown", "none", "catch"}
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == [
        "wear", "unknown", "none", "catch",
    ]  # fmt: skip
    top, bottom = (figure.axes[0].transData.transform((0, y))[1] for y in (0, 3))
    assert top > bottom, "the most probable is not on top"


def test_the_bars_of_two_classes_never_share_a_colour() -> None:
    many = [effect(f"e{i}", 0.05, f"e{i}", 0.1) for i in range(12)]
    bars = marks(posterior_figure({**CONTENT, "effects": many}))
    assert len({bar.get_edgecolor() for bar in bars.values()}) == len(bars) == 10


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
        "Closure 0.83 [0.82, 0.84]; negative control 0.33 [0.32, 0.34] (catch); recalibration 0.17",
        "Headline, closure minus the better of these, or 0: 0.50 [0.49, 0.51]",
        "The gap is 0.60 [0.59, 0.61] nat",
        "judged by simulations alone: closure 0.95 [0.94, 0.96].",
        "repeat trial T7, where wear and catch differ most; about 3 repeats would",
        "table gain record the table beside the specimen",
        "drives the simulation T8 4",
        "decay of rocking T9 no number",
        "starts moved by 1e-6 to 1e-4 m and rad: 2.0%",
        "half the time step: 3.0%",
    ):
        assert part in text, part
    assert "twice the solver's iterations" not in text
    row = re.search(r"<tr><td>wear</td>.*?</tr>", page, re.DOTALL).group()
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
            "There are signs of a gap, but its size is not distinguished from zero; the leading "
            "candidate is wear.",
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


def test_trials_without_measures_are_told() -> None:
    [panel] = map_figure([row | {"log_pga": math.nan} for row in ROWS]).axes
    assert [text.get_text() for text in panel.texts] == ["no trial has intensity measures"]


def test_hostile_names_stay_text() -> None:
    bad = "<script>alert('x')</script>"
    rows = [row | {"trial": bad, "session": bad} for row in ROWS]
    repetition = {"trial": bad, "information_per_repeat": 1.0, "repeats": 1}
    measure = CONTENT["next_measurement"] | {"repetition": repetition, "splits": [bad, "wear"]}
    measure["others"] = [{"name": bad, "instrument": "slack", "repetition": repetition}]
    measure["out_of_library"] = {"trial": bad, "tier": "M", "location": bad}
    content = CONTENT | {
        "campaign": CONTENT["campaign"] | {"name": bad, "tier": bad},
        "verdict": CONTENT["verdict"] | {"effects": [bad]},
        "effects": [effect(bad, 0.8, bad, 0.83)],
        "conformal_set_90": [bad],
        "negative_control": CONTENT["negative_control"] | {"effect": bad},
        "where": [location(bad, bad, bad, 0.6, 0.01)],
        "next_measurement": measure,
        "provenance": {bad: bad},
    }
    content["effects"][0]["parameters"] = {bad: content["effects"][0]["parameters"]["size"]}
    page = diagnosis_page(Diagnosis(content, tuple(rows)))
    assert "<script" not in page.lower()
    assert page.count("&lt;script&gt;") > 15
