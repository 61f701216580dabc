"""Sentences about a posterior that planted campaigns checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vsr2.coverage.coverage_scores import LEVELS
from vsr2.one_line import counted
from vsr2.report.messages.templates import written

if TYPE_CHECKING:
    from vsr2.analysis.intervals import Score
    from vsr2.coverage import PosteriorCheck


def check_sentences(found: PosteriorCheck) -> str:
    """What was planted, how often the truth was held, and what is not as stated: lines."""
    scores = found.scores
    lines = [
        f"{counted(len(found.judged), 'campaign')} planted, which training did not see",
        f"90 % sets of causes, where the library has the cause {written(found.stated, '.0%')} "
        f"stated: {share(scores.causes)} hold a true one{_beside(scores.causes, found.stated)}",
        f"most probable answer: {scores.stated:.2f} stated on average, {share(scores.right)} right"
        f"{_beside(scores.right, scores.stated)}",
    ]
    if scores.together is not None:
        lines += [
            f"intervals of parameters, {written(level, '.0%')} stated: {share(held)} hold the truth"
            f"{_beside(held, level)}"
            for level, held in zip(LEVELS, scores.together.covered, strict=True)
        ]
        lines.append(_ranks(found))
    return "\n".join(lines)


def share(score: Score) -> str:
    """A share with its 95 % interval."""
    return f"{score.value:.2f} [{score.low:.2f}, {score.high:.2f}]"


def _beside(score: Score, stated: float) -> str:
    if score.high < stated:
        return "; too few"
    return "; more than stated" if score.low > stated else ""


def _ranks(found: PosteriorCheck) -> str:
    """Which parameters' ranks are not uniform."""
    scores = found.scores
    other = [f"{one.effect}.{one.parameter}" for one in scores.not_uniform]
    fewest = min(one.ranks.size for one in scores.parameters)
    said = ", ".join(other) if other else "none"
    return (
        f"ranks that are not uniform, of {counted(len(scores.parameters), 'parameter')} at 5 %: "
        f"{said} (each planted {fewest} times at least: a flaw that few ranks cannot show stays "
        "unseen)"
    )
