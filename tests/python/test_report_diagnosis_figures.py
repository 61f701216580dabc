"""Figures of the diagnosis page."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from diagnosis_content import (
    CONTENT,
    NONE_CAN_BE,
    ROWS,
    effect,
)
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
from vsr2.report.panels import svg


def marks(figure: Figure) -> dict[str, Any]:
    """Marks of the figure by the text that a browser shows on them."""
    [panel] = figure.axes
    found = {
        artist.get_gid().removeprefix("tooltip-"): artist
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
        "waterfall": None,
        "negative_control": {"recalibrated": bare, "dealt": bare},
    }
    assert list(marks(losses_figure(content))) == [
        "before: 0.800 [0.790, 0.810] nat",
        "floor: 0.200 [0.190, 0.210] nat",
    ]


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
    assert at(by_trial["A"]) == pytest.approx((math.e, math.exp(-1.9)))
    assert by_trial["A"].get_markersize() > by_trial["B"].get_markersize()


def test_the_order_shows_observed_minus_predicted_and_the_sessions_means() -> None:
    figure = order_figure(ROWS)
    marked = marks(figure)
    wanted = {"A: -0.90": (1, -0.9), "B: +0.10": (2, 0.1), "C: +0.90": (3, 0.9)}
    wanted |= {"D: +0.90": (4, 0.9)}
    found = {text: at(marked.pop(text)) for text in wanted}
    assert found == {name: pytest.approx(xy) for name, xy in wanted.items()}
    assert list(marked) == ["session s1: mean -0.40", "session s2: mean +0.90"]
    means = list(marked.values())
    assert [list(line.get_xdata()) for line in means] == [[1, 2], [3, 4]]
    assert [line.get_ydata()[0] for line in means] == pytest.approx([-0.4, 0.9])


def test_channels_that_stand_out_are_filled() -> None:
    bars = marks(channels_figure(CONTENT))
    filled = {text: bar.get_facecolor()[3] > 0 for text, bar in bars.items()}
    assert filled == {
        "all trials: +0.60, family-wise p 0.010": True,
        "largest tilt: all trials: -0.30, family-wise p 0.500": False,
    }
    assert [bar.get_width() for bar in bars.values()] == [0.6, -0.3]


def test_reliability_draws_before_as_crosses_and_after_as_dots() -> None:
    points = [
        (mark.get_marker(), mark.get_gid().removeprefix("tooltip-"), at(mark))
        for mark in reliability_figure(ROWS).axes[0].lines
        if mark.get_gid()
    ]
    # All three that the model with the effect gives 0.8 overturned, the one with 0.2 did not.
    assert points == [
        ("x", "before: 2 trials, predicted 0.10, observed 1.00", pytest.approx((0.1, 1.0))),
        ("x", "before: 2 trials, predicted 0.90, observed 0.50", pytest.approx((0.9, 0.5))),
        ("o", "after: 1 trial, predicted 0.20, observed 0.00", pytest.approx((0.2, 0.0))),
        ("o", "after: 3 trials, predicted 0.80, observed 1.00", pytest.approx((0.8, 1.0))),
    ]


def test_a_drawing_is_xml_with_its_tooltips_and_always_the_same() -> None:
    rows = [row | {"trial": f'<b>{row["trial"]}</b> & "co"'} for row in ROWS]
    drawing = svg(order_figure(rows), 'a "map" of <what>')
    root = ElementTree.fromstring(drawing)
    assert root.get("aria-label") == 'a "map" of <what>'
    assert root.get("viewBox")
    assert root.get("width") is None
    titles = [one.text for one in root.iter("{http://www.w3.org/2000/svg}title")]
    assert [title.rpartition(":")[0] for title in titles[: len(rows)]] == [
        row["trial"] for row in rows
    ]
    assert svg(order_figure(rows), 'a "map" of <what>') == drawing


def test_trials_that_never_lift_off_are_no_surprise() -> None:
    still = {"uncertain": 0, "before": math.nan, "loss_before": math.nan, "floor": math.nan}
    rows = [ROWS[0] | still, *ROWS[1:]]
    by_trial = {text[0]: mark for text, mark in marks(map_figure(rows)).items()}
    assert by_trial["A"].get_markeredgecolor() == GREY
    assert "A" not in marks(order_figure(rows))
