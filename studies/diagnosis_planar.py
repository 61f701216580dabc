"""How well the diagnosis does on campaigns of a planar block whose cause is known.

    python studies/diagnosis_planar.py [--motions N] [--scalings N] [--planted N]
        [--campaigns N ...] [--trials N] [--tiers BMT] [--seed N] [--out FOLDER]

One schedule of trials is looked at and simulated once; posteriors are trained on the first 500,
2,000 and 8,000 simulated campaigns. Planted campaigns come from the same prior over sets (none,
one, two; magnitudes log-uniform in detection limits), but from a simulator whose draws of nuisances
the diagnosis does not know. Causes that it cannot know are those of `withheld_effect.py`.

Writes `campaigns.csv`, one row a planted campaign, tier and number of simulated campaigns, and
`table.csv`, one row a tier and number, as committed in docs/results/diagnosis_planar. Detection
limits are of tier M, the same for all tiers; `outcome_signal` says how much outcomes alone hold of
an effect, in standard deviations, and 6 is twice the limit of that tier. `where_gain` is the share
of the effect over that of the trials, in the median location that stands out. Probabilities are
those of classes, a pair's of the one that leads; `p_true` of a pair is that of both. `inside` is of
single effects, `inside_of_pairs` of the strong effects of pairs, each for itself.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planar.planar_simulator import PlanarSimulator
from planted import Rehearsal, shaken_campaign
from vsr2.analysis.intervals import calibration_error
from vsr2.blind.custodian.campaign_recording import RECORDING
from vsr2.blind.custodian.pack_making import MAKING
from vsr2.diagnosis.where.locations import where_it_lies
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import FIRST_NUISANCE, Acting, Campaigns, simulate_campaigns
from vsr2.ensemble.simulated.library import NONE, UNKNOWN, free_parameters
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.ensemble.simulated.look import LOOK
from vsr2.ensemble.simulated.simulator import Effects, Request
from vsr2.posterior.calibration import label_probability
from vsr2.posterior.summaries import SUMMARY
from vsr2.posterior.training import Found, Posterior
from vsr2.posterior.truth import PRIOR

Array = NDArray[np.float64]
Row = dict[str, Any]

CLASSES = (
    ("table_gain", "slenderness", "table_pitch"),
    ("com_offset", "base_slope"),
    ("wear", "change_point"),
)
NAMED = ("effect", "class", "pair")
FIRST = 100_000
"""Number of the first planted campaign."""
SIGNAL_DRAWS = range(1, 17)
"""Draws of nuisances over which probabilities of overturning are taken."""
STRONG = 2.0
"""Size from which an effect is strong [detection limits]."""
LEAST = 1e-4
"""Probability that a truth counts for at least."""


def class_of(name: str) -> tuple[str, ...]:
    """The effects that one campaign cannot be expected to tell apart from `name`."""
    return next((group for group in CLASSES if name in group), (name,))


def by_class(probability: Array, posterior: Posterior) -> dict[str, float]:
    """Probability of none, of every class by its first effect, and of unknown."""
    names = posterior.sets.names
    labels = label_probability(probability[None], posterior.sets)[0]
    out: dict[str, float] = {}
    for name, p in zip((NONE, *names, UNKNOWN), labels, strict=True):
        out[class_of(name)[0]] = out.get(class_of(name)[0], 0.0) + float(p)
    return out


def pair_probability(found: Found, posterior: Posterior, wanted: set[str]) -> float:
    """Of two classes together."""
    sets, count = posterior.sets, len(posterior.sets.names)
    groups = [class_of(name)[0] for name in sets.names]
    pairs = found.probability[1 + count : -1]
    return float(
        sum(
            p
            for p, (i, j) in zip(pairs, sets.by_size[1], strict=True)
            if {groups[i], groups[j]} == wanted
        )
    )


def not_wrong(verdict: str, named: set[str], acting: set[str]) -> bool:
    """As scoring has it: all classes of a pair act, or one of those that another name names."""
    return bool(named) and named <= acting if verdict == "pair" else bool(named & acting)


def row_of(found: Found, posterior: Posterior, kind: str, acting: Sequence[Acting]) -> Row:
    """What scoring needs of one campaign, whose cause is in the library: given that it is."""
    names = posterior.sets.names
    within = np.append(found.probability[:-1], 0.0)
    p = by_class(within / within.sum(), posterior)
    groups = {class_of(one.name)[0] for one in acting}
    true = {NONE} if kind == NONE else groups
    effects = {group: value for group, value in p.items() if group not in (NONE, UNKNOWN)}
    top = max(p, key=lambda group: p[group])
    labels = (NONE, *names, UNKNOWN)
    held = {class_of(labels[k])[0] for k in found.held}
    said = found.naming
    named = {class_of(names[e])[0] for e in said.effects}
    p_true = sum(p[group] for group in true)
    if kind == "pair":
        p_true = pair_probability(found, posterior, groups) / float(within.sum())
    return {
        "kind": kind,
        "effect": "+".join(one.name for one in acting),
        "limits": min((one.size for one in acting), default=0.0),
        "verdict": str(said.kind),
        "named": " ".join(names[e] for e in said.effects),
        "right": int(kind != NONE and not_wrong(str(said.kind), named, groups)),
        "both": int(str(said.kind) == "pair" and named == groups),
        "lead": int(max(effects, key=lambda group: effects[group]) in true),
        "answer": int(top in true),
        "p_true": p_true,
        "p_top": p[top],
        "p_none": p[NONE],
        "p_unknown": float(found.probability[-1]),
        "covered": int(true <= held),
        "set_size": len(held),
    }


def magnitude(found: Found, posterior: Posterior, one: Acting) -> Row:
    """Relative error of the first primary parameter, and whether its 90 % interval holds it."""
    effect = posterior.parameters.library[one.name]
    free = free_parameters(effect)
    k = next(i for i, p in enumerate(free) if not p.secondary)
    truth = one.values[[p.name for p in effect.parameters].index(free[k].name)]
    samples = posterior.parameters.sample(one.name, found.residuals, np.random.default_rng(0))[:, k]
    null = free[k].null
    if np.isinf(null):
        samples, truth, null = 1 / samples, 1 / truth, 0.0
    low, middle, high = np.quantile(samples, [0.05, 0.5, 0.95])
    return {
        "error": abs(middle - truth) / max(abs(truth - null), 1e-12),
        "inside": int(low <= truth <= high),
    }


def magnitudes_together(found: Found, posterior: Posterior, acting: Sequence[Acting]) -> Row:
    """Effects of a pair that are strong, and how many of their 90 % intervals hold the truth."""
    strong = [one for one in acting if one.size >= STRONG]
    inside = [magnitude(found, posterior, one)["inside"] for one in strong]
    return {"strong_of_pair": len(strong), "inside_of_pair": sum(inside)}


def changes(
    truth: SimulationCache, planted: Campaigns, trials: NDArray[np.int64], rows: Iterable[int]
) -> Array:
    """What effects change in each trial, shape (campaigns, trials).

    The change of the outcome plus that of the logarithm of the largest tilt, against the same
    campaign without the effect, as a key of a blind pack has it.
    """
    requests = [Request(int(i), (), FIRST_NUISANCE + c, 1) for c in rows for i in trials]
    nominal = truth.run(requests)
    shape = planted.overturned.shape
    tilts = [
        np.log(np.clip(tilt, MAKING.least_tilt, RECORDING.range))
        for tilt in (planted.peak_tilt, nominal.peak_tilt.reshape(shape))
    ]
    flipped = planted.overturned != nominal.overturned.reshape(shape)
    return np.asarray(flipped + np.abs(tilts[0] - tilts[1]))


def located(
    found: Found, posterior: Posterior, seen: Observations, trials: NDArray[np.int64], change: Array
) -> Row:
    """Share of the effect over share of the trials, in the median of what stands out."""
    locations = where_it_lies(seen, trials, found.residuals, posterior.gap_free, 0)
    inside = [list(one.trials) for one in locations if one.stands_out]
    mean = float(change.mean())
    gains = [float(change[own].mean()) / mean for own in inside] if mean > 0 else []
    return {"located": int(bool(inside)), "where_gain": float(np.median(gains)) if gains else ""}


def table(rows: list[Row]) -> list[Row]:
    """Scores by tier and number of simulated campaigns."""
    return [
        {"tier": tier, "campaigns": count}
        | scores([row for row in rows if (row["tier"], row["campaigns"]) == (tier, count)])
        for tier, count in dict.fromkeys((row["tier"], row["campaigns"]) for row in rows)
    ]


def scores(rows: list[Row]) -> Row:
    """Of the campaigns of one posterior."""
    single, none, pair = (
        [row for row in rows if row["kind"] == kind] for kind in ("single", NONE, "pair")
    )
    strong = [row for row in single if row["limits"] >= STRONG]
    weak = [row for row in single if 1 <= row["limits"] < STRONG]
    by_outcomes = [row for row in single if row["outcome_signal"] >= 2 * LOOK.signal]
    pair_1, pair_2 = ([row for row in pair if row["limits"] >= least] for least in (1, STRONG))
    stated = single + none
    spoken = [row for row in stated if row["verdict"] in NAMED]
    return {
        "singles": len(single),
        "strong": len(strong),
        "log_loss": _log_loss(stated),
        "log_loss_strong": _log_loss(strong),
        "lead": _mean(row["lead"] for row in single),
        "lead_strong": _mean(row["lead"] for row in strong),
        "lead_weak": _mean(row["lead"] for row in weak),
        "answer_strong": _mean(row["answer"] for row in strong),
        "strong_by_outcomes": len(by_outcomes),
        "lead_strong_by_outcomes": _mean(row["lead"] for row in by_outcomes),
        "answer_strong_by_outcomes": _mean(row["answer"] for row in by_outcomes),
        "named_strong": _mean(row["verdict"] in NAMED and row["right"] for row in strong),
        "named_wrongly": _mean(not row["right"] for row in spoken),
        "covered": _mean(row["covered"] for row in stated),
        "covered_pairs": _mean(row["covered"] for row in pair),
        "set_size": _median(row["set_size"] for row in stated),
        "calibration_error": _calibration([none, single, pair]),
        "error_strong": _median(row["error"] for row in strong),
        "inside": _mean(row["inside"] for row in single),
        "strong_of_pairs": sum(row["strong_of_pair"] for row in pair),
        "inside_of_pairs": _ratio(pair, "inside_of_pair", "strong_of_pair"),
        "located_strong": _mean(row["located"] for row in strong),
        "where_gain": _median(row["where_gain"] for row in strong if row["located"]),
        "where_twice": _mean(row["where_gain"] >= 2 for row in strong if row["located"]),
        "where_false": _mean(row["located"] for row in none),
        "nones": len(none),
        "nones_named": _mean(row["verdict"] in NAMED for row in none),
        "nones_said": _mean(row["verdict"] == NONE for row in none),
        "singles_called_pair": _mean(row["verdict"] == "pair" for row in single),
        "pairs_1": len(pair_1),
        "pairs_1_both": _mean(row["both"] for row in pair_1),
        "pairs_2": len(pair_2),
        "pairs_2_both": _mean(row["both"] for row in pair_2),
        "pairs_log_loss": _log_loss(pair_1),
        "called_unknown": _mean(row["verdict"] == UNKNOWN for row in single),
    }


def _mean(values: Iterable[Any]) -> float:
    found = [float(value) for value in values]
    return float(np.mean(found)) if found else float("nan")


def _ratio(rows: list[Row], part: str, of: str) -> float:
    total = sum(row[of] for row in rows)
    return sum(row[part] for row in rows) / total if total else float("nan")


def _median(values: Iterable[Any]) -> float:
    found = [float(value) for value in values]
    return float(np.median(found)) if found else float("nan")


def _log_loss(rows: list[Row]) -> float:
    return _mean(-np.log(max(row["p_true"], LEAST)) for row in rows)


def _calibration(kinds: Sequence[list[Row]]) -> float:
    """Expected calibration error of the most probable class, kinds weighted as in the prior.

    Args:
        kinds: campaigns without effect, with one, with two.
    """
    if not all(kinds):
        return float("nan")
    prior = (PRIOR.none, PRIOR.one, PRIOR.two)
    stated = np.array([[row["p_top"], row["answer"]] for rows in kinds for row in rows])
    weight = np.repeat(
        [p / len(rows) for p, rows in zip(prior, kinds, strict=True)], [*map(len, kinds)]
    )
    return float(calibration_error(stated[None], weight)[0])


def write(path: Path, rows: list[Row]) -> None:
    """A CSV file of all keys that occur."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, keys, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})


def outcome_signal(
    truth: SimulationCache, acting: Sequence[Acting], trials: NDArray[np.int64]
) -> float:
    """How far an effect moves the probabilities of overturning, in their standard deviations.

    What nuisances share between trials is left out, so that it is a little too large.
    """

    def probability(effects: Effects) -> Array:
        requests = [Request(int(i), effects, m, 1) for m in SIGNAL_DRAWS for i in trials]
        overturned = truth.run(requests).overturned.reshape(-1, len(trials))
        return np.asarray(np.nanmean(overturned, axis=0))

    plain, moved = probability(()), probability(tuple((one.name, one.values) for one in acting))
    variance = plain * (1 - plain) + SUMMARY.chance
    return float(np.sqrt(((moved - plain) ** 2 / variance).sum()))


@one_blas_thread()
def measure(rehearsal: Rehearsal, truth: SimulationCache, options: argparse.Namespace) -> list[Row]:
    """Plant and infer."""
    numbers = range(FIRST, FIRST + options.planted)
    planted = simulate_campaigns(
        truth, rehearsal.look, rehearsal.trials, numbers, seed=options.seed + 5
    )
    changed = changes(truth, planted, rehearsal.trials, numbers)
    signals = [
        outcome_signal(truth, acting, rehearsal.trials) if acting else 0.0
        for acting in planted.sets
    ]
    rows: list[Row] = []
    for tier in options.tiers:
        seen = rehearsal.at(tier)
        noise = np.random.default_rng(options.seed)
        noted = seen.noted(planted.overturned, planted.peak_tilt, planted.features, noise)
        for count in options.campaigns:
            posterior = rehearsal.posterior(tier, count)
            place = {"tier": tier, "campaigns": count}
            for i, acting in enumerate(planted.sets):
                kind = (NONE, "single", "pair")[len(acting)]
                found = posterior.infer(planted.overturned[i], noted[i])
                row = place | row_of(found, posterior, kind, acting)
                row["outcome_signal"] = signals[i]
                if kind != "pair":
                    row |= located(found, posterior, seen, rehearsal.trials, changed[i])
                if kind == "single":
                    row |= magnitude(found, posterior, acting[0])
                if kind == "pair":
                    row |= magnitudes_together(found, posterior, acting)
                rows.append(row)
            print(table(rows)[-1], flush=True)
            write(options.out / "campaigns.csv", rows)
            write(options.out / "table.csv", table(rows))
    return rows


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--motions", type=int, default=15)
    parser.add_argument("--scalings", type=int, default=10, help="trials of each motion")
    parser.add_argument("--planted", type=int, default=600)
    parser.add_argument("--campaigns", type=int, nargs="+", default=[500, 2000, 8000])
    parser.add_argument("--trials", type=int, help="of each simulated campaign (default: all)")
    parser.add_argument("--tiers", default="BMT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_planar"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign = shaken_campaign(options.motions, options.scalings, seed=options.seed)
    own = PlanarSimulator(campaign, series=True, seed=1 + options.seed)
    truth = PlanarSimulator(campaign, series=True, seed=10_000 + options.seed)
    rehearsal = Rehearsal(
        own, campaign, campaigns=max(options.campaigns), trials=options.trials,
        cache=options.out / "simulations.jsonl", seed=options.seed,
    )  # fmt: skip
    with SimulationCache(truth, options.out / "planted.jsonl", chunk=8192) as cache:
        measure(rehearsal, cache, options)


if __name__ == "__main__":
    main()
