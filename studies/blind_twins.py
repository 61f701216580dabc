"""Causes outside the library of a scored blind pack, with and without their twins in it.

    python studies/blind_twins.py RESULTS DATA VERDICTS [--tier TIER ...] [--out FOLDER]

Packs of the fourteenth round and before withhold the class of an unknown cause by their own
classes; effects that the library declares alike to it may stay, and one of these may get the name.
This diagnoses the unknown campaigns again with them withheld, too: what nobody can tell from a
cause is as unknown as the cause. RESULTS is what `blind_check.py --score` wrote, DATA the pack,
VERDICTS its diagnoses, whose simulations serve. Prints, by tier and engine, what the verdicts on
unknown causes come to, as scored and again, and the AUROC by which their probability of a cause
outside exceeds that of the other campaigns of the engine, all of them and those from two detection
limits.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from blind_results import read_parts
from blind_targets import STRONG
from vsr2.analysis.intervals import area_under_roc
from vsr2.blind import diagnose_pack
from vsr2.blind.form.diagnosis_form import read_verdict
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import PACK_FILE, read_json
from vsr2.blind.pack_diagnoses import SUBMISSION
from vsr2.blind.scoring.cases import Case
from vsr2.blind.scoring.score import is_named
from vsr2.campaign import TIERS
from vsr2.diagnosis import Budget
from vsr2.effects import library
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.library import UNKNOWN
from vsr2.posterior.sets import with_alike
from vsr2.report.text import markdown_table


def diagnosed_again(cases: Sequence[Case], data: Path, verdicts: Path, out: Path) -> list[Case]:
    """Unknown campaigns, diagnosed without the twins of their causes."""
    own = {
        case.id: sorted(with_alike(case.exclude, library()))
        for case in cases
        if case.kind == Kind.UNKNOWN
    }
    copied, found = out / "data", out / "verdicts"
    if not copied.exists():
        shutil.copytree(data.resolve(), copied, copy_function=os.symlink)
        pack = read_json(copied / PACK_FILE)
        for entry in pack["campaigns"]:
            entry["exclude"] = own.get(entry["id"], entry["exclude"])
        (copied / PACK_FILE).unlink()
        (copied / PACK_FILE).write_text(json.dumps(pack))
    found.mkdir(exist_ok=True)
    if not (found / SIMULATIONS).exists():
        shutil.copy(verdicts / SIMULATIONS, found)
    tiers = [tier for tier in TIERS if any(case.tier == tier for case in cases)]
    asked = read_json(verdicts / SUBMISSION)
    budget = Budget(campaigns=asked["campaigns"], held_out=False)
    diagnose_pack(
        copied, found, tiers=tiers, campaigns=sorted(own), budget=budget, seed=asked["seed"]
    )
    return [
        replace(case, verdict=read_verdict(found / case.id / case.tier))
        for case in cases
        if case.kind == Kind.UNKNOWN
    ]


def row(label: str, unknown: Sequence[Case], others: Sequence[Case]) -> tuple[str, ...]:
    """Counts of verdicts, and the AUROC of all and of strong ones."""

    def auroc(own: Sequence[Case]) -> str:
        rows = [
            [case.verdict.probabilities.get(UNKNOWN, 0.0), float(case.kind == Kind.UNKNOWN)]
            for case in (*own, *others)
        ]
        return f"{area_under_roc(np.array(rows)[None])[0]:.2f} ({len(own)})"

    named = sum(is_named(case) for case in unknown)
    said = [str(case.verdict.kind) for case in unknown if not is_named(case)]
    kinds = (said.count(kind) for kind in ("unknown", "unresolved", "none"))
    strong = [case for case in unknown if case.relative >= STRONG[0]]
    return label, str(named), *map(str, kinds), auroc(unknown), auroc(strong)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("verdicts", type=Path)
    parser.add_argument("--tier", action="append", choices=TIERS, help="default: all")
    parser.add_argument("--out", type=Path, default=Path("out/blind_twins"))
    options = parser.parse_args()
    (cases,) = read_parts(options.results)
    cases = [case for case in cases if case.tier in (options.tier or TIERS)]
    options.out.mkdir(parents=True, exist_ok=True)
    again = diagnosed_again(cases, options.data, options.verdicts, options.out)
    rows = []
    for tier in dict.fromkeys(case.tier for case in again):
        for engine in sorted({case.engine for case in cases}):
            mine = [case for case in cases if (case.tier, case.engine) == (tier, engine)]
            others = [case for case in mine if case.kind not in (Kind.UNKNOWN, Kind.REFERENCE)]
            scored = [case for case in mine if case.kind == Kind.UNKNOWN]
            without = [case for case in again if (case.tier, case.engine) == (tier, engine)]
            rows.append(row(f"{engine}, {tier}, with twins", scored, others))
            rows.append(row(f"{engine}, {tier}, without", without, others))
    header = ("unknown causes", "named", "`unknown`", "unresolved", "none", "AUROC", "strong")
    print(markdown_table(header, rows))


if __name__ == "__main__":
    main()
