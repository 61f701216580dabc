"""Tables for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vsr2.one_line import counted
from vsr2.report.messages.runs import (
    INTERRUPTED_TRIALS,
    STATUS_MEANING,
    engine_in_use,
    more_failures,
    time_spent,
    trial_end,
)
from vsr2.results import OUTCOMES, STATUSES, BatchResult

MAX_FAILURES = 10
"""Failures that `summary_table` shows one by one."""


def printable(text: object) -> str:
    """Text for one line of a terminal or figure: what cannot be shown becomes `?`.

    Names come from files of others and may hold line breaks, escape codes or undecodable bytes.
    """
    return "".join(c if c.isprintable() else "?" for c in str(text))


def as_markdown(text: object) -> str:
    """Text for one line of Markdown: no HTML, no link or picture, no cell of a table ends in it."""
    shown = printable(text)
    for sign, written in (("&", "&amp;"), ("<", "&lt;"), ("|", "\\|"), ("](", "]\\(")):
        shown = shown.replace(sign, written)
    return shown


def summary_table(result: BatchResult) -> str:
    """Counts of outcomes, statuses and engines, why trials failed, timing."""
    count = len(result)
    lines = [counted(count, "trial"), "", "outcome"]
    lines += _counts(result["outcome"], OUTCOMES, count, dict.fromkeys(OUTCOMES, ""))
    lines += ["", "status"]
    lines += _counts(result["status"], STATUSES, count, STATUS_MEANING)
    lines += _engines(result)
    lines += _failures(result)
    lines += _timing(result)
    return "\n".join(lines)


def _counts(values: Any, order: Sequence[str], count: int, meaning: Mapping[Any, str]) -> list[str]:
    lines = []
    for name in order:
        number = int(np.count_nonzero(values == name))
        if number:
            line = f"  {name:<17}{number:>7}  {100 * number / count:5.1f} %  {meaning[name]}"
            lines.append(line.rstrip())
    return lines or ["  none"]


def _engines(result: BatchResult) -> list[str]:
    count = len(result)
    used = [
        engine_in_use(engine, hand_over)
        for engine, hand_over in zip(result["engine"], result["hand_over"], strict=True)
        if engine
    ]
    if not used:
        return []
    width = max(17, *(len(name) + 1 for name in used))
    lines = ["", "engine"]
    for name, number in sorted(Counter(used).items()):
        lines.append(f"  {name:<{width}}{number:>7}  {100 * number / count:5.1f} %")
    return lines


def _failures(result: BatchResult) -> list[str]:
    failed = [(row, end) for row in result if (end := trial_end(row))]
    if not failed:
        return []
    lines = ["", "messages"]
    for row, end in failed[:MAX_FAILURES]:
        where = f"  trial {row['trial']} ({printable(row['name'])}), {row['status']}: "
        lines.append(where + printable(end))
    if len(failed) > MAX_FAILURES:
        lines.append("  " + more_failures(len(failed) - MAX_FAILURES))
    return lines


def _timing(result: BatchResult) -> list[str]:
    steps = int(np.sum(result["steps"]))
    simulated = float(np.nansum(result["simulated_time"]))
    seen = result.provenance
    spent = time_spent(simulated, steps, seen.get("wall_time_s"), seen.get("threads"))
    lines = ["", "time", f"  {spent}"]
    if seen.get("interrupted"):
        lines.append(f"  {INTERRUPTED_TRIALS}")
    return lines


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown; what its cells hold stays text."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(as_markdown, line)) + " |" for line in lines)
