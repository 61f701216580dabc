"""Minus log probability of the truth, by kind of campaign, of several diagnoses of a spent pack.

    python studies/blind_log_loss.py DATA KEY DIAGNOSES [DIAGNOSES ...] [--tier M --tier T]

By this two versions of the diagnosis are compared on campaigns whose truth is known: those of a
pack that was scored, or of an open one. Prints a table in Markdown with the mean over the campaigns
of each engine and kind at each tier [nat], one column for each folder of diagnoses. Of a pair it is
the more probable of the two effects' classes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vsr2.blind.form.pack_settings import EngineName, Kind
from vsr2.blind.form.seal import open_key
from vsr2.blind.scoring.cases import Case, read_cases
from vsr2.blind.scoring.score import SCORING
from vsr2.campaign import TIERS
from vsr2.report.text import markdown_table


def log_loss(case: Case) -> float:
    """- ln of the probability of a true class, at least `SCORING.least_probability`."""
    found = max(case.class_probabilities.get(name, 0.0) for name in case.truth)
    return float(-np.log(np.clip(found, SCORING.least_probability, 1.0)))


def main() -> None:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("key", type=Path)
    parser.add_argument("diagnoses", type=Path, nargs="+")
    parser.add_argument("--tier", action="append", choices=TIERS, help="default: all of the pack")
    options = parser.parse_args()
    key = open_key(options.data, options.key)
    found = [read_cases(options.data, key, one, options.tier) for one in options.diagnoses]
    rows = []
    for engine in EngineName:
        for kind in Kind:
            for tier in TIERS:
                own = [
                    [
                        log_loss(c)
                        for c in cases
                        if (c.engine, c.kind, c.tier) == (engine, kind, tier)
                    ]
                    for cases in found
                ]
                if own[0]:
                    means = [f"{np.mean(one):.2f}" for one in own]
                    rows.append([engine, kind, tier, str(len(own[0])), *means])
    names = [str(one) for one in options.diagnoses]
    print(markdown_table(["engine", "kind", "tier", "campaigns", *names], rows))


if __name__ == "__main__":
    main()
