"""Figures of the diagnosis page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from vsr2.diagnosis.where.scan import EVERYWHERE
from vsr2.report.messages import location
from vsr2.report.svg import Chart

Rows = Sequence[Mapping[str, Any]]

_COLOURS = ("#1f6f8b", "#c8553d", "#7a5195", "#5b8c5a", "#b8860b", "#5b6675")
_CLASSES = (*_COLOURS, "#d46a9f", "#2f3e75", "#4fb3a5", "#8c5a3c")
"""As many as hypotheses are shown, so that no two classes share one."""
_SURPRISED, _CALM = "#c8553d", "#9aa5b1"
_GRAVITY = 9.81
_LEVEL = 0.05
_LETTER = 6.2
"""Width of a label's letter, on average."""


def posterior_figure(content: Mapping[str, Any]) -> str:
    """Probability of the leading hypotheses, coloured by class."""
    rows = [
        {"name": "none", "probability": content["none_probability"], "class": "none"},
        {
            "name": "unknown",
            "probability": content["unknown"]["probability"],
            "class": "unknown",
        },
        *content["effects"],
    ]
    rows.sort(key=lambda row: -row["probability"])
    shown = rows[: len(_CLASSES)]
    inside = set(content["conformal_set_90"])
    order = list(dict.fromkeys(row["class"] for row in shown))
    chart = Chart(
        "probability of each hypothesis",
        "probability",
        "",
        (0.0, 1.0),
        (len(shown), 0.0),
        height=60 + 24 * len(shown),
        left=150,
    )
    for i, row in enumerate(shown):
        colour = _CLASSES[order.index(row["class"])]
        fill = colour if row["name"] in inside else "#fff"
        chart.bar(
            0.0,
            max(row["probability"], 0.004),
            i + 0.2,
            i + 0.8,
            f'fill="{fill}" stroke="{colour}"',
            f"{row['name']}: {row['probability']:.3f}",
        )
    labels = [(i + 0.5, row["name"].replace("_", " ")) for i, row in enumerate(shown)]
    return chart.render(y_ticks=labels)


def bars_figure(content: Mapping[str, Any]) -> str:
    """Losses before and after, the floor, and the negative control's as far as closures tell it."""
    gap, negative_control = content["gap"], content["negative_control"]
    bars: list[tuple[str, Mapping[str, Any], str]] = [
        ("before", gap["before"], _COLOURS[1]),
        ("after", gap["after"], _COLOURS[0]),
        ("negative control", negative_control["loss"], _COLOURS[5]),
        ("recalibrated", negative_control["recalibration_loss"], _COLOURS[5]),
        ("floor", gap["floor"], "#9aa5b1"),
    ]
    top = max(max(bar[1]["ci95"][1], bar[1]["value"]) for bar in bars) * 1.08
    low = min(0.0, *(bar[1]["ci95"][0] for bar in bars))
    chart = Chart("mean loss", "", "loss a trial [nat]", (0.0, len(bars)), (low, max(top, 1e-3)))
    for i, (name, estimate, colour) in enumerate(bars):
        chart.bar(
            i + 0.18,
            i + 0.82,
            0.0,
            estimate["value"],
            f'fill="{colour}"',
            f"{name}: {estimate['value']:.3f}",
        )
        chart.line(
            [(i + 0.5, estimate["ci95"][0]), (i + 0.5, estimate["ci95"][1])],
            'stroke="#1c2430" stroke-width="1.6"',
        )
    return chart.render(x_ticks=[(i + 0.5, bar[0]) for i, bar in enumerate(bars)])


def map_figure(rows: Rows) -> str:
    """Loss over the floor in the plane of PGA and PGV/PGA."""
    points = [
        (row["log_pga"] - math.log(_GRAVITY), row["log_ratio"], row)
        for row in rows
        if math.isfinite(row["log_pga"]) and math.isfinite(row["log_ratio"])
    ]
    if not points:
        return "<p>No trial has intensity measures.</p>"
    x = _limits([p[0] for p in points])
    y = _limits([p[1] for p in points])
    chart = Chart("gap over conditions", "PGA [g]", "PGV/PGA [s]", x, y, height=330)
    for px, py, row in sorted(points, key=lambda p: p[2]["loss_before"] - p[2]["floor"]):
        extra = row["loss_before"] - row["floor"]
        colour = _SURPRISED if extra > 0.3 else _CALM
        size = 3.0 + 2.2 * math.sqrt(min(max(extra, 0.0), 6.0))
        fill = colour if row["overturned"] else "none"
        chart.circle(
            px,
            py,
            size,
            f'fill="{fill}" fill-opacity="0.65" stroke="{colour}" stroke-width="1.4"',
            f"{row['trial']}: p {row['before']:.2f}, "
            f"{'overturned' if row['overturned'] else 'stood'}",
        )
    return chart.render(x_ticks=_log_ticks(x), y_ticks=_log_ticks(y))


def order_figure(rows: Rows) -> str:
    """Residuals over the order of execution, with each session's mean."""
    used = [row for row in rows if row["uncertain"]]
    orders = [float(row["order"]) for row in rows]
    chart = Chart(
        "residuals over order",
        "order of execution",
        "observed - predicted",
        (min(orders), max(max(orders), min(orders) + 1)),
        (-1.05, 1.05),
    )
    sessions: dict[str, list[Mapping[str, Any]]] = {}
    for row in used:
        sessions.setdefault(row["session"], []).append(row)
        chart.circle(
            row["order"],
            row["overturned"] - row["before"],
            3.2,
            f'fill="{_CALM}" fill-opacity="0.8"',
            row["trial"],
        )
    for members in sessions.values():
        mean = sum(r["overturned"] - r["before"] for r in members) / len(members)
        first, last = members[0]["order"], members[-1]["order"]
        chart.line(
            [(first, mean), (max(last, first + 1), mean)],
            f'stroke="{_COLOURS[1]}" stroke-width="3"',
        )
    return chart.render()


def channels_figure(content: Mapping[str, Any]) -> str:
    """Mean standardised residual of each channel and phase over all trials."""
    whole = [row for row in content["where"] if row["location"] == EVERYWHERE]
    order = {"whole response": 0, "uplift": 1, "first impacts": 2, "strong shaking": 3}
    order |= {"free decay": 4, "rest pose": 5}
    rows = sorted(whole, key=lambda row: order.get(row["phase"], 9))
    reach = 1.15 * max([0.25, *(abs(row["effect_size"]) for row in rows)])
    names = [row["feature"].replace("_", " ") for row in rows]
    labels = [f"{name} ({row['phase']})" for name, row in zip(names, rows, strict=True)]
    chart = Chart(
        "gap over channels and phases",
        "mean residual [standard deviations]",
        "",
        (-reach, reach),
        (len(rows), 0.0),
        height=60 + 30 * max(len(rows), 2),
        left=round(30 + _LETTER * max(map(len, labels), default=0)),
    )
    chart.line([(0.0, 0.0), (0.0, float(len(rows)))], 'stroke="#9aa5b1"')
    for i, row in enumerate(rows):
        found = row["p_familywise"] <= _LEVEL
        colour = _SURPRISED if found else _CALM
        size = row["effect_size"]
        chart.bar(
            min(size, 0.0),
            max(size, 0.0),
            i + 0.25,
            i + 0.75,
            f'fill="{colour if found else "#fff"}" stroke="{colour}"',
            f"{location(row)}: {size:+.2f}, family-wise p {row['p_familywise']:.3f}",
        )
    return chart.render(y_ticks=[(i + 0.5, label) for i, label in enumerate(labels)])


def reliability_figure(rows: Rows) -> str:
    """Observed share against predicted probability, before and after."""
    chart = Chart(
        "predicted against observed",
        "predicted probability of overturning (x before, o after)",
        "share overturned",
        (0.0, 1.0),
        (0.0, 1.0),
    )
    chart.line([(0, 0), (1, 1)], 'stroke="#9aa5b1" stroke-dasharray="4 4"')
    edges = [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0001]
    for column, colour, mark in (("before", _COLOURS[1], "cross"), ("after", _COLOURS[0], "dot")):
        points = []
        for low, high in pairwise(edges):
            members = [row for row in rows if low <= row[column] < high]
            if not members:
                continue
            p = sum(row[column] for row in members) / len(members)
            y = sum(row["overturned"] for row in members) / len(members)
            points.append((p, y, len(members)))
        chart.line([(p, y) for p, y, _ in points], f'stroke="{colour}" stroke-opacity="0.5"')
        for p, y, count in points:
            size = 3 + min(math.sqrt(count), 8)
            draw = chart.cross if mark == "cross" else chart.circle
            css = f'stroke="{colour}"' if mark == "cross" else f'fill="{colour}"'
            draw(p, y, size, css, f"{column}: {count} trials")
    return chart.render()


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    margin = 0.06 * max(high - low, 0.1)
    return low - margin, high + margin


def _log_ticks(limits: tuple[float, float]) -> list[tuple[float, str]]:
    def within(steps: Sequence[float]) -> list[tuple[float, str]]:
        values = [step * 10.0**k for k in range(-4, 4) for step in steps]
        return [(math.log(v), f"{v:g}") for v in values if limits[0] <= math.log(v) <= limits[1]]

    few = within((1, 2, 5))
    return few if len(few) > 2 else within((1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9))
