"""Figures of the diagnosis' calibration, and of its power against the size of an effect.

Drawn from the committed blind rounds, docs/results/blind_validation_N, from the sixth on. Those
before simulated each effect for itself. Each round counts with the method that diagnosed it. Run
from the repository's root (ten seconds):

    python studies/figure_diagnosis.py [--out docs/results]

Writes diagnosis_calibration.png and diagnosis_power.png, and prints the numbers behind them. Bars
are exact 95 % intervals. References are left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from blind_results import read_parts
from vsr2.analysis.intervals import INTERVALS, Score, proportion
from vsr2.blind.form.pack_settings import EngineName, Kind
from vsr2.blind.scoring.cases import Case
from vsr2.blind.scoring.score import SCORING, leading_class, right
from vsr2.campaign import TIERS
from vsr2.report.diagnosis_figures import BLUE, GREY, INK, RED
from vsr2.report.panels import legend_below, save_figure, sheet

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
FIRST_ROUND = 6
"""The first whose diagnoses have simulated campaigns in common."""
ENGINES = {EngineName.BULLET: "Bullet", EngineName.MUJOCO: "MuJoCo"}
EDGES = {
    EngineName.BULLET: (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 6.0),
    EngineName.MUJOCO: (0.5, 1.0, 2.0, 4.0, 6.0),
}
"""Between groups of sizes [detection limits]; MuJoCo has a third of the campaigns."""
FEW = 10
"""Campaigns below which a mark is hollow and no line goes to it; chosen by eye."""
TIER_MARKS: dict[str, tuple[str, str, Literal[":", "--", "-"]]] = {
    "B": (INK, "s", ":"),
    "M": (RED, "^", "--"),
    "T": (BLUE, "o", "-"),
}
"""Colour, marker and line of each tier; each alone tells them apart."""
QUESTIONS: dict[str, Callable[[Case], bool]] = {
    "leads all other effects": lambda case: leading_class(case) in case.truth,
    f"named, at most {SCORING.most_classes} classes": right,
}
"""What is asked of a single effect, as the blind check scores it."""
ASIDE = 0.012
"""Distance between marks of two tiers, as a share of the axis."""


@dataclass(frozen=True)
class Point:
    """One mark.

    Attributes:
        at: mean stated probability, or geometric mean of the sizes [detection limits].
        score: share, interval and count.
        group: which tenth, or which group of sizes.
    """

    at: float
    score: Score
    group: int


Points = dict[tuple[EngineName, str], list[Point]]
"""By engine and tier."""


def committed_rounds(results: Path = RESULTS) -> list[Path]:
    """Folders of the rounds that are drawn, in their order."""
    numbers = {
        int(path.name.rsplit("_", 1)[1]): path
        for check in ("validation", "other_engine")
        for path in results.glob(f"blind_{check}_[0-9]*")
    }
    return [numbers[number] for number in sorted(numbers) if number >= FIRST_ROUND]


def cases_of(folders: Sequence[Path]) -> list[Case]:
    """Verdicts beside the truth, of all rounds; references left out."""
    cases = [case for folder in folders for part in read_parts(folder) for case in part]
    return [case for case in cases if case.kind != Kind.REFERENCE]


def stated(case: Case) -> float:
    """Probability of the most probable answer; sums of rounded ones may exceed 1."""
    return min(case.first[1], 1.0)


def calibration(cases: Sequence[Case]) -> Points:
    """Share of the most probable answers that are right, by tenths of their probability.

    Of a pair one of its two effects is right, of a cause outside the library `unknown`.
    """
    bins = INTERVALS.bins
    return {
        (engine, tier): [
            Point(math.fsum(map(stated, own)) / len(own), _share(own, _answered), tenth)
            for tenth in range(bins)
            if (own := [c for c in asked if min(int(stated(c) * bins), bins - 1) == tenth])
        ]
        for (engine, tier), asked in _by_engine_and_tier(cases).items()
    }


def power(cases: Sequence[Case], question: Callable[[Case], bool]) -> Points:
    """Share of single effects of which `question` holds, by groups of their sizes."""
    singles = [case for case in cases if case.kind == Kind.SINGLE]
    return {
        (engine, tier): [
            Point(
                math.exp(math.fsum(math.log(c.relative) for c in own) / len(own)),
                _share(own, question),
                group,
            )
            for group, (low, high) in enumerate(pairwise(EDGES[engine]))
            if (own := [case for case in asked if low <= case.relative < high])
        ]
        for (engine, tier), asked in _by_engine_and_tier(singles).items()
    }


def _by_engine_and_tier(cases: Sequence[Case]) -> dict[tuple[EngineName, str], list[Case]]:
    return {
        (engine, tier): [case for case in cases if (case.engine, case.tier) == (engine, tier)]
        for engine in ENGINES
        for tier in TIERS
    }


def _answered(case: Case) -> bool:
    return case.first[0] in case.truth


def _share(cases: Sequence[Case], question: Callable[[Case], bool]) -> Score:
    return proportion(sum(map(question, cases)), len(cases))


def calibration_figure(points: Points) -> Figure:
    """Reliability of the most probable answer, a panel an engine."""
    figure, axes = sheet(len(ENGINES), 1, (5.2, 6.6))
    for panel, (engine, name) in zip(axes[:, 0], ENGINES.items(), strict=True):
        [line] = panel.plot([0, 1], [0, 1], color=GREY, linewidth=1.5, label="share as stated")
        for row, tier in enumerate(TIERS):
            own = points[engine, tier]
            aside = (row - 1) * ASIDE
            _marks(panel, tier, [one.at + aside for one in own], own)
            for one in own:
                _count(panel, (one.group + 0.5) / INTERVALS.bins, row, one.score.count, tier)
        count = sum(one.score.count for one in points[engine, TIERS[0]])
        panel.set_title(f"{name}: {count} campaigns at each tier", fontsize=10)
        panel.set_xlim(0, 1.02)
        panel.set_xticks([tenth / INTERVALS.bins for tenth in range(INTERVALS.bins + 1)])
        _shares(panel, [f"n at {tier}" for tier in TIERS], "share that is right [1]")
    axes[-1, 0].set_xlabel("stated probability of the most probable answer [1]", fontsize=10)
    legend_below(figure, 2, [line, *_legend("n: campaigns of a tenth")], "small")
    return figure


def power_figure(found: dict[str, Points]) -> Figure:
    """Share of single effects found against their size, a row an engine, a column a question."""
    figure, axes = sheet(len(ENGINES), len(found), (5.6, 6.2))
    for row, (engine, name) in enumerate(ENGINES.items()):
        for column, (question, points) in enumerate(found.items()):
            panel = axes[row, column]
            for i, tier in enumerate(TIERS):
                own = points[engine, tier]
                aside = (EDGES[engine][-1] / EDGES[engine][0]) ** (2 * (i - 1) * ASIDE)
                _marks(panel, tier, [one.at * aside for one in own], own)
            for one in points[engine, TIERS[0]]:
                low, high = EDGES[engine][one.group : one.group + 2]
                _count(panel, math.sqrt(low * high), 0, one.score.count, None)
            panel.set_title(f"{name}: {question}", fontsize=9)
            panel.set_xlim(EDGES[engine][0] * 0.95, EDGES[engine][-1] * 1.05)
            panel.set_xscale("log")
            panel.set_xticks(EDGES[engine], [f"{edge:g}" for edge in EDGES[engine]])
            panel.minorticks_off()
            _shares(panel, ["n"], "" if column else "share of the effects [1]")
    for panel in axes[-1]:
        panel.set_xlabel("size [detection limits]", fontsize=10)
    legend_below(figure, 2, _legend("n: campaigns between two sizes"), "small")
    return figure


def _marks(panel: Axes, tier: str, at: Sequence[float], points: Sequence[Point]) -> None:
    colour, marker, line = TIER_MARKS[tier]
    scores = [one.score for one in points]
    joined = [one.value if one.count >= FEW else math.nan for one in scores]
    panel.plot(at, joined, line, color=colour, linewidth=1.3, alpha=0.7)
    for x, one in zip(at, scores, strict=True):
        ends = [[max(one.value - one.low, 0.0)], [max(one.high - one.value, 0.0)]]
        panel.errorbar(
            x, one.value, ends, fmt=marker, color=colour, markersize=5, elinewidth=1.1,
            markerfacecolor="white" if one.count < FEW else colour,
        )  # fmt: skip


def _count(panel: Axes, x: float, row: int, count: int, tier: str | None) -> None:
    """A number below the axis of shares, in a row of its own."""
    panel.text(
        x, _row(row), str(count), ha="center", va="center", fontsize=8.5,
        color=INK if tier is None else TIER_MARKS[tier][0],
    )  # fmt: skip


def _row(row: int) -> float:
    return -0.1 - 0.105 * row


def _shares(panel: Axes, rows: Sequence[str], label: str) -> None:
    """The axis of shares, with rows of counts below it."""
    shares = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    heights = [_row(row) for row in range(len(rows))]
    panel.set_ylim(heights[-1] - 0.07, 1.04)
    panel.set_yticks([*shares, *heights], [*(f"{share:g}" for share in shares), *rows])
    for tick, height in zip(panel.yaxis.get_major_ticks(), [*shares, *heights], strict=True):
        if height < 0:
            tick.gridline.set_visible(False)
            tick.tick1line.set_visible(False)
    panel.axhline(0.0, color=INK, linewidth=0.8)
    panel.tick_params(labelsize=9)
    panel.set_ylabel(label, fontsize=10)


def _legend(count: str) -> list[Artist]:
    from matplotlib.lines import Line2D

    measured = {"B": "outcomes", "M": "largest tilts", "T": "tilts in time"}
    return [
        *(
            Line2D([], [], color=c, marker=m, linestyle=line, label=f"tier {t}: {measured[t]}")
            for t, (c, m, line) in TIER_MARKS.items()
        ),
        Line2D(
            [], [], color=INK, marker="o", markerfacecolor="white", linestyle="none",
            label=f"hollow: below {FEW} campaigns",
        ),
        Line2D([], [], color=INK, marker="|", markersize=11, linestyle="none",
               label="exact 95 % interval"),
        Line2D([], [], linestyle="none", label=count),
    ]  # fmt: skip


def draw(cases: Sequence[Case], out: Path) -> list[Path]:
    """Write both figures; returns their paths."""
    found = {name: power(cases, question) for name, question in QUESTIONS.items()}
    calibrated = calibration(cases)
    for name, points in {"calibration": calibrated, **found}.items():
        for (engine, tier), own in points.items():
            cells = (f"{p.at:.2f}: {p.score.value:.2f} ({p.score.count})" for p in own)
            print(f"{name}, {engine}, {tier}: {', '.join(cells)}")
    figures = {"diagnosis_calibration": calibration_figure(calibrated)}
    figures["diagnosis_power"] = power_figure(found)
    return [
        path
        for name, figure in figures.items()
        for path in save_figure(figure, out / name, ("png",), dpi=160)
    ]


def main() -> None:
    """Read the committed rounds and write both figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=RESULTS)
    for path in draw(cases_of(committed_rounds()), parser.parse_args().out):
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
