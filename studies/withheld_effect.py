"""Whether the diagnosis recognises a cause that it has never seen.

    python studies/withheld_effect.py [--effects NAME ...] [--campaigns N] [--planted N]
        [--tier TIER] [--seed N] [--out FILE]

A rock has causes that nobody has simulated. So effects are withheld, each with those that are
declared alike to it: a posterior is trained whose library and simulated campaigns never
had them. It judges planar campaigns (Housner's equation) in which the effect acts alone, with two
detection limits or more, campaigns in which one of its library does, and campaigns without effect.

Writes one row an effect: number of planted campaigns that have it; the mean probability of a cause
outside, of these and of those without; the area under the curve (AUROC) by which the first exceeds
the second, and the share that exceeds 95 % of them; shares that are said to be unknown, and that
get a name, which is wrong; of campaigns with a known cause shares that are named rightly, wrongly
and said to be unknown; of campaigns without effect the share of which none is said.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planar.planar_library import PLANAR_LIBRARY
from planar.planar_simulator import PlanarSimulator
from planted import Rehearsal, shaken_campaign
from vsr2.campaign import TIERS
from vsr2.effects import effect
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import simulate_campaigns
from vsr2.posterior.naming import VerdictKind, is_wrong
from vsr2.posterior.sets import are_alike
from vsr2.posterior.training import Found, Posterior
from vsr2.results.atomic import csv_text, write_text

EFFECTS = ("catch", "com_offset", "inertia", "restitution", "table_gain", "wear")
STRONG = 2.0
"""Size from which an effect is strong [detection limits]."""
OTHERS = 400
"""Campaigns with a known cause, and without effect, that are held against them, at most."""


def judged(
    name: str,
    inferred: Sequence[Found],
    known: Sequence[tuple[Found, bool]],
    plain: Sequence[Found],
) -> dict[str, Any]:
    """One row.

    Args:
        name: of the effect.
        inferred: campaigns that have it.
        known: campaigns whose cause the library has, and whether no name of it is wrong.
        plain: campaigns without effect.
    """
    from scipy.stats import mannwhitneyu

    own = np.array([one.probability[-1] for one in inferred])
    others = np.array([one.probability[-1] for one in [*(one for one, _ in known), *plain]])
    named = np.array([one.naming.kind.names_effects for one, _ in known])
    right = np.array([true for _, true in known])
    return {
        "effect": name,
        "campaigns": own.size,
        "outside": own.mean(),
        "outside_of_others": others.mean(),
        "auroc": mannwhitneyu(own, others).statistic / (own.size * others.size),
        "above_95": float(np.mean(own > np.quantile(others, 0.95))),
        "said_unknown": share(inferred, VerdictKind.UNKNOWN),
        "named": float(np.mean([one.naming.kind.names_effects for one in inferred])),
        "known_named_rightly": float(np.mean(named & right)),
        "known_named_wrongly": float(np.mean(named & ~right)),
        "known_said_unknown": share([one for one, _ in known], VerdictKind.UNKNOWN),
        "plain_said_none": share(plain, VerdictKind.NONE),
    }


def share(found: Sequence[Found], kind: VerdictKind) -> float:
    """Of verdicts of one kind."""
    return float(np.mean([one.naming.kind is kind for one in found]))


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
    alone = [
        (k, acting[0].name)
        for k, acting in enumerate(planted.sets)
        if len(acting) == 1 and acting[0].size >= STRONG
    ]
    if rare := set(options.effects) - {name for _, name in alone}:
        parser.error(f"--effects {min(rare)}: is strong and alone in no campaign; plant more")
    plain = np.flatnonzero(planted.gap_free)[:OTHERS]
    table: list[dict[str, Any]] = []
    for name in options.effects:
        lacking = [
            other
            for other in PLANAR_LIBRARY
            if other == name or are_alike(effect(other), effect(name))
        ]
        posterior = rehearsal.posterior(options.tier, excluded=lacking)

        def found(k: int, own: Posterior = posterior) -> Found:
            return own.infer(planted.overturned[k], features[k])

        unknown = [found(k) for k, acting in alone if acting == name]
        known = []
        for k, acting in [one for one in alone if one[1] not in lacking][:OTHERS]:
            one = found(k)
            known.append((one, not is_wrong(one.naming, (posterior.sets.names.index(acting),))))
        table.append(judged(name, unknown, known, [found(k) for k in plain]))
        print(csv_text(table[-1:], ".3g"), flush=True)
        write_text(options.out, csv_text(table, ".3g"))


if __name__ == "__main__":
    main()
