"""Scores of a blind check for people: tables and the reliability figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.analysis.intervals import Score
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.scoring.baselines import BASELINES
from vsr2.blind.scoring.cases import Case
from vsr2.blind.scoring.score import BEST_HIGH, BEST_LOW, SAYING_NOTHING, ScoreCode
from vsr2.blind.scoring.scored import Scored
from vsr2.report.messages.scores import SCORES, auroc_label
from vsr2.report.pages import plain, render
from vsr2.report.panels import save_figure, sheet
from vsr2.report.text import as_markdown, markdown_table
from vsr2.results.atomic import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEADING = (ScoreCode.ANSWER, ScoreCode.NAMED)
"""Scores whose margin over the baselines is stated."""


def write_scores(scored: Scored, folder: Path) -> None:
    """Write `scores.md` and `reliability.png`.

    Raises:
        ResultError: one cannot be written.
    """
    write_text(folder / "scores.md", scores_page(scored))
    save_figure(reliability_figure(scored.cases), folder / "reliability", ("png",), dpi=120)


def scores_page(scored: Scored) -> str:
    """Markdown: one table a group, tiers and baselines side by side."""
    content = {
        "trivial": [name for name in scored.columns if name in BASELINES],
        "groups": [_group(scored, group) for group in scored.groups],
        "rates": [_rates(rates) for rates in scored.rates if rates],
        "leaks": [
            markdown_table(
                ("question", "p", "best predictor", "right", "by chance", "campaigns"),
                [
                    (one.question, f"{one.p:.3f}", plain(one.best), f"{one.rate:.2f}",
                     f"{one.chance:.2f}", one.count)
                    for one in leaks
                ],
            ) if leaks else ""
            for leaks in scored.leaks
        ],
    }  # fmt: skip
    return render("blind_scores.md", {"as_markdown": as_markdown}, **content).rstrip() + "\n"


def _group(scored: Scored, group: str) -> dict[str, Any]:
    found = {column: scored.scores.get((column, group), {}) for column in scored.columns}
    rows = [
        (SCORES[code], *(_cell(_shown(code, column, own)) for column, own in found.items()))
        for code in ScoreCode
        if any(code in own for own in found.values())
    ]
    margins = {code: scored.margins(code, group) for code in (*BEST_HIGH, *BEST_LOW)}
    beaten = {
        SCORES[code]: [tier for tier, value in by_tier.items() if value < 0]
        for code, by_tier in margins.items()
    }
    return {
        "name": group,
        "table": markdown_table(("score", *map(plain, found)), rows),
        "margins": {
            SCORES[code]: [f"{tier} {value:+.2f}" for tier, value in margins[code].items()]
            for code in LEADING
            if margins[code]
        },
        "beaten": [f"{name} ({', '.join(tiers)})" for name, tiers in beaten.items() if tiers],
    }


def _shown(code: ScoreCode, column: str, own: Mapping[ScoreCode, Score]) -> Score | None:
    """A score, or what a baseline gets that has nothing to say of it."""
    if column in BASELINES and code in SAYING_NOTHING:
        return Score(SAYING_NOTHING[code], math.nan, math.nan, 0)
    return own.get(code)


def _rates(rates: Mapping[str, Score]) -> str:
    rows = [(auroc_label(kind), _cell(score)) for kind, score in rates.items()]
    return markdown_table(("score", "value"), rows)


def _cell(score: Score | None) -> str:
    if score is None or not math.isfinite(score.value):
        return ""
    span = f" [{score.low:.2f}, {score.high:.2f}]" if math.isfinite(score.low) else ""
    return f"{score.value:.2f}{span}" + (f" ({score.count})" if score.count else "")


def reliability_figure(cases: Sequence[Case]) -> Figure:
    """How often the first class was true, against the probability stated for it, by tier."""
    from sklearn.calibration import calibration_curve

    figure, panels = sheet(1, 1, (4.5, 4.2))
    axes = panels[0, 0]
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for tier in sorted({case.tier for case in cases}):
        asked = [case for case in cases if case.tier == tier and case.kind != Kind.PAIR]
        if asked:
            stated = [min(case.first[1], 1.0) for case in asked]
            true = [case.first[0] in case.truth for case in asked]
            share, mean = calibration_curve(true, stated, pos_label=True, n_bins=10)
            axes.plot(mean, share, "o-", markersize=4, label=f"tier {tier} ({len(asked)})")
    axes.set_xlabel("stated probability of the first class")
    axes.set_ylabel("share in which it was true")
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left")
    return figure
