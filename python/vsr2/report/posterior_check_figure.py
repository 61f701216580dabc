"""The figure of a posterior check: ranks, coverage of intervals, reliability of answers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vsr2.coverage.coverage_scores import LEVELS, CoverageScores
from vsr2.diagnosis.verdict.document import CHECK_FIGURE
from vsr2.posterior.calibration import CALIBRATED
from vsr2.report.diagnosis_figures import BLUE, GREY, INK, RED
from vsr2.report.messages.figure_titles import answers_title, ranks_title
from vsr2.report.panels import legend_below, save_figure, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from vsr2.analysis.intervals import Score
    from vsr2.coverage import PosteriorCheck


def write_check_figure(found: PosteriorCheck, folder: str | Path) -> Path:
    """Write the figure as PNG; returns its path.

    Raises:
        ResultError: it cannot be written.
    """
    return save_figure(
        check_figure(found), Path(folder) / Path(CHECK_FIGURE).stem, ("png",), dpi=150
    )[0]


def check_figure(found: PosteriorCheck) -> Figure:
    """Ranks of true values, coverage of intervals, and reliability of the most probable answer.

    What holds lies on the dashed line or in the grey band. Bars are exact 95 % intervals.
    """
    figure, axes = sheet(1, 3, (10.5, 4.2))
    ranks, coverage, reliability = axes[0]
    _ranks(ranks, found.scores)
    _coverage(coverage, found.scores)
    _reliability(reliability, found.scores, found.stated)
    for panel in (coverage, reliability):
        panel.set_ylim(-0.03, 1.03)
    handles = ranks.get_legend_handles_labels()[0] + reliability.get_legend_handles_labels()[0]
    legend_below(figure, 3, handles)
    return figure


def _ranks(panel: Axes, scores: CoverageScores) -> None:
    """Share of ranks up to each value, less what uniform ranks have."""
    panel.set_title(ranks_title(len(scores.parameters)), fontsize=9)
    for one in scores.not_uniform:
        test, label = one.uniformity, f"{one.effect}.{one.parameter}: not uniform"
        panel.plot(test.points, test.share - test.points, color=RED, linewidth=1, label=label)
    if scores.together is not None:
        test = scores.together.uniformity
        panel.fill_between(
            test.points, test.low - test.points, test.high - test.points,
            color=GREY, alpha=0.35, linewidth=0, label="95 % band of all together",
        )  # fmt: skip
        label = f"all together, p = {test.p_value:.2g}"
        panel.plot(test.points, test.share - test.points, color=BLUE, linewidth=2, label=label)
    panel.axhline(0.0, color=INK, linestyle="--", linewidth=0.8)
    panel.set_xlabel("rank [1]")
    panel.set_ylabel("share of ranks below, less the rank [1]")


def _coverage(panel: Axes, scores: CoverageScores) -> None:
    panel.set_title("coverage of central intervals", fontsize=9)
    panel.plot([0, 1], [0, 1], "--", color=INK, linewidth=0.8)
    if scores.together is not None:
        _points(panel, np.array(LEVELS), scores.together.covered, BLUE)
    panel.set_xlim(-0.03, 1.03)
    panel.set_xlabel("stated [1]")
    panel.set_ylabel("true values held [1]")


def _reliability(panel: Axes, scores: CoverageScores, stated: float) -> None:
    panel.set_title(answers_title(CALIBRATED.coverage), fontsize=9)
    panel.plot([0, 1], [0, 1], "--", color=INK, linewidth=0.8, label="as stated")
    groups = scores.reliability
    _points(
        panel, np.array([one.stated for one in groups]), [one.right for one in groups],
        BLUE, label="most probable answer, by its probability",
    )  # fmt: skip
    level = CALIBRATED.coverage
    _points(
        panel, np.array([stated]), [scores.causes], RED, label=f"{100 * level:g} % sets of causes",
        marker="s",
    )  # fmt: skip
    panel.set_xlim(-0.03, 1.03)
    panel.set_xlabel("stated [1]")
    panel.set_ylabel("share true [1]")


def _points(
    panel: Axes,
    stated: np.ndarray,
    found: list[Score] | tuple[Score, ...],
    colour: str,
    label: str | None = None,
    marker: str = "o",
) -> None:
    value = np.array([one.value for one in found])
    ends = np.array([[one.value - one.low, one.high - one.value] for one in found]).T
    panel.errorbar(
        stated, value, np.maximum(ends, 0.0), fmt=marker, color=colour, markersize=4,
        capsize=2, linewidth=1, label=label,
    )  # fmt: skip
