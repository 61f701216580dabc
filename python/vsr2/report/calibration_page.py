"""A calibration for people: figures and a page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vsr2.analysis.bootstrap import SCORES
from vsr2.analysis.probability import RELIABILITY
from vsr2.calibration.calibrate import CalibrationResult
from vsr2.calibration.calibration_study import CalibrationParameter, Sequential
from vsr2.calibration.calibration_tables import best_of_sweeps
from vsr2.calibration.profile import Identifiability, Profile
from vsr2.campaign import intensity_measures
from vsr2.config.extended import Plain
from vsr2.errors import MotionError
from vsr2.report.figures import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION
from vsr2.report.messages.agreement import FITTED, IDENTIFIABILITY
from vsr2.report.messages.figure_titles import CALIBRATION_CAPTIONS
from vsr2.report.messages.runs import compatible_values, no_baselines, optimism_note
from vsr2.report.pages import render
from vsr2.report.panels import legend_below, scale_axis, scale_where_wide, sheet, write_page
from vsr2.report.text import as_markdown, markdown_table, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
"""Panels beside each other."""


def write_calibration_report(result: CalibrationResult, folder: str | Path) -> list[Path]:
    """Draw the figures and write `report.md`.

    Returns:
        The files written, the page last.

    Raises:
        ResultError: one cannot be written.
    """
    figures = {"profiles": profile_figure(result), "search": search_figure(result)}
    diagram = prediction_figure(result)
    if diagram is not None:
        figures["predictions"] = diagram
    drawn = {name: (figure, CALIBRATION_CAPTIONS[name]) for name, figure in figures.items()}
    return write_page(folder, drawn, partial(calibration_page, result))


def profile_figure(result: CalibrationResult) -> Figure:
    """Best objective along each parameter: every evaluated set, and the cells.

    A cell's bar is its best objective; blue: compatible with the data; whiskers: the 95 % interval
    of what it falls short of the best. Sets far below all cells are left out.
    """
    count = len(result.profiles)
    columns = min(COLUMNS, count)
    rows = math.ceil(count / columns)
    figure, axes = sheet(rows, columns, (3.1 * columns, 2.5 * rows + 0.5))
    top = max(cell.objective + cell.deficit for cell in result.profiles[0].cells if cell.sets)
    for panel, profile in zip(axes.flat, result.profiles, strict=False):
        _profile_panel(panel, profile, result.settings.parameters[profile.name], top)
    for row in axes:
        row[0].set_ylabel("objective [1]")
    for panel in axes.flat[count:]:
        panel.set_visible(False)
    legend_below(figure, 4)
    return figure


def _profile_panel(
    panel: Axes, profile: Profile, parameter: CalibrationParameter, top: float
) -> None:
    known = [cell for cell in profile.cells if cell.sets]
    listed = parameter.values is not None
    # Listed values stand side by side, those of a range where they lie.
    index = {value: float(i) for i, value in enumerate(parameter.values or ())}

    def at(value: Plain) -> float:
        return index[value] if listed else float(value)

    half = 0.4 if listed else 0.0
    sampled = [(at(v), score) for v, score in profile.sampled if not listed or v in index]
    panel.plot(
        *np.array(sampled).T.reshape(2, -1), ".", color=GREY, markersize=3, label="evaluated set"
    )
    for kept, color, label in (
        (True, BLUE, "cell, compatible"),
        (False, VERMILION, "cell, worse beyond noise"),
    ):
        cells = [cell for cell in known if cell.compatible == kept]
        low, high = (np.array([at(end) for end in ends]) for ends in (
            [cell.low for cell in cells], [cell.high for cell in cells],
        ))  # fmt: skip
        # Drawn even where there are none, for the legend.
        panel.hlines(
            [cell.objective for cell in cells], low - half, high + half,
            color=color, linewidth=2.5, label=label,
        )  # fmt: skip
        panel.vlines(
            np.sqrt(low * high) if parameter.scale == "log" else 0.5 * (low + high),
            [top - cell.deficit_high for cell in cells],
            [min(top - cell.deficit_low, 1.0) for cell in cells],
            color=color,
            linewidth=0.9,
        )
    if not listed or profile.best in index:
        panel.axvline(
            at(profile.best), color=BLACK, linewidth=0.9, linestyle="--", label="calibrated"
        )
    if listed:
        panel.set_xticks(list(index.values()), [_short(value) for value in index], fontsize="small")
    elif parameter.scale == "log":
        scale_axis(panel, "x")
    # Sets far worse than every cell's best would press the cells together; they stay outside.
    lowest = min(cell.objective for cell in known)
    reach = max(top - lowest, 0.05)
    whiskers = [top - end for cell in known for end in (cell.deficit_low, cell.deficit_high)]
    panel.set_ylim(
        max(min(lowest - 0.5 * reach, *whiskers), -0.02),
        min(max(top + 0.15 * reach, *whiskers), 1.02),
    )
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    panel.set_xlabel(printable(profile.name.replace("_", " ") + unit), parse_math=False)
    panel.set_title(IDENTIFIABILITY[profile.verdict], fontsize="small")


def _short(value: Plain) -> str:
    return f"{value:g}" if isinstance(value, (int, float)) else printable(value)


def search_figure(result: CalibrationResult) -> Figure:
    """The best objective as sets were evaluated; training and held-out objective of each fold."""
    from matplotlib.ticker import MaxNLocator

    columns = 2 if result.folds else 1
    figure, axes = sheet(1, columns, (4.2 * columns, 3.2))
    panel = axes[0, 0]
    scores = np.array([step.score for step in result.steps])
    panel.plot(scores, ".", color=GREY, markersize=3, label="evaluated set")
    panel.step(
        np.arange(scores.size),
        np.maximum.accumulate(scores),
        where="post",
        color=BLUE,
        label="best so far",
    )
    panel.set_ylim(None, min(panel.get_ylim()[1], 1.02))
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.set_xlabel("step of the search on all trials [number]")
    panel.set_ylabel("objective in sample [1]")
    _legend_below(panel)
    if result.folds:
        panel = axes[0, 1]
        index = np.arange(len(result.folds))
        training = [one.training for one in result.folds]
        judged = [one.judged for one in result.folds]
        panel.plot(index, training, "o", color=BLUE, markersize=4, label="training trials")
        panel.plot(index, judged, "s", color=VERMILION, markersize=4, label="held-out trials")
        outside = result.searched_in_sample - result.optimism
        panel.axhline(result.searched_in_sample, color=BLUE, linewidth=0.9, label="all, in sample")
        panel.axhline(
            outside, color=VERMILION, linewidth=0.9, linestyle="--", label="all, out of fold"
        )
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        low, high = panel.get_ylim()
        panel.set_ylim(low, min(high, 1.02))
        panel.set_xlabel("fold [number]")
        panel.set_ylabel("objective [1]")
        _legend_below(panel)
    return figure


def _legend_below(panel: Axes) -> None:
    """Within the panel it would hide sets and folds."""
    panel.legend(
        fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2, frameon=False
    )


def prediction_figure(result: CalibrationResult) -> Figure | None:
    """Observed outcomes over PGA [g] and PGV/PGA [s], with the trials predicted wrongly.

    Predictions are out of fold where there are folds. None: no trial's intensity is known.
    """
    try:
        measures = intensity_measures(result.campaign)
    except MotionError:
        return None
    known = (measures.pga_g > 0) & (measures.pgv_pga_s > 0)
    if not known.any():
        return None
    probability = result.out_of_fold if result.folds else result.in_sample
    predicted = np.where(np.isnan(probability), np.nan, probability > RELIABILITY.threshold)
    observed = result.observed
    figure, axes = sheet(1, 1, (5.2, 4.2))
    panel = axes[0, 0]
    x, y = measures.pgv_pga_s, measures.pga_g
    for outcome, marker, face, name in (
        (False, "o", SKY, "stood"),
        (True, "^", ORANGE, "overturned"),
    ):
        chosen = known & (observed == outcome)
        panel.scatter(
            x[chosen], y[chosen], s=16, marker=marker, facecolor=face, edgecolor="white",
            linewidth=0.4, label=f"{name} ({chosen.sum()})",
        )  # fmt: skip
    for guess, color, name in (
        (1.0, VERMILION, "predicted to overturn, stood"),
        (0.0, BLACK, "predicted to stand, overturned"),
    ):
        wrong = known & (predicted == guess) & (observed != (guess == 1.0))
        panel.scatter(
            x[wrong], y[wrong], s=48, facecolor="none", edgecolor=color, linewidth=0.9,
            label=f"{name} ({wrong.sum()})",
        )  # fmt: skip
    failed = known & np.isnan(predicted)
    if failed.any():
        panel.scatter(x[failed], y[failed], s=30, marker="x", color=GREY, label="failed")
    scale_where_wide(panel, "x", x[known])
    scale_where_wide(panel, "y", y[known])
    panel.set_xlabel("PGV/PGA [s]")
    panel.set_ylabel("PGA [g]")
    panel.set_title("out of fold" if result.folds else "in sample", fontsize="small")
    legend_below(figure, 2)
    return figure


def calibration_page(result: CalibrationResult, figures: dict[str, str]) -> str:
    """The report as Markdown."""
    sequential = isinstance(result.settings.method, Sequential)
    verdicts = {profile.name: profile.verdict for profile in result.profiles}
    return render(
        "calibration.md",
        {"as_markdown": as_markdown},
        campaign=result.campaign,
        motions=len(set(result.campaign.motion_ids)),
        overturned=int(result.observed.sum()),
        settings=result.settings,
        seen=result.provenance,
        scores=_score_table(result),
        optimism=optimism_note(result.optimism if result.folds else None),
        failed=int(np.isnan(result.in_sample).sum()),
        no_baselines=no_baselines(result.no_baselines),
        screen=result.screen,
        values=_value_table(result),
        untried=any(cell.sets == 0 for profile in result.profiles for cell in profile.cells),
        not_identified=[n for n, v in verdicts.items() if v is Identifiability.NOT_IDENTIFIED],
        sweeps=_sweep_table(result) if sequential else "",
        folds=_fold_table(result) if result.folds else "",
        figures=figures,
    )


def _score_table(result: CalibrationResult) -> str:
    header = ["prediction", "fitted", "trials", *SCORES[:4], "mean of three"]
    rows = [
        [s.name, FITTED[s.fitted], s.metrics.trials, *(s.intervals[name] for name in SCORES)]
        for s in result.scores
    ]
    return markdown_table(header, rows)


def _value_table(result: CalibrationResult) -> str:
    rows = []
    for profile in result.profiles:
        parameter = result.settings.parameters[profile.name]
        found = [one.values[profile.name] for one in result.folds]
        rows.append(
            [
                profile.name + (f" [{parameter.unit}]" if parameter.unit else ""),
                ", ".join(f"`{key}`" for key in parameter.keys),
                _short(profile.best),
                *([_spread(found)] if found else []),
                compatible_values(profile),
                IDENTIFIABILITY[profile.verdict],
            ]
        )
    folds = ["in the folds"] if result.folds else []
    return markdown_table(["parameter", "keys", "best", *folds, "compatible", "verdict"], rows)


def _spread(values: Sequence[Plain]) -> str:
    if all(isinstance(v, (int, float)) for v in values):
        numbers = sorted(float(v) for v in values)
        return f"{numbers[0]:g} to {numbers[-1]:g}"
    return ", ".join(f"{value} ({count})" for value, count in Counter(values).items())


def _sweep_table(result: CalibrationResult) -> str:
    rows = [
        [
            step.iteration,
            step.group,
            *(_short(step.evaluation.values[name]) for name in result.settings.parameters),
            f"{step.score:.3f}",
        ]
        for step in best_of_sweeps(result)
    ]
    return markdown_table(["iteration", "group", *result.settings.parameters, "objective"], rows)


def _fold_table(result: CalibrationResult) -> str:
    names = list(result.settings.parameters)
    rows = [
        [
            k,
            one.held_out.sum(),
            f"{one.training:.3f}",
            f"{one.judged:.3f}",
            *(_short(one.values[name]) for name in names),
        ]
        for k, one in enumerate(result.folds)
    ]
    return markdown_table(["fold", "trials", "training", "held out", *names], rows)
