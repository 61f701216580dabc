"""A blind check's scores beside the targets for them, as tables in Markdown.

    python studies/blind_targets.py docs/results/blind_validation_5 [MORE ...]

Reads results folders of `blind_check.py --score` (:mod:`blind_results`); campaigns of several
rounds are taken together. Scores are given at tiers B / M / T, by engine, with the number of
campaigns in parentheses; where tiers differ, one a tier.
Shares have their exact 95 % interval in brackets. The second table counts what the verdicts of both
engines came to.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from blind_results import read_parts
from vsr2.analysis.intervals import Score
from vsr2.blind.form.pack_settings import EngineName, Kind
from vsr2.blind.scoring.cases import Case, engine_group
from vsr2.blind.scoring.score import ScoreCode, Scores, is_named, right, score_cases, wrong
from vsr2.campaign import TIERS
from vsr2.report.text import markdown_table

STRONG = (2.0, math.inf)
WEAK = (1.0, 2.0)
FROM_ONE = (1.0, math.inf)
ALL: tuple[float, ...] = ()


@dataclass(frozen=True)
class Row:
    """One line: a score, the magnitudes over the limit that it is of, and what is wanted."""

    label: str
    code: ScoreCode
    limits: tuple[float, ...]
    bullet: str = "-"
    mujoco: str = "-"

    @property
    def wanted(self) -> dict[EngineName, str]:
        """By engine."""
        return {EngineName.BULLET: self.bullet, EngineName.MUJOCO: self.mujoco}

    is_share: bool = True


ROWS = (
    Row(
        "most probable answer is the true class",
        ScoreCode.ANSWER, STRONG, ".66 / .90 / .95", ".56 / .80 / .85",
    ),
    Row("true class leads all other effects", ScoreCode.LEADS, WEAK, ".32 / .75 / .85"),
    Row("most probable answer is the true class", ScoreCode.ANSWER, WEAK),
    Row(
        "named rightly (an effect, or at most 3 classes with it)",
        ScoreCode.NAMED, STRONG, ".45 / .75 / .85", ".35 / .65 / .75",
    ),
    Row(
        "wrong among all named, unknown ones counted",
        ScoreCode.WRONG, ALL, "at most .10", "at most .15",
    ),
    Row("wrong among all named, of pairs", ScoreCode.PAIR_WRONG, ALL),
    Row("gap-free campaigns named", ScoreCode.NONE_NAMED, ALL, "at most .05", "at most .10"),
    Row("gap-free campaigns `none`", ScoreCode.NONE_SAID, ALL, "-", ".80"),
    Row("clean references `none`", ScoreCode.REFERENCE_NONE, ALL, "-", "1"),
    Row("pairs, both names right", ScoreCode.PAIR_NAMED, FROM_ONE, *2 * ("- / .35 / .45",)),
    Row("pairs, both names right", ScoreCode.PAIR_NAMED, STRONG, *2 * ("- / .60 / .75",)),
    Row(
        "unknown: AUROC", ScoreCode.UNKNOWN_AUROC, STRONG, ".75 / .85 / .88", ".75", is_share=False
    ),
    Row("unknown: AUROC", ScoreCode.UNKNOWN_AUROC, ALL, is_share=False),
    Row("unknown: rate at 5 % false alarms", ScoreCode.UNKNOWN_RATE, STRONG, "- / .45 / .45"),
    Row("unknown: rate at 5 % false alarms", ScoreCode.UNKNOWN_RATE, ALL),
    Row("90 % set: coverage", ScoreCode.SET_COVERAGE, STRONG, ".87 to .95", ".85"),
    Row("90 % set: coverage", ScoreCode.SET_COVERAGE, ALL, "-", ".85"),
    Row("90 % set: median size", ScoreCode.SET_SIZE, STRONG, "5 / 2 / 1", is_share=False),
    Row("calibration error", ScoreCode.CALIBRATION, ALL, ".06", ".10", is_share=False),
    Row(
        "the same, were what is stated true",
        ScoreCode.CALIBRATION_NOISE, ALL, is_share=False,
    ),
    Row(
        "magnitude: median relative error",
        ScoreCode.ERROR, STRONG, ".40 / .22 / .15", "- / .35 / -", is_share=False,
    ),
    Row("magnitude: 90 % interval holds the truth", ScoreCode.INTERVAL, STRONG, ".85"),
    Row("gap closed on motions not seen, median", ScoreCode.CLOSURE, STRONG, is_share=False),
    Row(
        "the same less the better negative control, median",
        ScoreCode.HEADLINE, STRONG, is_share=False,
    ),
    Row("loss on motions not seen falls beyond its interval", ScoreCode.LOSS_FALLS, STRONG),
    Row("loss on motions not seen rises beyond its interval", ScoreCode.LOSS_RISES, ALL),
    Row(
        "where: share of the effect over share of the trials, median",
        ScoreCode.WHERE_GAIN, STRONG, *2 * ("at least 2",), is_share=False,
    ),
    Row("where: at least twice its share", ScoreCode.WHERE_TWICE, STRONG),
    Row("where: false locations", ScoreCode.WHERE_FALSE, ALL, *2 * ("at most .05",)),
)  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+")
    folders = parser.parse_args().results
    cases = [case for folder in folders for part in read_parts(folder) for case in part]
    print(targets_table(cases))
    print()
    print(outcomes_table(cases))


def targets_table(cases: Sequence[Case]) -> str:
    """Scores beside what is wanted."""
    asked = {case.engine for case in cases}
    wanted = {engine_group(engine, *row.limits) for engine in asked for row in ROWS}
    scores = score_cases(cases, wanted)
    rows = [
        (
            row.label,
            _limits(row.limits),
            *(
                cell
                for engine, target in row.wanted.items()
                for cell in (_cell(scores, engine_group(engine, *row.limits), row), target)
            ),
        )
        for row in ROWS
    ]
    return markdown_table(("score", "limits", "Bullet", "wanted", "MuJoCo", "wanted"), rows)


def _limits(limits: tuple[float, ...]) -> str:
    if not limits:
        return "all"
    low, high = limits
    return f"{low:g}+" if math.isinf(high) else f"{low:g}-{high:g}"


def _cell(scores: dict[tuple[str, str], Scores], group: str, row: Row) -> str:
    found = [scores.get((tier, group), {}).get(row.code) for tier in TIERS]
    counts = [score.count if score else 0 for score in found]
    if not any(counts):
        return "-"
    values = " / ".join(_shown(score, row.is_share) if score else "-" for score in found)
    return f"{values} ({counts[0] if len(set(counts)) == 1 else ', '.join(map(str, counts))})"


def _shown(score: Score, is_share: bool) -> str:
    value = _number(score.value)
    return f"{value} [{_number(score.low)}, {_number(score.high)}]" if is_share else value


def _number(value: float) -> str:
    """Two digits without a leading zero; half and whole numbers as they are."""
    if value >= 1 or value == 0:
        return f"{value:.3g}"
    return f"{value:.2f}".replace("0.", ".", 1)


def outcomes_table(cases: Sequence[Case]) -> str:
    """What the verdicts came to, at tiers B / M / T."""
    columns: dict[str, list[Case]] = {
        "single, 2+": [c for c in cases if c.kind == Kind.SINGLE and c.relative >= STRONG[0]],
        "single, below 2": [c for c in cases if c.kind == Kind.SINGLE and c.relative < STRONG[0]],
        **{
            kind: [c for c in cases if c.kind == kind]
            for kind in (Kind.PAIR, Kind.UNKNOWN, Kind.NONE, Kind.REFERENCE)
        },
    }
    columns = {name: chosen for name, chosen in columns.items() if chosen}
    lines = ("named rightly", "named in part", "named wrongly", "none", "unknown", "unresolved")
    rows = [
        (line, *(_counts([c for c in own if _outcome(c) == line]) for own in columns.values()))
        for line in lines
    ]
    return markdown_table(("verdict", *columns), rows)


def _outcome(case: Case) -> str:
    """The kind of a verdict; of names whether all, some or none of it acts."""
    if not is_named(case):
        return str(case.verdict.kind)
    return "named rightly" if right(case) else "named wrongly" if wrong(case) else "named in part"


def _counts(cases: Sequence[Case]) -> str:
    return " / ".join(str(sum(case.tier == tier for case in cases)) for tier in TIERS)


if __name__ == "__main__":
    main()
