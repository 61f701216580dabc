"""How well the diagnosis does on campaigns of a planar block whose cause is known.

    python studies/diagnosis_planar.py [--trials N] [--singles N] [--nones N] [--pairs N]
        [--tiers BMT] [--draws N] [--seed N] [--out FOLDER]

One schedule of trials is simulated and prepared once, then many campaigns are planted on it by a
simulator whose draws of nuisances the diagnosis does not know: one effect each, no effect, two
effects of different classes (both at their floor or above), and one effect whose class is taken out
of the library. Magnitudes are log-uniform from 0.5 to 6 times the
detection floor of tier M, at which the expected log likelihood ratio against "none", nuisances
fitted, is 4.5 nat (3 standard deviations); where an effect's range ends below that, up to its end.

Writes `campaigns.csv`, one row a campaign and tier, and `table.csv`, one row a tier, as committed
in docs/results/diagnosis_planar. `top1` tells whether the true class leads all other effects,
`answer` whether it is the most probable answer, `none` and `unknown` being answers too.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planar.simulator import PlanarSimulator
from planted import Judged, Rehearsal, shaken_campaign
from vsr2.diagnosis.likelihood.emulator import fit_emulator
from vsr2.diagnosis.likelihood.evidence import Data, Table, log_likelihood, posterior, tabulate
from vsr2.diagnosis.simulated.library import NONE, UNKNOWN, free_parameters, values_at
from vsr2.diagnosis.which.routes import Prepared

CLASSES = (
    ("table_gain", "slenderness", "table_pitch"),
    ("com_offset", "base_slope"),
    ("wear", "change_point"),
)
FLOOR = 3.0
"""Standard deviations at the detection floor."""
Planted = tuple[str, tuple[float, ...], float]
"""Effect, values and magnitude over its floor."""
LEFT_OUT = ("catch", "time_scale", "restitution")
"""Effects whose classes are left out in turn."""


def class_of(name: str) -> tuple[str, ...]:
    """The effects that one campaign cannot be expected to tell apart from `name`."""
    return next((group for group in CLASSES if name in group), (name,))


def signal(table: Table, none: Table) -> NDArray[np.float64]:
    """Distance from "none" in standard deviations at each fine node of an effect."""
    blank = np.zeros((1, 1, table.nuisances))
    at = table.fine
    features = np.stack(at.centre, axis=-1) if at.centre else np.zeros((*at.logit.shape, 0))
    data = Data(1 / (1 + np.exp(-at.logit)), features)
    own = np.array(
        [
            log_likelihood(table, at.at(g), data.take(np.array([g])), blank).sum()
            for g in range(len(at.logit))
        ]
    )
    gap = np.maximum(own - posterior(none, data).best, 0.0)
    return np.asarray(np.sqrt(2 * gap), dtype=np.float64)


def draw_effects(rehearsal: Rehearsal, count: int, rng: np.random.Generator) -> list[Planted]:
    """Effects in turn, each with values and magnitude over the floor of tier M."""
    library = rehearsal.library
    emulator = fit_emulator(library, rehearsal.design("M"))
    none = tabulate(emulator, "")
    tables = {name: tabulate(emulator, name) for name in library}
    signals = {name: signal(table, none) for name, table in tables.items()}
    names = [name for name in library if signals[name].max() >= FLOOR]
    out = []
    deck: list[str] = []
    for _ in range(count):
        deck = deck or [names[i] for i in rng.permutation(len(names))]
        name = deck.pop()
        most = min(6.0, signals[name].max() / FLOOR)
        wanted = FLOOR * np.exp(rng.uniform(np.log(0.5), np.log(most)))
        near = np.argsort(np.abs(np.log(np.maximum(signals[name], 1e-3) / wanted)))[:3]
        node = int(rng.choice(near))
        values = values_at(library[name], tables[name].fine.quantiles[node])
        out.append((name, values, float(signals[name][node] / FLOOR)))
    return out


def draw_pairs(
    planted: Sequence[Planted], count: int, rng: np.random.Generator
) -> list[tuple[Planted, Planted]]:
    """Two effects of different classes, each at its floor or above."""
    heard = [one for one in planted if one[2] >= 1]
    out: list[tuple[Planted, Planted]] = []
    while len(out) < count:
        i, j = rng.choice(len(heard), 2, replace=False)
        if class_of(heard[i][0]) != class_of(heard[j][0]):
            out.append((heard[i], heard[j]))
    return out


def row_of(judged: Judged, tier: str, kind: str, name: str, relative: float) -> dict[str, Any]:
    """What scoring needs of one campaign."""
    content = judged.diagnosis.content
    p = {entry["name"]: entry["probability"] for entry in content["effects"]}
    p[NONE] = content["none_probability"]
    p[UNKNOWN] = content["unknown"]["probability"]
    parts = {class_of(part)[0] for part in name.split("+")}
    true = kind if kind in (NONE, UNKNOWN) else class_of(name.split("+")[0])[0]
    groups = {member: class_of(member)[0] for member in p}
    by_class: dict[str, float] = {}
    for member, value in p.items():
        by_class[groups[member]] = by_class.get(groups[member], 0.0) + value
    effects = {group: value for group, value in by_class.items() if group not in (NONE, UNKNOWN)}
    best = max(effects, key=lambda group: effects[group])
    top = max(by_class, key=lambda group: by_class[group])
    chosen = list(dict.fromkeys(groups[member] for member in content["conformal_set_90"]))
    verdict = content["verdict"]
    named = {groups[member] for member in verdict["effects"]}
    return {
        "tier": tier,
        "kind": kind,
        "effect": name,
        "relative": relative,
        "verdict": verdict["kind"],
        "named": " ".join(verdict["effects"]),
        "right": int(bool(parts & named)),
        "both": int(named == parts),
        "top1": int(best == true),
        "p_true": by_class.get(true, 0.0),
        "p_top": by_class[top],
        "hit": int(top == true),
        "covered": int(true in chosen),
        "set_size": len(chosen),
        "p_unknown": p[UNKNOWN],
        "closure": content["gap"]["closure"]["value"],
        "negative_control": content["negative_control"]["closure"]["value"],
        "oracle": next(
            (e["closure"]["value"] for e in content["effects"] if e["name"] == name), None
        ),
        "order_p": min(
            (w["p_familywise"] for w in content["where"] if w["axis"].endswith("order")), default=1
        ),
    }


def magnitude(
    judged: Judged, prepared: Prepared, name: str, values: Sequence[float]
) -> dict[str, Any]:
    """Relative error of the first primary parameter, and whether its interval holds the truth."""
    entry = prepared.library[name]
    parameter = next(p for p in free_parameters(entry) if not p.secondary)
    truth = values[[p.name for p in entry.parameters].index(parameter.name)]
    found = next(e for e in judged.diagnosis.content["effects"] if e["name"] == name)
    estimate = found["parameters"][parameter.name]
    null = parameter.null if np.isfinite(parameter.null) else None
    size = abs(truth - null) if null is not None else abs(truth)
    low, high = estimate["ci95"]
    return {
        "error": abs(estimate["mean"] - truth) / max(size, 1e-9),
        "inside": int(low <= truth <= high),
    }


def table(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Scores by tier."""
    out = []
    for tier in dict.fromkeys(row["tier"] for row in rows):
        mine = [row for row in rows if row["tier"] == tier]
        single = [row for row in mine if row["kind"] == "single"]
        strong = [row for row in single if row["relative"] >= 2]
        none = [row for row in mine if row["kind"] == "none"]
        unknown = [row for row in mine if row["kind"] == "unknown"]
        pair = [row for row in mine if row["kind"] == "pair"]
        stated = single + none + unknown
        names = ("effect", "class", "pair")
        spoken = [row for row in single + unknown if row["verdict"] in names]
        others = [row["p_unknown"] for row in single + none]
        beaten = [np.mean([p < u["p_unknown"] for p in others]) for u in unknown]
        ties = [np.mean([p == u["p_unknown"] for p in others]) for u in unknown]
        classes = len({class_of(row["effect"]) for row in single}) + 2
        closed = [row for row in strong if row["closure"] is not None and row["oracle"]]
        out.append(
            {
                "tier": tier,
                "singles": len(single),
                "strong": len(strong),
                "top1": _mean(row["top1"] for row in single),
                "top1_strong": _mean(row["top1"] for row in strong),
                "answer": _mean(row["hit"] for row in single),
                "answer_strong": _mean(row["hit"] for row in strong),
                "named_strong": _mean(row["verdict"] in names for row in strong),
                "named_wrongly": _mean(not row["right"] for row in spoken),
                "covered": _mean(row["covered"] for row in stated),
                "set_size": float(np.median([row["set_size"] for row in stated])),
                "covered_strong": _mean(row["covered"] for row in strong),
                "set_size_strong": float(np.median([row["set_size"] for row in strong])),
                "log_score_gain": 1 - _log_loss(stated) / np.log(classes),
                "log_score_gain_strong": 1 - _log_loss(strong) / np.log(classes),
                "calibration_error": _calibration(stated),
                "calibration_error_strong": _calibration(strong),
                "nones": len(none),
                "false_alarms": _mean(row["verdict"] != "none" for row in none),
                "order_alarms": _mean(row["order_p"] <= 0.05 for row in none),
                "unknowns": len(unknown),
                "unknown_auroc": _mean(b + 0.5 * t for b, t in zip(beaten, ties, strict=True)),
                "unknown_named": _mean(row["verdict"] in names for row in unknown),
                "pairs": len(pair),
                "pair_both_named": _mean(row["verdict"] == "pair" and row["both"] for row in pair),
                "pair_one_named": _mean(
                    row["verdict"] in names and row["right"] and not row["both"] for row in pair
                ),
                "pair_named_wrongly": _mean(
                    row["verdict"] in names and not row["right"] for row in pair
                ),
                "pair_unknown": _mean(row["verdict"] == "unknown" for row in pair),
                "pair_unresolved": _mean(row["verdict"] == "unresolved" for row in pair),
                "error": float(np.median([row["error"] for row in strong])),
                "inside": _mean(row["inside"] for row in strong),
                "closure": _mean(row["closure"] for row in closed),
                "over_oracle": float(np.median([r["closure"] / r["oracle"] for r in closed]))
                if closed
                else float("nan"),
            }
        )
    return out


def _mean(values: Any) -> float:
    found = [float(value) for value in values]
    return float(np.mean(found)) if found else float("nan")


def _log_loss(rows: list[dict[str, Any]]) -> float:
    return float(np.mean([-np.log(max(row["p_true"], 1e-3)) for row in rows]))


def _calibration(rows: list[dict[str, Any]]) -> float:
    """Expected calibration error of the most probable class over ten bins."""
    p = np.array([row["p_top"] for row in rows])
    hit = np.array([row["hit"] for row in rows])
    bins = np.minimum((p * 10).astype(int), 9)
    parts = [
        (bins == b).mean() * abs(p[bins == b].mean() - hit[bins == b].mean()) for b in set(bins)
    ]
    return float(sum(parts))


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    """A CSV file of all keys that occur."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, keys, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})


def measure(
    rehearsal: Rehearsal, truth: Any, options: argparse.Namespace, say: Any = print
) -> list[dict[str, Any]]:
    """Plant and judge."""
    rng = np.random.default_rng([options.seed, 1])
    planted = draw_effects(rehearsal, options.singles, rng)
    singles = [
        rehearsal.observed(truth, ((name, values),), nuisance=1 + i)
        for i, (name, values, _) in enumerate(planted)
    ]
    pairs = [
        (f"{a[0]}+{b[0]}", min(a[2], b[2]), tuple(sorted((a[:2], b[:2]))))
        for a, b in draw_pairs(planted, options.pairs, rng)
    ]
    twofold = [
        rehearsal.observed(truth, effects, nuisance=2001 + i)
        for i, (_, _, effects) in enumerate(pairs)
    ]
    nones = [rehearsal.observed(truth, (), nuisance=1001 + i) for i in range(options.nones)]
    rows: list[dict[str, Any]] = []
    for tier in options.tiers:
        prepared = rehearsal.prepared(tier)
        for (name, values, relative), seen in zip(planted, singles, strict=True):
            judged = rehearsal.judge(prepared, seen, tier)
            row = row_of(judged, tier, "single", name, relative)
            rows.append(row | magnitude(judged, prepared, name, values))
            write(options.out / "campaigns.csv", rows)
        for seen in nones:
            rows.append(row_of(rehearsal.judge(prepared, seen, tier), tier, "none", NONE, 0.0))
        for (name, relative, _), seen in zip(pairs, twofold, strict=True):
            rows.append(row_of(rehearsal.judge(prepared, seen, tier), tier, "pair", name, relative))
        for left_out in options.unknown:
            lacking = rehearsal.prepared(tier, without=class_of(left_out))
            for (name, _, relative), seen in zip(planted, singles, strict=True):
                if name in class_of(left_out) and relative >= 1:
                    judged = rehearsal.judge(lacking, seen, tier)
                    rows.append(row_of(judged, tier, "unknown", name, relative))
            write(options.out / "campaigns.csv", rows)
        say(f"tier {tier}: {len(rows)} rows, combination {prepared.calibration.combination}")
        write(options.out / "campaigns.csv", rows)
        write(options.out / "table.csv", table(rows))
    return rows


def arguments(description: str) -> argparse.ArgumentParser:
    """Options that all studies of planted campaigns share."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--trials", type=int, default=150)
    parser.add_argument("--singles", type=int, default=48)
    parser.add_argument("--nones", type=int, default=24)
    parser.add_argument("--pairs", type=int, default=16)
    parser.add_argument("--tiers", default="BMT")
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--unknown", nargs="*", default=list(LEFT_OUT))
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_planar"))
    return parser


def main() -> None:
    """Run the study."""
    options = arguments(__doc__ or "").parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign = shaken_campaign(15, options.trials // 15, seed=options.seed)
    own = PlanarSimulator(campaign, series=True, seed=1 + options.seed)
    rehearsal = Rehearsal(own, campaign, draws=options.draws, series=True)
    truth = PlanarSimulator(campaign, series=True, seed=10_000 + options.seed)
    for row in table(measure(rehearsal, truth, options)):
        print(row)


if __name__ == "__main__":
    main()
