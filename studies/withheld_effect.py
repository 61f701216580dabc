"""Whether the diagnosis notices a cause of which it knows nothing at all.

    python studies/withheld_effect.py [--effects NAME ...] [--campaigns N] [--planted N]
        [--tier TIER] [--seed N] [--out FILE]

A campaign that excludes an effect tells the diagnosis so. Its posterior was trained on simulated
campaigns of that effect, which it learned to call outside of the library. A rock has causes that
nobody has simulated. So each effect is withheld in two ways from diagnoses of planar blocks
(Housner's equation) whose cause it is: *excluded*, as packs of blind checks do it, and *unknown*,
by a posterior whose library and training campaigns never had it.

Writes one row an effect and way: number of planted campaigns with the effect alone, of two
detection limits or more; the mean probability of a cause outside, of campaigns with the effect and
of those with others; the area under the curve (AUROC) by which the first exceeds the second; shares
of campaigns with the effect that are said to be unknown, and that get a name, which is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planar.planar_simulator import PlanarSimulator
from planted import Rehearsal, shaken_campaign
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns, simulate_campaigns
from vsr2.posterior.naming import VerdictKind
from vsr2.posterior.training import Found, Posterior, train
from vsr2.results.atomic import csv_text, write_text

EFFECTS = ("catch", "com_offset", "inertia", "restitution", "table_gain", "wear")
STRONG = 2.0
"""Size from which an effect is strong [detection limits]."""
OTHERS = 400
"""Campaigns with no effect or others that are held against them."""


def without(campaigns: Campaigns, name: str) -> Campaigns:
    """Those in which an effect does not act."""
    rows = [k for k, acting in enumerate(campaigns.sets) if all(a.name != name for a in acting)]
    series = campaigns.features
    return Campaigns(
        tuple(campaigns.sets[k] for k in rows),
        campaigns.nuisances[rows],
        campaigns.overturned[rows],
        campaigns.peak_tilt[rows],
        None if series is None else series[rows],
    )


def judged(
    way: str, name: str, inferred: tuple[Sequence[Found], Sequence[Found]]
) -> dict[str, Any]:
    """One row: of campaigns that have the effect, and of those that have none or another."""
    from scipy.stats import mannwhitneyu

    own, others = (np.array([float(one.probability[-1]) for one in part]) for part in inferred)
    kinds = [one.naming.kind for one in inferred[0]]
    return {
        "effect": name,
        "withheld": way,
        "campaigns": own.size,
        "outside": own.mean(),
        "outside_of_others": others.mean(),
        "auroc": mannwhitneyu(own, others).statistic / (own.size * others.size),
        "said_unknown": float(np.mean([kind is VerdictKind.UNKNOWN for kind in kinds])),
        "named": float(np.mean([kind.names_effects for kind in kinds])),
    }


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effects", nargs="+", default=EFFECTS)
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--planted", type=int, default=2000)
    parser.add_argument("--tier", default="M")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/withheld_effect.csv"))
    options = parser.parse_args()
    schedule = shaken_campaign(seed=options.seed)
    series = options.tier == "T"
    own, truth = (
        PlanarSimulator(schedule, series=series, seed=seed + options.seed) for seed in (1, 10_000)
    )
    rehearsal = Rehearsal(own, schedule, campaigns=options.campaigns, seed=options.seed)
    with SimulationCache(truth, None, chunk=8192) as cache:
        planted = simulate_campaigns(
            cache, rehearsal.look, rehearsal.trials, range(options.planted), seed=options.seed + 5
        )
    seen = rehearsal.at(options.tier)
    noise = np.random.default_rng(options.seed)
    features = seen.noted(planted.overturned, planted.peak_tilt, planted.features, noise)
    library = rehearsal.cache.simulator.library
    alone = [acting[0] if len(acting) == 1 else None for acting in planted.sets]

    def infer(
        posterior: Posterior, rows: NDArray[np.int64], excluded: Collection[str] = ()
    ) -> list[Found]:
        return [posterior.infer(planted.overturned[k], features[k], excluded) for k in rows]

    table: list[dict[str, Any]] = []
    for name in options.effects:
        has = np.array([one is not None and one.name == name for one in alone])
        strong = np.array([one is not None and one.size >= STRONG for one in alone])
        other = np.array([all(a.name != name for a in acting) for acting in planted.sets])
        if not (has & strong).any():
            parser.error(
                f"--effects {name}: no planted campaign has it alone and strong; plant more"
            )
        groups = np.flatnonzero(has & strong), np.flatnonzero(other)[:OTHERS]
        excluding, unaware = rehearsal.posterior(options.tier), train(
            seen, without(rehearsal.campaigns, name),
            {key: one for key, one in library.items() if key != name},
            rehearsal.trials, seed=options.seed,
        )  # fmt: skip
        strong_ones, others = groups
        excluding_it = infer(excluding, strong_ones, (name,)), infer(excluding, others, (name,))
        unaware_of_it = infer(unaware, strong_ones), infer(unaware, others)
        table += [judged("excluded", name, excluding_it), judged("unknown", name, unaware_of_it)]
        print(csv_text(table[-2:], ".3g"), flush=True)
        write_text(options.out, csv_text(table, ".3g"))


if __name__ == "__main__":
    main()
