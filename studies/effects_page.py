"""The generated parts of the pages on the library of effects.

    python studies/effects_page.py [--out docs]

Writes, between the markers of each page, the entries of docs/reference/effects.md and the table of
docs/validation/effects.md, which `studies/check_effects.py` measured.
"""

from __future__ import annotations

import argparse
import csv
import inspect
import math
import textwrap
from collections.abc import Iterator
from pathlib import Path

from vsr2.effects.effect import Effect
from vsr2.effects.order import StepEffect
from vsr2.effects.parameter import Parameter
from vsr2.effects.registry import BUILT_IN, in_order

DOCS = Path(__file__).resolve().parent.parent / "docs"


def main() -> None:
    """Write both pages, what stands outside the markers unchanged."""
    parser = argparse.ArgumentParser(description="Write the pages on the library of effects.")
    parser.add_argument("--out", type=Path, default=DOCS)
    out = parser.parse_args().out
    checks = (DOCS / "results" / "effects" / "checks.csv").read_text(encoding="utf-8")
    effects = in_order({effect.name: effect for effect in BUILT_IN})
    entries = "\n".join(line for effect in effects for line in _section(effect))
    generated = {
        "reference": entries,
        "validation": f"{_checks_table(checks)}\n\n{_not_alive(checks)}",
    }
    for folder, text in generated.items():
        page = (DOCS / folder / "effects.md").read_text(encoding="utf-8")
        before, _, rest = page.partition("<!-- generated -->\n")
        _, _, after = rest.partition("<!-- end -->")
        (out / folder).mkdir(parents=True, exist_ok=True)
        (out / folder / "effects.md").write_text(
            f"{before}<!-- generated -->\n\n{text.strip()}\n\n<!-- end -->{after}", encoding="utf-8"
        )


def _rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def _not_alive(text: str) -> str:
    """What the table says of effects that fail to be alive."""
    found = [
        f"`{row['effect']}` on the {rock} ({row[f'alive_{rock}']})"
        for row in _rows(text)
        for rock in _ROCKS
        if float(row[f"alive_{rock}"]) <= 3.0
    ]
    if not found:
        return "No effect fails."
    return f"Not alive, hardly different from chance: {', '.join(found)}."


def _checks_table(text: str) -> str:
    rows = _rows(text)
    out = [
        "| effect | neutral | step | alive, block | alive, scan | other end | right | fast "
        "| shift |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        ends = [row[f"other_end_{rock}"] for rock in _ROCKS]
        cells = [f"`{row['effect']}`", "yes" if row["neutral"] == "true" else "NO"]
        steps = [row[f"step_{rock}"] for rock in _ROCKS]
        cells.append(steps[0] if steps[0] in ("jump", "none") else ", ".join(steps))
        cells += [f"{row[f'alive_{rock}']} ({row[f'feature_{rock}']})" for rock in _ROCKS]
        cells += [", ".join(ends) if all(ends) else "", row["right"]]
        if row["fast"] == "yes":
            cells.append(", ".join(row[f"early_{rock}_rad"] for rock in _ROCKS))
            shifts = (f"{row[f'shift_{r}']} +- {row[f'shift_error_{r}']}" for r in _ROCKS)
            cells.append(", ".join(shifts))
        else:
            cells += ["not taken", ""]
        out.append("| " + " | ".join(cells) + " |")
    return "\n".join(out)


_ROCKS = ("block", "scan")


def _section(effect: Effect) -> Iterator[str]:
    yield f"### `{effect.name}`\n"
    details = (inspect.getdoc(type(effect)) or "").partition("\n\n")[2]
    jump = f" Jumps beside null: {effect.jump}." if effect.jump else ""
    yield _wrapped(f"{effect.meaning}. {details}{jump}") + "\n"
    yield "| parameter | unit | prior | none given | meaning |"
    yield "| --- | --- | --- | --- | --- |"
    for parameter in effect.parameters:
        # A step repeats the parameters of many effects; those with a prior tell the most.
        if not (isinstance(effect, StepEffect) and parameter.prior == "fixed"):
            yield _row(parameter)
    confounded = ", ".join(f"`{name}`" for name in effect.confounded_with) or "nothing listed"
    touched = ", ".join(effect.channels)
    facts = f"Stage {effect.stage}. Touches {touched}. Confounded with {confounded}."
    yield "\n" + _wrapped(f"{facts} Source: {effect.source}.") + "\n"
    yield f"![{effect.name}](../results/effects/{effect.name}.png)\n"


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), 99, break_long_words=False)


def _row(parameter: Parameter) -> str:
    null = "as in the study" if math.isnan(parameter.null) else f"{parameter.null:g}"
    if parameter.choices:
        null = parameter.choices[int(parameter.null)]
    unit = "" if parameter.unit == "1" else parameter.unit
    prior = parameter.range_text
    if parameter.prior == "fixed" and not parameter.choices:
        prior = "fixed"
    cells = (f"`{parameter.name}`", unit, prior, null, parameter.meaning)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    main()
