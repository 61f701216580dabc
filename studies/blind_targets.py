"""A blind check's scores against the targets for them, and its verdicts, as tables in Markdown.

    python studies/blind_targets.py docs/results/blind_validation_5

Reads a results folder of `blind_check.py` (:mod:`blind_results`). Targets are for
about 580 trials and for effects of 2 detection limits or more; a score is given for that group at
tiers B / M / T, by engine, and for all campaigns of the engine where the group is small. Numbers in
brackets are campaigns; where tiers differ, one a tier. The second table counts what the verdicts of
both engines came to: of single effects those whose true class is the most probable answer, and all.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from blind_results import SCORES, read_gz, read_parts, verdict_rows
from vsr2.blind.form.diagnosis_form import NAMING
from vsr2.blind.scoring.score import NOT_NONE
from vsr2.diagnosis.verdict.statements import VerdictKind

TIERS = ("B", "M", "T")
STRONG = "engine {engine}, limit x 2+"
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
        "most probable answer is the true class",
        "most probable answer, whatever the verdict (single)",
        ".70 / .85 / .92; .10 less",
        (STRONG, ALL),
    ),
    Row(
        "the same, where the verdict names it",
        "top-1 class (single)",
        ".70 / .85 / .92; .10 less",
    ),
    Row(
        "the true class leads all other effects",
        "most probable effect's class, whatever the verdict (single)",
        "-",
        (STRONG, ALL),
    ),
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
    Row("false alarms: named without a gap", "false alarms (none)", ".05; .10", (ALL,)),
    Row(
        "anything but `none` without a gap, `unresolved` too",
        NOT_NONE,
        "-",
        (ALL,),
    ),
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
        "where: mass over share of trials, smallest location",
        "where: median mass over share of trials, smallest location",
        "above 1",
    ),
    Row("where: false locations", "where: false locations (none)", ".05", (ALL,)),
    Row("pair called", "pair found (pair)", "-", (ALL,)),
)

STRONG_MAGNITUDE = 2.0
"""Magnitude over the detection limit from which an effect counts as strong."""
NAMED = "effects named"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    results = parser.parse_args().results
    rows = verdict_rows(list(read_parts(results)))
    print(targets_table([*read_gz(results / SCORES)["scores"], *not_none(rows)]))
    print()
    print(outcomes_table(rows))


def outcomes_table(rows: list[dict[str, Any]]) -> str:
    """What the verdicts came to.

    Args:
        rows: of `verdicts.csv` (:func:`blind_results.verdict_rows`).
    """
    single = [row for row in rows if row["kind"] == "single"]
    columns = {
        "single, 2+": [row for row in single if float(row["magnitude"]) >= STRONG_MAGNITUDE],
        "single, below 2": [row for row in single if float(row["magnitude"]) < STRONG_MAGNITUDE],
        **{kind: [r for r in rows if r["kind"] == kind] for kind in ("pair", "unknown", "none")},
    }
    lines = [f"| verdict | {' | '.join(columns)} |", "| --- |" + " --- |" * len(columns)]
    for line in sorted({_outcome(row) for row in rows}, key=lambda line: (line != NAMED, line)):
        cells = [
            _counts([row for row in chosen if _outcome(row) == line]) for chosen in columns.values()
        ]
        lines.append(f"| {line} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _outcome(row: dict[str, Any]) -> str:
    """The kind of a verdict and, of an unresolved one, the code of its last reason."""
    if VerdictKind(row["verdict"]) in NAMING:
        return NAMED
    code = f": `{row['withheld']}`" if row["withheld"] else ""
    return f"`{row['verdict']}`{code}"


def _counts(rows: list[dict[str, Any]]) -> str:
    """Verdicts a tier; of single effects also those whose most probable answer is right."""
    cells = []
    for tier in TIERS:
        chosen = [row for row in rows if row["tier"] == tier]
        leads = sum(row["leads"] == 1 for row in chosen)
        single = any(row["kind"] == "single" for row in chosen)
        cells.append(f"{leads} of {len(chosen)}" if single else str(len(chosen)))
    return " / ".join(cells)


def not_none(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The share of gap-free campaigns that are not called so, which early rounds did not record.

    Args:
        rows: of `verdicts.csv`.
    """
    free = [row for row in rows if row["kind"] == "none"]
    out = []
    for engine, tier in sorted({(row["engine"], row["tier"]) for row in free}):
        own = [r["verdict"] != "none" for r in free if (r["engine"], r["tier"]) == (engine, tier)]
        group, value = ALL.format(engine=engine), sum(own) / len(own)
        out.append(
            {"group": group, "tier": tier, "score": NOT_NONE, "value": value, "campaigns": len(own)}
        )
    return out


def targets_table(scores: Sequence[dict[str, Any]]) -> str:
    """The table.

    Args:
        scores: of all parts, as `scores.json` has them.
    """
    found = {(s["group"], s["score"], s["tier"]): s for s in scores}
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
