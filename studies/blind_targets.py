"""A blind check's scores against the targets for them, as a table in Markdown.

    python studies/blind_targets.py docs/results/blind_validation_4

Reads `scores.json` of a results folder of `blind_check.py`. Targets are for about 580 trials and
for effects of 2 floors or more; a score is given for that group at tiers B / M / T, by engine, and
for all campaigns of the engine where the group is small. Numbers in brackets are campaigns; where
tiers differ, one a tier.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TIERS = ("B", "M", "T")
STRONG = "engine {engine}, floor x 2+"
ALL = "engine {engine}"
WHERE = {STRONG: "2+", ALL: "all"}


@dataclass(frozen=True)
class Row:
    """One line: a score of `scores.json`, the groups it is shown for, and what is wanted."""

    label: str
    score: str
    wanted: str
    groups: tuple[str, ...] = (STRONG,)


ROWS = (
    Row(
        "most probable class is the true one",
        "most probable class, whatever the verdict (single)",
        ".70 / .85 / .92; .10 less",
        (STRONG, ALL),
    ),
    Row("the same, where the verdict names effects", "top-1 class (single)", "-"),
    Row("90 % set: coverage", "90 % set: coverage", ".87 to .95; .85", (STRONG, ALL)),
    Row("90 % set: median size", "90 % set: median size", "4 / 2 / 2; -"),
    Row("log score below uniform", "log score below uniform", ".40 / .60 / .75; .35 (M)"),
    Row("calibration error", "calibration error", ".05; .10", (STRONG, ALL)),
    Row(
        "the same, were what is stated true",
        "calibration error: of true probabilities",
        "-",
        (STRONG, ALL),
    ),
    Row("false alarms", "false alarms (none)", ".05; .10", (ALL,)),
    Row("unknown: AUROC", "unknown: AUROC", ".70 / .85 / .90; .75 (M)", (STRONG, ALL)),
    Row("unknown: rate at 5 % false alarms", "unknown: rate at 5 % false alarms", "-"),
    Row(
        "magnitude: median relative error",
        "magnitude: median relative error",
        ".35 / .20 / .15; .35",
    ),
    Row(
        "magnitude: 95 % interval holds the truth",
        "magnitude: interval coverage",
        ".85 of 90 % intervals; -",
        (STRONG, ALL),
    ),
    Row(
        "magnitude: width of that interval over the size",
        "magnitude: median width of interval",
        "-",
    ),
    Row(
        "closure over the oracle's, median",
        "closure over oracle: median",
        ".75 / .85 / .90; .65",
    ),
    Row(
        "the same, 0 where no effect is named",
        "closure over oracle, 0 where no effect is named: median",
        "-",
    ),
    Row("closure below 0 beyond its interval", "closure below 0 beyond its interval", "0", (ALL,)),
    Row("where: mass inside, median", "where: median mass inside", ".80; .70"),
    Row(
        "where: mass over share of trials, smallest place",
        "where: median mass over share of trials, smallest place",
        "above 1",
    ),
    Row("where: false places", "where: false places (none)", ".05", (ALL,)),
    Row("pair called", "pair found (pair)", "-", (ALL,)),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    scores = json.loads((parser.parse_args().results / "scores.json").read_text())
    print(targets_table(scores))


def targets_table(scores: dict[str, Any]) -> str:
    """The table.

    Args:
        scores: content of `scores.json`.
    """
    found = {(s["group"], s["score"], s["tier"]): s for s in scores["scores"]}
    lines = [
        "| score | group | Bullet | MuJoCo | wanted (Bullet; MuJoCo) |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in ROWS:
        for group in row.groups:
            cells = [_cell(found, group.format(engine=e), row.score) for e in ("bullet", "mujoco")]
            lines.append(f"| {row.label} | {WHERE[group]} | {' | '.join(cells)} | {row.wanted} |")
    return "\n".join(lines)


def _cell(found: dict[tuple[str, str, str], dict[str, Any]], group: str, score: str) -> str:
    tiers = [found.get((group, score, tier)) for tier in TIERS]
    counts = [str(s["campaigns"]) if s else "0" for s in tiers]
    values = " / ".join(_number(s["value"]) if s else "-" for s in tiers)
    return f"{values} ({', '.join(counts) if len(set(counts)) > 1 else counts[0]})"


def _number(value: float) -> str:
    """Two digits without a leading zero; half and whole numbers as they are."""
    if value >= 1 or value == 0:
        return f"{value:.3g}"
    return f"{value:.2f}".replace("0.", ".", 1)


if __name__ == "__main__":
    main()
