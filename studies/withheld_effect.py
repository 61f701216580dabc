"""Whether the diagnosis notices a cause of which it knows nothing at all.

    python studies/withheld_effect.py [--effects NAME ...] [--campaigns N] [--planted N]
        [--tier TIER] [--seed N] [--out FILE]

A campaign that excludes an effect tells the diagnosis so. Its posterior was trained on simulated
campaigns of that effect, which it learned to call outside of the library. A rock has causes that
nobody has simulated. So each effect, with those of its class, which push a block as it does, is
withheld in two ways from diagnoses of planar blocks (Housner's equation) whose cause it is:
*excluded*, as packs of blind checks do it, and *unknown*, by a posterior whose library and training
campaigns never had it.

Writes one row an effect and way: number of planted campaigns with the effect alone, of two
detection limits or more; the mean probability of a cause outside, of campaigns with the effect and
of those without; the area under the curve (AUROC) by which the first exceeds the second; shares
of campaigns with the effect that are said to be unknown, and that get a name, which is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis_planar import class_of
from planar.planar_library import PLANAR_LIBRARY
from planar.planar_simulator import PlanarSimulator
from planted import Rehearsal, chosen, shaken_campaign
from vsr2.campaign import TIERS
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns, simulate_campaigns
from vsr2.posterior.naming import VerdictKind
from vsr2.posterior.training import Found, Posterior, train
from vsr2.results.atomic import csv_text, write_text

EFFECTS = ("catch", "com_offset", "inertia", "restitution", "table_gain", "wear")
STRONG = 2.0
"""Size from which an effect is strong [detection limits]."""
OTHERS = 400
"""Campaigns without the effect and its class that are held against them."""


def without(campaigns: Campaigns, names: Collection[str]) -> NDArray[np.int64]:
    """Indices of those in which none of some effects acts."""
    return np.array(
        [k for k, acting in enumerate(campaigns.sets) if not {a.name for a in acting} & set(names)],
        dtype=np.int64,
    )


def judged(
    way: str, name: str, inferred: tuple[Sequence[Found], Sequence[Found]]
) -> dict[str, Any]:
    """One row: of campaigns that have the effect, and of those without its class."""
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
    parser.add_argument("--effects", nargs="+", default=EFFECTS, choices=sorted(PLANAR_LIBRARY))
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--planted", type=int, default=6000)
    parser.add_argument("--tier", default="M", choices=TIERS)
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
    strong = {
        name: np.array(
            [
                k
                for k, acting in enumerate(planted.sets)
                if [one.name for one in acting] == [name] and acting[0].size >= STRONG
            ],
            dtype=np.int64,
        )
        for name in options.effects
    }
    if rare := [name for name, rows in strong.items() if not rows.size]:
        parser.error(f"--effects {rare[0]}: is strong and alone in no planted campaign; plant more")

    def infer(
        posterior: Posterior, rows: NDArray[np.int64], excluded: Collection[str] = ()
    ) -> list[Found]:
        return [posterior.infer(planted.overturned[k], features[k], excluded) for k in rows]

    table: list[dict[str, Any]] = []
    for name, own_rows in strong.items():
        lacking = class_of(name)
        others = without(planted, lacking)[:OTHERS]
        excluding = rehearsal.posterior(options.tier)
        unaware = train(
            seen,
            chosen(rehearsal.campaigns, without(rehearsal.campaigns, lacking)),
            {key: one for key, one in library.items() if key not in lacking},
            rehearsal.trials,
            seed=options.seed,
        )
        by_excluding = infer(excluding, own_rows, lacking), infer(excluding, others, lacking)
        by_unaware = infer(unaware, own_rows), infer(unaware, others)
        table += [judged("excluded", name, by_excluding), judged("unknown", name, by_unaware)]
        print(csv_text(table[-2:], ".3g"), flush=True)
        write_text(options.out, csv_text(table, ".3g"))


if __name__ == "__main__":
    main()
