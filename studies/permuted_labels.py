"""Whether a blind round's scores come from its truth: its effects are dealt to other campaigns.

    python studies/permuted_labels.py docs/results/blind_validation_13 [--deals N] [--seed N]

Reads a results folder of `blind_check.py --score`. The effects of its strong single campaigns,
those of two detection limits or more, are dealt among them at random, of each engine and tier, and
the verdicts stay. A score that is no better with the sealed effects than with dealt ones tells
nothing. Prints, by engine and tier, the share of campaigns whose true class leads the effects, and
the share that is named rightly: sealed, and the mean over the deals.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from blind_results import read_parts
from blind_targets import STRONG
from vsr2.blind.form.pack_settings import EngineName, Kind
from vsr2.blind.scoring.cases import Case
from vsr2.blind.scoring.score import is_named, right
from vsr2.campaign import TIERS
from vsr2.report.text import markdown_table


def leads(case: Case) -> bool:
    """Whether the class of the effect is the most probable of all classes of effects."""
    own = [name for name in case.class_probabilities if name not in ("none", "unknown")]
    return own[:1] == list(case.truth[:1])


def shares(cases: Sequence[Case]) -> tuple[float, float]:
    """Of campaigns whose class leads, and that are named rightly."""
    named = [is_named(case) and right(case) for case in cases]
    return float(np.mean([leads(case) for case in cases])), float(np.mean(named))


def dealt(cases: Sequence[Case], rng: np.random.Generator) -> list[Case]:
    """Verdicts with the effects of other campaigns."""
    order = rng.permutation(len(cases))
    return [
        replace(case, truth=cases[k].truth, effects=cases[k].effects)
        for case, k in zip(cases, order, strict=True)
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--deals", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    cases = [case for part in read_parts(options.results) for case in part]
    rng = np.random.default_rng(options.seed)
    rows = []
    for engine in EngineName:
        for tier in TIERS:
            own = [
                case
                for case in cases
                if (case.engine, case.tier, case.kind) == (engine, tier, Kind.SINGLE)
                and case.relative >= STRONG[0]
            ]
            if not own:
                continue
            found = np.mean([shares(dealt(own, rng)) for _ in range(options.deals)], axis=0)
            sealed = shares(own)
            cells = [f"{x:.2f}" for pair in zip(sealed, found, strict=True) for x in pair]
            rows.append((str(engine), tier, str(len(own)), *cells))
    header = ("engine", "tier", "campaigns", "leads", "dealt", "named rightly", "dealt")
    print(markdown_table(header, rows))


if __name__ == "__main__":
    main()
