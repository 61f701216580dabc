"""Figures of the diagnosis page."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from vsr2.diagnosis.where.scan import SCAN, LocationKind
from vsr2.ensemble.observed.features import Phase
from vsr2.report.messages.figure_titles import NO_MEASURES
from vsr2.report.messages.verdicts import location, phase
from vsr2.report.pages import plain
from vsr2.report.panels import legend_below, scale_axis, sheet, tooltip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]

BLUE, RED, GREY, INK = "#1f6f8b", "#c8553d", "#9aa5b1", "#1c2430"
_BREAK = "-\n"
"""Of a long name under a bar."""
_SIZE = (5.2, 3.5)
"""Of a figure that fills one column of the page [inch]."""


@dataclass(frozen=True)
class FigureConstants:
    """What figures show; chosen by hand.

    Attributes:
        surprise: loss over the floor from which a trial counts as surprising [nat].
        shown: hypotheses in a figure.
    """

    surprise: float = 0.3
    shown: int = 10


FIGURES = FigureConstants()


def sets_figure(content: Mapping[str, Any]) -> Figure:
    """Probability of the most probable sets of effects."""
    return _probabilities(
        {
            " + ".join(row["effects"]) or "none": row["probability"]
            for row in content["sets"][: FIGURES.shown]
        },
        "probability of exactly this [1]",
    )


def effects_figure(content: Mapping[str, Any]) -> Figure:
    """Probability that each effect acts, alone or with others, and which are in the 90 % set."""
    rows = {row["name"]: row["acts"] for row in content["effects"]}
    rows |= {
        "none": content["none_probability"],
        "unknown": content["unknown"]["probability"],
    }
    leading = dict(sorted(rows.items(), key=lambda row: -row[1])[: FIGURES.shown])
    inside = set(content["conformal_set_90"])
    figure = _probabilities(leading, "probability that it acts [1]", inside)
    _legend(figure, {"in the 90 % set": (BLUE, BLUE), "outside it": ("none", BLUE)})
    return figure


def _probabilities(
    rows: Mapping[str, float], label: str, filled: Collection[str] | None = None
) -> Figure:
    """Bars by name, hollow where not in `filled`."""
    figure, panel = _panel((5.2, 1.2 + 0.25 * len(rows)))
    bars = panel.barh(
        [plain(name) for name in rows],
        list(rows.values()),
        height=0.6,
        color=[BLUE if filled is None or name in filled else "none" for name in rows],
        edgecolor=BLUE,
    )
    for bar, (name, probability) in zip(bars, rows.items(), strict=True):
        tooltip(bar, f"{name}: {probability:.3f}")
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.0)
    panel.set_xlabel(label)
    return figure


def losses_figure(content: Mapping[str, Any]) -> Figure:
    """Loss before and after, under both negative controls, and of gap-free campaigns."""
    gap, control = content["gap"], content["negative_control"]
    found = {
        "before": (gap["before"], RED),
        "after": (gap["after"], BLUE),
        f"recali{_BREAK}brated": (control["recalibrated"]["loss"], "#5b6675"),
        "dealt": (control["dealt"]["loss"], "#5b6675"),
        "floor": (gap["floor"], GREY),
    }
    figure, panel = _panel((5.2, 2.6))
    for name, (estimate, colour) in found.items():
        if estimate["value"] is None:
            continue
        [bar] = panel.bar(name, estimate["value"], width=0.64, color=colour)
        tooltip(bar, f"{name.replace(_BREAK, '')}: {_with_interval(estimate)}")
        [interval] = panel.plot([name] * 2, estimate["ci95"], color=INK, linewidth=1.4)
    interval.set_label("95 % interval")
    panel.set_ylabel("loss a trial [nat]")
    panel.grid(axis="x", visible=False)
    _legend(figure)
    return figure


def _with_interval(estimate: Mapping[str, Any]) -> str:
    low, high = estimate["ci95"]
    return f"{estimate['value']:.3f} [{low:.3f}, {high:.3f}] nat"


def waterfall_figure(content: Mapping[str, Any]) -> Figure:
    """Loss as simulated, after each cause in turn, with all of the posterior, and the floor."""
    falls = content["waterfall"]
    steps = [("as simulated", falls["steps"][0]["loss"], RED)]
    steps += [(f"+ {plain(one['effects'][-1])}", one["loss"], BLUE) for one in falls["steps"][1:]]
    steps += [("+ all others", falls["everything"], BLUE), ("floor", falls["floor"], GREY)]
    figure, panel = _panel((5.2, 0.9 + 0.34 * len(steps)))
    for name, estimate, colour in steps:
        [bar] = panel.barh(name, estimate["value"], height=0.64, color=colour)
        tooltip(bar, f"{name}: {_with_interval(estimate)}")
        [interval] = panel.plot(estimate["ci95"], [name] * 2, color=INK, linewidth=1.4)
    interval.set_label("95 % interval")
    panel.invert_yaxis()
    panel.set_xlabel("loss a trial [nat]")
    panel.grid(axis="y", visible=False)
    _legend(figure)
    return figure


def map_figure(rows: Rows) -> Figure:
    """Loss over the floor in the plane of PGA and PGV/PGA."""
    known = [r for r in rows if math.isfinite(r["log_pga_g"]) and math.isfinite(r["log_pgv_pga_s"])]
    figure, panel = _panel((5.2, 4.0))
    panel.set_xlabel("PGA [g]")
    panel.set_ylabel("PGV/PGA [s]")
    if not known:
        panel.set_axis_off()
        panel.text(0.5, 0.5, NO_MEASURES, ha="center")
        return figure
    labels = set()
    for row in sorted(known, key=_extra):
        extra = _extra(row)
        colour = RED if extra > FIGURES.surprise else GREY
        ending = "overturned" if row["overturned"] else "stood"
        label = f"{ending}, {'a surprise' if extra > FIGURES.surprise else 'no surprise'}"
        [mark] = panel.plot(
            math.exp(row["log_pga_g"]),
            math.exp(row["log_pgv_pga_s"]),
            "o",
            # In steps, because equal marks are stored once in a drawing.
            markersize=round(4.0 + 3.2 * math.sqrt(min(max(extra, 0.0), 6.0))),
            markerfacecolor=colour if row["overturned"] else "none",
            markeredgecolor=colour,
            alpha=0.75,
            label="_" if label in labels else label,
        )
        labels.add(label)
        tooltip(mark, f"{row['trial']}: p {row['before']:.2f}, {ending}")
    scale_axis(panel, "x")
    scale_axis(panel, "y")
    _legend(figure, columns=2)
    return figure


def _extra(row: Mapping[str, Any]) -> float:
    """Loss over the floor; 0 of a trial that never lifts off."""
    return row["loss_before"] - row["floor"] if row["uncertain"] else 0.0


def order_figure(rows: Rows) -> Figure:
    """Residuals over the order of execution, with each session's mean."""
    figure, panel = _panel()
    sessions: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["uncertain"]:
            sessions.setdefault(row["session"], []).append(row)
            residual = row["overturned"] - row["before"]
            [mark] = panel.plot(row["order"], residual, "o", color=GREY, markersize=4)
            tooltip(mark, f"{row['trial']}: {residual:+.2f}")
    for members in sessions.values():
        mean = sum(r["overturned"] - r["before"] for r in members) / len(members)
        first, last = members[0]["order"], members[-1]["order"]
        [line] = panel.plot([first, max(last, first + 1)], [mean] * 2, color=RED, linewidth=2.5)
        tooltip(line, f"session {members[0]['session']}: mean {mean:+.2f}")
    if sessions:
        mark.set_label("trial that lifts off")
        line.set_label("mean of a session")
        _legend(figure)
    panel.set_ylim(-1.05, 1.05)
    panel.set_xlabel("order of execution [trials]")
    panel.set_ylabel("observed - predicted [1]")
    return figure


def channels_figure(content: Mapping[str, Any]) -> Figure:
    """Mean standardised residual of each channel and phase over all trials."""
    rows = [row for row in content["where"] if row["location"]["kind"] == LocationKind.ALL_TRIALS]
    phases = list(Phase)
    rows.sort(key=lambda row: phases.index(Phase(row["phase"])))
    figure, panel = _panel((5.2, 1.2 + 0.32 * max(len(rows), 2)))
    for i, row in enumerate(rows):
        found = row["p_familywise"] <= SCAN.significant
        colour = RED if found else GREY
        size = row["effect_size"]
        [bar] = panel.barh(i, size, 0.5, color=colour if found else "none", edgecolor=colour)
        tooltip(bar, f"{location(row)}: {size:+.2f}, family-wise p {row['p_familywise']:.3f}")
    panel.set_yticks(
        range(len(rows)),
        [f"{plain(row['feature'])} ({phase(row['phase'])})" for row in rows],
    )
    panel.axvline(0.0, color=GREY, linewidth=1.0)
    panel.invert_yaxis()
    reach = 1.15 * max([0.25, *(abs(row["effect_size"]) for row in rows)])
    panel.set_xlim(-reach, reach)
    panel.set_xlabel("mean residual [standard deviations]")
    _legend(figure, {"significant": (RED, RED), "not significant": ("none", GREY)})
    return figure


def reliability_figure(rows: Rows) -> Figure:
    """Observed share against predicted probability, before and after."""
    figure, panel = _panel()
    panel.plot([0, 1], [0, 1], "--", color=GREY, label="ideal")
    for column, colour, marker in (("before", RED, "x"), ("after", BLUE, "o")):
        points = []
        for low, high in pairwise((0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0001)):
            members = [row for row in rows if low <= row[column] < high]
            if not members:
                continue
            count = len(members)
            p = sum(row[column] for row in members) / count
            y = sum(row["overturned"] for row in members) / count
            points.append((p, y))
            size = 6 + min(math.sqrt(count), 8)
            trials = f"{count} trial{'s' * (count > 1)}"
            [mark] = panel.plot(p, y, marker, color=colour, markersize=size, markeredgewidth=1.8)
            tooltip(mark, f"{column}: {trials}, predicted {p:.2f}, observed {y:.2f}")
        label = f"{column} ({'crosses' if marker == 'x' else 'dots'})"
        panel.plot(*zip(*points, strict=True), color=colour, alpha=0.5, label=label)
    panel.set_xlim(-0.04, 1.04)
    panel.set_ylim(-0.04, 1.04)
    panel.set_xlabel("predicted probability of overturning [1]")
    panel.set_ylabel("share overturned [1]")
    _legend(figure)
    return figure


def _panel(size: tuple[float, float] = _SIZE) -> tuple[Figure, Axes]:
    figure, axes = sheet(1, 1, size)
    return figure, axes[0, 0]


def _legend(
    figure: Figure, patches: Mapping[str, tuple[str, str]] | None = None, columns: int = 3
) -> None:
    """Below the panel, of what is labelled in it or of `patches`: face and edge by label."""
    from matplotlib.patches import Patch

    handles = figure.axes[0].get_legend_handles_labels()[0]
    for label, (face, edge) in (patches or {}).items():
        handles.append(Patch(facecolor=face, edgecolor=edge, label=label))
    legend_below(figure, columns, handles, "medium")
