"""A fragility study for people: overturning diagrams, curves, surfaces, azimuths, and a page."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsr2.fragility.run import FragilityResult
from vsr2.fragility.settings import MEASURE_LABELS
from vsr2.one_line import counted
from vsr2.report.figures import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION
from vsr2.report.messages.figure_titles import FRAGILITY_CAPTIONS, curve_caption, curve_title
from vsr2.report.messages.runs import fit_caveats, fit_note
from vsr2.report.pages import render
from vsr2.report.panels import legend_below, scale_where_wide, sheet, write_page
from vsr2.report.text import markdown_table

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_PANELS = 12
"""Curves that are drawn; more cannot be distinguished."""
BINS = 10
"""Of the observed shares beside a curve."""
SHADES = "Blues"
"""Of probabilities: light to dark, in print without colours, too."""

LINES = {0.16: (SKY, "-."), 0.5: (VERMILION, "-"), 0.84: (ORANGE, ":")}
"""Probabilities that a surface shows as lines, with colour and style: seen on every shade."""

Array = NDArray[np.float64]


def write_fragility_report(result: FragilityResult, folder: str | Path) -> list[Path]:
    """Draw the figures and write `report.md`.

    Returns:
        The files written, the page last.

    Raises:
        ResultError: one cannot be written.
    """
    captions = FRAGILITY_CAPTIONS
    drawn = {"overturning": (overturning_figure(result), captions["overturning"])}
    for name in result.curves:
        caption = curve_caption(MEASURE_LABELS[name])
        drawn[f"curve_{name}"] = (curve_figure(result, name), caption)
    if result.surface is not None:
        drawn["surface"] = (surface_figure(result), captions["surface"])
    if result.azimuth_curves:
        drawn["azimuth"] = (azimuth_figure(result), captions["azimuth"])
    return write_page(folder, drawn, partial(fragility_page, result))


def overturning_figure(result: FragilityResult) -> Figure:
    """Share of overturned trials at each (PGV/PGA, PGA), a panel an azimuth.

    One marker a motion; its colour is the share of its replicates that overturned.
    """
    azimuths = list(dict.fromkeys(result.azimuth.tolist()))[:MAX_PANELS]
    columns = 2 if len(azimuths) == 4 else min(3, len(azimuths))
    rows = math.ceil(len(azimuths) / columns)
    width = 5.6 if len(azimuths) == 1 else 3.0 * columns + 1.0
    figure, axes = sheet(rows, columns, (width, 4.2 if rows == 1 == columns else 2.8 * rows + 0.5))
    used = result.used & (result.measures["pga_g"] > 0) & (result.measures["pgv_pga_s"] > 0)
    marks = None
    for panel, azimuth in zip(axes.flat, azimuths, strict=False):
        chosen = used & (result.azimuth == azimuth)
        x, y, share = _shares(result, chosen)
        size = float(np.clip(2500.0 / max(1, x.size), 12.0, 45.0))
        marks = panel.scatter(
            x, y, c=share, s=size, cmap=SHADES, vmin=0, vmax=1,
            edgecolor=BLACK, linewidth=0.3, zorder=3,
        )  # fmt: skip
        scale_where_wide(panel, "x", x)
        scale_where_wide(panel, "y", y)
        if len(azimuths) > 1:
            panel.set_title(f"azimuth {azimuth:g} deg", fontsize="small")
    for panel in axes.flat[len(azimuths) :]:
        panel.set_visible(False)
    for panel in axes[:, 0]:
        panel.set_ylabel("PGA [g]")
    for column in range(columns):
        axes[(len(azimuths) - 1 - column) // columns, column].set_xlabel("PGV/PGA [s]")
    if marks is not None:
        _one_mark(axes[0, 0])
        figure.colorbar(marks, ax=axes.ravel().tolist(), label="share overturned [1]", shrink=0.8)
        legend_below(figure, 1)
    return figure


def _one_mark(panel: Axes) -> None:
    """An entry for the legend that stands for all marks, whose colours the colour bar explains."""
    panel.plot(
        [], [], "o", markerfacecolor="none", markeredgecolor=BLACK, markersize=5,
        label="one ground motion, with all its replicates",
    )  # fmt: skip


def _shares(result: FragilityResult, chosen: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """PGV/PGA, PGA and share of overturned trials of each motion as driven."""
    x, y = result.measures["pgv_pga_s"][chosen], result.measures["pga_g"][chosen]
    levels, member = np.unique(np.stack([x, y], axis=1), axis=0, return_inverse=True)
    member = member.ravel()
    count = np.bincount(member, minlength=len(levels))
    hits = np.bincount(member, weights=result.overturned[chosen], minlength=len(levels))
    return levels[:, 0], levels[:, 1], hits / count


def curve_figure(result: FragilityResult, name: str) -> Figure:
    """The curve in one measure with its band, and the shares observed along it.

    Shares are of up to ten groups of trials, with their 95 % Wilson interval; each
    trial is a tick at the top (overturned) or bottom (stood).
    """
    fit = result.curves[name]
    figure, axes = sheet(1, 1, (4.6, 3.4))
    panel = axes[0, 0]
    levels = fit.grid(201)
    probability, lower, upper = fit.probability(levels)
    x = levels[:, 0]
    # First, so that ticks and groups are not hidden.
    panel.fill_between(x, lower, upper, color=SKY, alpha=0.45, linewidth=0, zorder=2,
                       label=f"{100 * result.settings.level:g} % band")  # fmt: skip
    panel.plot(x, probability, color=BLUE, zorder=3, label="fit")
    values = result.measures[name][result.used]
    overturned = result.overturned[result.used]
    middle, share, ends = observed_shares(values, overturned)
    panel.errorbar(
        middle, share, yerr=np.abs(ends - share), fmt="o", color=BLACK, markersize=3.5,
        elinewidth=0.8, capsize=1.5, zorder=4,
        label="share of a group, 95 % interval",
    )  # fmt: skip
    for hit, y in ((True, 1.03), (False, -0.03)):
        panel.plot(
            values[overturned == hit], np.full(int((overturned == hit).sum()), y), "|",
            color=VERMILION if hit else GREY, markersize=4, markeredgewidth=0.5,
            label="trial that overturned" if hit else "trial that stood",
        )  # fmt: skip
    scale_where_wide(panel, "x", x)
    panel.set_ylim(-0.06, 1.06)
    panel.set_xlabel(MEASURE_LABELS[name])
    panel.set_ylabel("probability of overturning [1]")
    panel.set_title(curve_title(fit), fontsize="small")
    legend_below(figure, 3, size="x-small")
    return figure


def observed_shares(values: Array, overturned: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Shares of overturned trials in groups along a measure.

    Each level is a group where there are up to ten; else groups have equally many trials.

    Returns:
        Geometric mean of the measure (g,), share (g,), and the ends of Wilson's 95 % interval
        (2, g).
    """
    from scipy.stats import binomtest

    # Levels that differ by rounding alone are one.
    levels, member = np.unique(np.round(np.log(values), 6), return_inverse=True)
    if levels.size <= BINS:
        groups = [np.flatnonzero(member == i) for i in range(levels.size)]
    else:
        order = np.argsort(values, kind="stable")
        groups = np.array_split(order, min(BINS, max(1, values.size // 5)))
    middle = np.array([math.exp(float(np.log(values[group]).mean())) for group in groups])
    share = np.array([overturned[group].mean() for group in groups])
    hits = [int(overturned[group].sum()) for group in groups]
    ends = [
        binomtest(hit, group.size).proportion_ci(method="wilson")
        for hit, group in zip(hits, groups, strict=True)
    ]
    return middle, share, np.array(ends).T


def surface_figure(result: FragilityResult) -> Figure:
    """Probability over both measures, and the width of its band; dots are the motions.

    The lines of the left panel are `LINES`; dashed: where the band's ends are 0.5.
    Both panels are blank outside the simulated intensities.
    """
    fit = result.surface
    assert fit is not None
    count = 81
    levels = fit.grid(count)
    outside = ~fit.inside(levels).reshape(count, count)
    # PGA goes up, as in the overturning diagram, where it is one of the two.
    up = 0 if fit.names[0] == "pga_g" else 1
    across = 1 - up
    x, y = (levels[:, k].reshape(count, count) for k in (across, up))
    probability, lower, upper = (
        np.ma.masked_array(values.reshape(count, count), outside)
        for values in fit.probability(levels)
    )
    figure, axes = sheet(1, 2, (8.6, 3.6))
    width = upper - lower
    for panel, values, label, most in (
        (axes[0, 0], probability, "probability of overturning [1]", 1.0),
        (
            axes[0, 1],
            width,
            f"width of the {100 * result.settings.level:g} % band [1]",
            max(0.1, math.ceil(10 * float(width.max())) / 10),
        ),
    ):
        panel.grid(False)
        steps = round(10 * most)
        filled = panel.contourf(
            x,
            y,
            values,
            levels=np.linspace(0, most, 1 + (steps if steps > 4 else 2 * steps)),
            cmap=SHADES,
            extend="neither",
        )
        figure.colorbar(filled, ax=panel, label=label)
        points = np.unique(
            np.stack([result.measures[fit.names[k]][result.used] for k in (across, up)], axis=1),
            axis=0,
        )
        panel.plot(*points.T, ".", color=BLACK, markersize=2, clip_on=False, label="ground motion")
        scale_where_wide(panel, "x", points[:, 0])
        scale_where_wide(panel, "y", points[:, 1])
        panel.set_xlabel(MEASURE_LABELS[fit.names[across]])
        panel.set_ylabel(MEASURE_LABELS[fit.names[up]])
    panel = axes[0, 0]
    for level, (color, style) in LINES.items():
        if probability.min() < level < probability.max():
            panel.contour(
                x, y, probability, levels=[level], colors=color, linestyles=style, linewidths=1.4
            )
            # Contours have no entry of their own in a legend.
            panel.plot([], [], color=color, linestyle=style, label=f"probability {level:g}")
    for end in (lower, upper):
        if end.min() < 0.5 < end.max():
            panel.contour(
                x, y, end, levels=[0.5], colors=VERMILION, linewidths=0.8, linestyles="--"
            )
    panel.plot([], [], "--", color=VERMILION, linewidth=0.8, label="an end of the band is 0.5")
    legend_below(figure, 5)
    return figure


def azimuth_figure(result: FragilityResult) -> Figure:
    """Median and beta of the curve in each measure against azimuth, with their intervals."""
    names = list(result.curves)
    figure, axes = sheet(2, len(names), (4.4 * len(names), 4.6))
    handles: list[Artist] = []
    for column, name in enumerate(names):
        found = [
            (turn, fit.lognormal)
            for (other, turn), fit in result.azimuth_curves.items()
            if other == name and fit.lognormal is not None
        ]
        panels = axes[:, column]
        pooled = result.curves[name].lognormal
        for panel, key in zip(panels, ("median", "beta"), strict=True):
            if found:
                turns = np.array([turn for turn, _ in found])
                middle, low, high = (
                    np.array([getattr(one, key + end) for _, one in found])
                    for end in ("", "_lower", "_upper")
                )
                panel.errorbar(
                    turns, middle, yerr=[middle - low, high - middle], fmt="o-", color=BLUE,
                    markersize=4, elinewidth=0.9, capsize=2, label="each azimuth",
                )  # fmt: skip
                panel.set_ylim(0, _upper_limit(middle, high))
            if pooled is not None:
                panel.axhline(
                    getattr(pooled, key), color=VERMILION, linestyle="--", linewidth=1.0,
                    label="all azimuths",
                )  # fmt: skip
        panels[0].set_ylabel(f"median {MEASURE_LABELS[name]}")
        panels[1].set_ylabel("$\\beta$ [1]")
        panels[1].set_xlabel("azimuth [deg]")
        handles = handles or panels[0].get_legend_handles_labels()[0]
    if handles:
        legend_below(figure, 2, handles)
    return figure


def _upper_limit(middle: Array, high: Array) -> float:
    """An interval without end must not press all others together."""
    return float(1.1 * min(high.max(), 3.0 * middle.max()))


def fragility_page(result: FragilityResult, figures: dict[str, str]) -> str:
    """The report as Markdown."""
    study = result.provenance.get("study") or {}
    return render(
        "fragility.md",
        {"counted": counted},
        settings=result.settings,
        trials=len(result.planned),
        motions=len(set(result.motion.tolist())),
        azimuths=len(set(result.azimuth.tolist())),
        overturned=int(result.overturned[result.used].sum()),
        left_out=int((~result.used).sum()),
        seed=study.get("seed", "unknown"),
        curves=_curve_table(result),
        surface_note=fit_note(result.surface) if result.surface is not None else "",
        figures=figures,
    )


def _curve_table(result: FragilityResult) -> str:
    rows = []
    for name, pooled in result.curves.items():
        turned = {
            f"{t:g}": fit for (other, t), fit in result.azimuth_curves.items() if other == name
        }
        for azimuth, fit in {"all": pooled, **turned}.items():
            median = beta = "-"
            if (found := fit.lognormal) is not None:
                median = f"{found.median:.3g} [{found.median_lower:.3g}, {found.median_upper:.3g}]"
                beta = f"{found.beta:.2g} [{found.beta_lower:.2g}, {found.beta_upper:.2g}]"
            counts = (str(fit.trials), str(fit.overturned))
            rows.append([MEASURE_LABELS[name], azimuth, *counts, median, beta, fit_caveats(fit)])
    header = ["measure", "azimuth [deg]", "trials", "overturned", "median", "beta", "note"]
    return markdown_table(header, rows)
