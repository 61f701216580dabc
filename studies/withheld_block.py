"""Whether the diagnosis of a pack's scene recognises causes that it has never seen.

    python studies/withheld_block.py PACK/data SIMULATIONS [--campaigns N] [--tier TIER ...]
        [--out FILE] [--levels FILE]

Training withholds the library in parts, each with all that is declared alike to it, and calibrates
names on campaigns whose cause is withheld. Nothing that judges such a campaign has seen its effect:
regressions, network and curves have not, and what lies outside was learned from the other parts. So
these campaigns say what the diagnosis makes of an unknown cause. They are of its own engine.

SIMULATIONS is the `simulations.jsonl` of the pack's verdicts; what it lacks is simulated. Writes,
by tier, one row for each effect that acts alone with two detection limits or more, one of all of
them, and one of those from one limit: AUROC by which the probability of outside exceeds that of
campaigns whose cause is known or that have none, the share that exceeds 95 % of them, shares that
are said to be unknown and that get a name, which is wrong, the share of 90 % sets that hold a true
label, and their median size. The last rows are of single effects that the library has, strong and
others, and of campaigns without effect: shares that are said to be unknown, named, and named
wrongly, and sets.

A second table says what a name of one cause would cost at each level that its probability may be
asked to have: the share of all names that would be wrong, kinds counted by the prior, the share
whose cause lies outside, the share of strong single effects that would be named rightly, and what
names gain of a campaign, less what wrong ones cost. Its last column is the AUROC of outside among
campaigns with a gap alone.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import vsr2.diagnosis.pipeline as pipeline
import vsr2.posterior.training as training
from vsr2.blind import diagnose_pack
from vsr2.blind.form.seal import read_pack
from vsr2.campaign import TIERS
from vsr2.coverage.judged import true_labels
from vsr2.diagnosis import Budget
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.posterior.calibration import CALIBRATED, JudgedCampaigns, Levels, calibrate, label_set
from vsr2.posterior.naming import Naming, NamingLimits, VerdictKind, decide, is_wrong
from vsr2.posterior.training import Posterior, train
from vsr2.posterior.truth import Truth
from vsr2.results.atomic import csv_text, write_text

Array = NDArray[np.float64]
STRONG = 2.0
"""Size from which an effect is strong [detection limits]."""
LEVELS = (0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
"""Probabilities that a name of one cause may be asked to have."""


@dataclass
class Judging:
    """What calibration is given, and the sizes of what acts [detection limits]."""

    judged: list[tuple[JudgedCampaigns, Truth, Array, Levels]] = field(default_factory=list)
    sizes: list[Array] = field(default_factory=list)

    def calibrate(self, judged: JudgedCampaigns, truth: Truth, fit: Array) -> Levels:
        """As the training does."""
        levels = calibrate(judged, truth, fit)
        self.judged.append((judged, truth, fit, levels))
        return levels

    def train(self, seen: Any, campaigns: Any, library: Any, *more: Any, **how: Any) -> Posterior:
        """As the diagnosis does."""
        known = campaigns.within(library).sets
        self.sizes.append(np.array([max((one.size for one in s), default=0.0) for s in known]))
        return train(seen, campaigns, library, *more, **how)


def rows(tier: str, judging: Judging) -> list[dict[str, Any]]:
    """Of one tier."""
    from scipy.stats import mannwhitneyu

    judged, truth, fit, levels = judging.judged[-1]
    acts = truth.acting[judged.row]
    size = judging.sizes[-1][judged.row]
    said = [
        decide(one, levels.naming, truth.alike, fit=float(own))
        for one, own in zip(judged.found, fit, strict=True)
    ]
    unknown = np.array([one.kind is VerdictKind.UNKNOWN for one in said])
    named = np.array([one.kind.names_effects for one in said])
    outside, known = judged.labels[:, -1], ~judged.unknown
    others = outside[known]
    single = acts.sum(axis=1) == 1

    index = np.where(judged.unknown, truth.sets.outside, truth.index[judged.row])
    sets = [
        label_set(own, levels.set_level(one.kind))
        for own, one in zip(judged.labels, said, strict=True)
    ]
    holds = np.array(
        [bool(set(own) & true_labels(truth.sets, k)) for own, k in zip(sets, index, strict=True)]
    )
    sizes = np.array([len(own) for own in sets])

    def row(label: str, chosen: NDArray[np.bool_]) -> dict[str, Any]:
        own = outside[chosen]
        return {
            "tier": tier,
            "effect": label,
            "campaigns": own.size,
            "auroc": mannwhitneyu(own, others).statistic / (own.size * others.size),
            "above_95": float(np.mean(own > np.quantile(others, 0.95))),
            "said_unknown": float(unknown[chosen].mean()),
            "named": float(named[chosen].mean()),
            "named_wrongly": float(named[chosen].mean()),
            "set_holds": float(holds[chosen].mean()),
            "set_size": float(np.median(sizes[chosen])),
        }

    strong = judged.unknown & single & (size >= STRONG)
    out = [
        row("all from 2 limits", strong),
        row("all from 1", judged.unknown & single & (size >= 1)),
    ]
    out += [
        row(name, strong & acts[:, k])
        for k, name in enumerate(truth.sets.names)
        if (strong & acts[:, k]).any()
    ]
    wrong = [
        is_wrong(one, tuple(np.flatnonzero(acting).tolist()))
        for one, acting in zip(said, acts, strict=True)
    ]
    inside = {
        "in the library": known & single & (size >= STRONG),
        "in the library, weaker": known & single & (size < STRONG),
        "no effect": known & ~acts.any(axis=1),
    }
    return out + [
        row(label, chosen) | {"named_wrongly": float(np.array(wrong)[chosen].mean())}
        for label, chosen in inside.items()
    ]


def level_rows(tier: str, judging: Judging) -> list[dict[str, Any]]:
    """What a name of one cause would cost at one tier, a row for each level."""
    from sklearn.metrics import roc_auc_score

    judged, truth, fit, levels = judging.judged[-1]
    acts = truth.acting[judged.row]
    strong = ~judged.unknown & (acts.sum(axis=1) == 1)
    strong &= judging.sizes[-1][judged.row] >= STRONG
    owners = [tuple(np.flatnonzero(a).tolist()) for a in acts & ~judged.unknown[:, None]]

    def said(level: float) -> list[Naming]:
        limits = NamingLimits(levels.none_limit, level, np.inf)
        return [
            decide(one, limits, truth.alike, fit=float(own))
            for one, own in zip(judged.found, fit, strict=True)
        ]

    gap = np.array([one.kind is not VerdictKind.NONE for one in said(np.inf)])
    auroc = roc_auc_score(
        judged.unknown[gap], judged.labels[gap, -1], sample_weight=judged.weight[gap]
    )
    out = []
    for level in LEVELS:
        names = said(level)
        named = np.array([one.kind.names_effects for one in names])
        wrong = np.array([is_wrong(*one) for one in zip(names, owners, strict=True)])
        total = max(float(judged.weight[named].sum()), 1e-9)
        out.append(
            {
                "tier": tier,
                "level": level,
                "names": int(named.sum()),
                "wrong": float(judged.weight[named & wrong].sum()) / total,
                "outside": float(judged.weight[named & judged.unknown].sum()) / total,
                "strong_named_rightly": float((named & ~wrong)[strong].mean()),
                "gain": float(judged.weight @ (named - (1 + CALIBRATED.wrong) * wrong))
                / float(judged.weight.sum()),
                "auroc_of_gaps": auroc,
            }
        )
    return out


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("simulations", type=Path)
    parser.add_argument("--campaigns", type=int, default=4000)
    parser.add_argument("--tier", action="append", choices=TIERS, help="default: all")
    parser.add_argument("--out", type=Path, default=Path("out/withheld_block.csv"))
    parser.add_argument("--levels", type=Path, default=Path("out/withheld_block_levels.csv"))
    options = parser.parse_args()
    complete = next(one.id for one in read_pack(options.data).campaigns if not one.exclude)
    table: list[dict[str, Any]] = []
    levels: list[dict[str, Any]] = []
    for tier in options.tier or TIERS:
        judging = Judging()
        with (
            tempfile.TemporaryDirectory() as folder,
            patch.object(training, "calibrate", judging.calibrate),
            patch.object(pipeline, "train", judging.train),
        ):
            shutil.copy(options.simulations, Path(folder) / SIMULATIONS)
            diagnose_pack(
                options.data, Path(folder), tiers=[tier], campaigns=[complete],
                budget=Budget(campaigns=options.campaigns, held_out=False),
            )  # fmt: skip
        table += rows(tier, judging)
        levels += level_rows(tier, judging)
        write_text(options.out, csv_text(table, ".3g"))
        write_text(options.levels, csv_text(levels, ".3g"))
        print(csv_text(table[-1:], ".3g"), flush=True)


if __name__ == "__main__":
    main()
