"""Scores as plain data, as Markdown and as a figure."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import methodcaller
from pathlib import Path
from typing import Any

from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.scoring.baselines import BASELINES
from vsr2.blind.scoring.cases import ALL, Case
from vsr2.blind.scoring.intervals import Score
from vsr2.blind.scoring.leaks import Leak
from vsr2.blind.scoring.score import (
    ANSWER,
    BEST_HIGH,
    BEST_LOW,
    NAMED,
    SAYING_NOTHING,
    Scores,
    is_alarm,
    top_one,
)
from vsr2.results.atomic import write_atomic


@dataclass(frozen=True, eq=False)
class Scored:
    """What scoring a pack gave.

    Attributes:
        scores: by tier, or name of a trivial baseline, and group.
        rates: how well the overturn rate alone predicts kinds, one for each pack.
        cases: one a campaign and tier.
        development: whether the pack is open.
        leaks: how well metadata predict engine, kind and class, one list for each pack.
    """

    scores: Mapping[tuple[str, str], Scores]
    rates: Sequence[Mapping[str, Score]]
    cases: Sequence[Case]
    development: bool
    leaks: Sequence[Sequence[Leak]] = ()

    def margins(self, score: str, group: str = ALL) -> dict[str, float]:
        """By tier, how much better a score is than the best baseline's; {} without baselines."""
        sign = -1.0 if score in BEST_LOW else 1.0
        found = {
            column: sign * scores[score].value
            for (column, own), scores in self.scores.items()
            if own == group and score in scores
        }
        best = max((found.pop(name) for name in BASELINES if name in found), default=None)
        return {} if best is None else {tier: found[tier] - best for tier in sorted(found)}

    def groups(self) -> list[str]:
        """Of campaigns: all first, the others by name."""
        return sorted({group for _, group in self.scores}, key=lambda name: (name != ALL, name))

    def to_json(self) -> dict[str, Any]:
        """Plain data; single campaigns of an open pack only."""
        out: dict[str, Any] = {
            "scores": [
                {"tier": tier, "group": group, "score": name, **_plain(score)}
                for (tier, group), scores in self.scores.items()
                for name, score in scores.items()
            ],
            "rates": [
                {"score": name, **_plain(score)}
                for one in self.rates
                for name, score in one.items()
            ],
            "above_baselines": [
                {"group": group, "score": score, "tier": tier, "value": round(value, 6)}
                for group in self.groups()
                for score in (*BEST_HIGH, *BEST_LOW)
                for tier, value in self.margins(score, group).items()
            ],
            "leaks": [[asdict(leak) for leak in one] for one in self.leaks],
        }
        if self.development:
            out["campaigns"] = [
                {
                    "id": case.id,
                    "tier": case.tier,
                    "kind": case.kind,
                    "engine": case.engine,
                    "truth": [dict(effect) for effect in case.effects],
                    "verdict": case.verdict.kind,
                    "effects": list(case.verdict.effects),
                    "failed": case.verdict.failed,
                    "right": top_one(case),
                    "alarm": is_alarm(case),
                }
                for case in self.cases
            ]
        return out


def score_files(scored: Scored, content: Mapping[str, Any]) -> dict[str, bytes]:
    """The files of a scored pack, by name; `content` is that of `scores.json`."""
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"
    return {
        "scores.json": text.encode(),
        "scores.md": format_scores(scored).encode(),
        "reliability.png": _reliability(scored.cases),
    }


def write_files(files: Mapping[str, bytes], out: Path) -> None:
    """Write files, each atomically."""
    for name, content in files.items():
        write_atomic(out / name, methodcaller("write", content))


def _plain(score: Score) -> dict[str, float | int | None]:
    def finite(value: float) -> float | None:
        return round(float(value), 6) if math.isfinite(value) else None

    return {
        "value": finite(score.value),
        "low": finite(score.low),
        "high": finite(score.high),
        "campaigns": score.count,
    }


def format_scores(scored: Scored) -> str:
    """The scores as Markdown: one table a group, tiers and baselines side by side."""
    known = {tier for tier, _ in scored.scores}
    trivial = [name for name in BASELINES if name in known]
    columns = [*sorted(known - set(trivial)), *trivial]
    lines: list[str] = []
    if not trivial:
        lines += ["", "Without trivial baselines: none were trained (`--train`)."]
    for group in scored.groups():
        found = {column: scored.scores.get((column, group), {}) for column in columns}
        names = dict.fromkeys(name for scores in found.values() for name in scores)
        for name in names.keys() & SAYING_NOTHING.keys():
            silent = Score(SAYING_NOTHING[name], math.nan, math.nan, 0)
            found |= {column: {**found[column], name: silent} for column in trivial}
        rows = [[name, *(_cell(found[c].get(name)) for c in columns)] for name in names]
        lines += ["", f"### {group}", "", *_table(["score", *columns], rows)]
        lines += _against_baselines(scored, group)
    for number, rates in enumerate(scored.rates, 1):
        if rates:
            rows = [[name, _cell(score)] for name, score in rates.items()]
            lines += ["", f"### overturn rate alone, pack {number}", ""]
            lines += _table(["score", "value"], rows)
    for number, leaks in enumerate(scored.leaks, 1):
        lines += ["", f"### metadata alone, pack {number}", ""]
        if not leaks:
            lines.append("Not asked: too few campaigns to compare with their neighbours.")
            continue
        lines += _table(
            ["question", "p", "best predictor", "right", "by chance", "campaigns"],
            [
                [one.question, f"{one.p:.3f}", one.best, f"{one.rate:.2f}", f"{one.chance:.2f}",
                 str(one.count)]
                for one in leaks
            ],
        )  # fmt: skip
    return "\n".join(lines).lstrip() + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def _against_baselines(scored: Scored, group: str) -> list[str]:
    """What the scores of a group are beside those of the best trivial baseline."""
    lines = []
    for score in (ANSWER, NAMED):
        margins = scored.margins(score, group)
        if margins:
            listed = ", ".join(f"{tier} {value:+.2f}" for tier, value in margins.items())
            lines += ["", f"Above the best baseline, {score}: {listed}."]
    beaten = {
        score: [tier for tier, value in scored.margins(score, group).items() if value < 0]
        for score in (*BEST_HIGH, *BEST_LOW)
    }
    listed = "; ".join(f"{score} ({', '.join(tiers)})" for score, tiers in beaten.items() if tiers)
    return [*lines, "", f"A baseline does better in: {listed}."] if listed else lines


def _cell(score: Score | None) -> str:
    if score is None or not math.isfinite(score.value):
        return ""
    span = f" [{score.low:.2f}, {score.high:.2f}]" if math.isfinite(score.low) else ""
    return f"{score.value:.2f}{span}" + (f" ({score.count})" if score.count else "")


def _reliability(cases: Sequence[Case]) -> bytes:
    """The reliability figure (PNG)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from sklearn.calibration import calibration_curve

    figure = Figure(figsize=(4.5, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
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
    image = io.BytesIO()
    figure.savefig(image, dpi=120)
    return image.getvalue()
