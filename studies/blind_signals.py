"""Measures again how strong the effects of scored packs are, and scores by what is measured.

    python studies/blind_signals.py                       # the Bullet singles of the second round
    python studies/blind_signals.py --engine mujoco
    python studies/blind_signals.py --kind single --kind unknown --kind pair
    python studies/blind_signals.py --spread [--engine mujoco]    # over seeds of measuring

Reads keys and verdicts of `--results` (:mod:`blind_results`). Each effect is simulated at its
sealed values on its campaign's protocol (`SignalMeter` of
:mod:`vsr2.blind.custodian.detection_limit`). Its signal over noise over 3 is written to
docs/results/blind_signals.csv, beside what was sealed; what is there is kept. Scores in groups of
what was measured are printed. Effects are those of the present version: where an engine's
effect was changed since, or taken out, its campaigns say little or are left out.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from blind_results import read_key, read_parts
from vsr2.blind import PackSettings
from vsr2.blind.custodian.design import catalogue, draw_protocol, overturning_acceleration
from vsr2.blind.custodian.detection_limit import RULES, SignalMeter
from vsr2.blind.custodian.engine import build_engine
from vsr2.blind.custodian.pack_streams import PackStream, pack_generator
from vsr2.blind.form.pack_settings import ENGINES, EngineName, Kind
from vsr2.blind.mujoco import ContactModel
from vsr2.blind.scoring.score import ScoreCode, score_cases
from vsr2.config import load_study
from vsr2.report.messages.scores import SCORES

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "results" / "blind_signals.csv"
COLUMNS = ("part", "campaign", "engine", "kind", "effect", "values", "sealed", "measured")
SHOWN = (
    ScoreCode.LEADS,
    ScoreCode.NAMED,
    ScoreCode.SET_COVERAGE,
    ScoreCode.SET_SIZE,
    ScoreCode.LOG_SCORE,
    ScoreCode.CALIBRATION,
    ScoreCode.ERROR,
    ScoreCode.INTERVAL,
    ScoreCode.CLOSURE,
    ScoreCode.WHERE_GAIN,
)
WINDOWS = (
    ("below 0.5", 0.0, 0.5),
    ("0.5 to 2", 0.5, 2.0),
    ("2 to 6", 2.0, 6.0),
    ("above 6", 6.0, math.inf),
    ("2 or more", 2.0, math.inf),
)
SPREAD: dict[str, list[dict[str, float]]] = {
    "table_gain": [{"change": change} for change in (-0.02, -0.03, -0.045, 0.02, 0.045)],
    "slenderness": [{"change": change} for change in (0.02, 0.04)],
    "wear": [{"loss": loss} for loss in (0.02, 0.045)],
    "time_scale": [{"change": change} for change in (-0.01, -0.02)],
    "edge_rounding": [{"radius": radius} for radius in (0.005, 0.009)],
    "restitution": [{"energy_ratio": ratio} for ratio in (1.08, 0.9)],
    "adhesion": [{"strength": 1.5}],
    "vertical_motion": [{"share": 0.03}],
    "input_filter": [{"corner": 6.5}],
    "table_saturation": [{"acceleration": 15.9, "velocity": 0.36}],
}


def main() -> int:
    """Measure what is missing, then score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--results", type=Path, default=ROOT / "docs" / "results" / "blind_validation_2"
    )
    parser.add_argument("--table", type=Path, default=TABLE)
    parser.add_argument("--scene", type=Path, default=ROOT / "configs" / "blind.yaml")
    parser.add_argument("--engine", action="append", choices=ENGINES)
    parser.add_argument("--kind", action="append", choices=[Kind.SINGLE, Kind.UNKNOWN, Kind.PAIR])
    parser.add_argument("--seed", type=int, default=1, help="of measuring (default 1)")
    parser.add_argument("--spread", action="store_true", help="over seeds of measuring")
    parser.add_argument("--seeds", type=int, default=4, help="of --spread (default 4)")
    options = parser.parse_args()
    if options.spread:
        for name in options.engine or [EngineName.BULLET]:
            other = "" if name == EngineName.BULLET else f"_{name}"
            file = options.table.with_name(f"{options.table.stem}_spread{other}.csv")
            spread(name, options.scene, file, options.seeds)
        return 0
    rows = read_rows(options.table)
    known = {(row["campaign"], row["effect"]) for row in rows}
    for number, key in keys(options.results):
        for row in measured(
            key,
            options.scene,
            options.engine or [EngineName.BULLET],
            options.kind or [Kind.SINGLE],
            options.seed,
            known,
        ):
            rows.append({"part": str(number)} | row)
            write_rows(options.table, COLUMNS, rows)
            print(*list(rows[-1].values())[2:], flush=True)
    print(page(options.results, rows), end="")
    return 0


def keys(results: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Number and key of each part."""
    for number in range(1, 1 + len(list(results.glob("key*.json.gz")))):
        yield number, read_key(results, number)


def measured(
    key: dict[str, Any],
    scene: Path,
    engines: list[str],
    kinds: list[str],
    seed: int,
    known: set[tuple[str, str]],
) -> Iterator[dict[str, str]]:
    """A row for each effect that is not known yet, measured as `vsr2 blind make` does now."""
    now = PackSettings()
    settings = replace(
        TypeAdapter(PackSettings).validate_python(key["settings"]),
        replicates=now.replicates,
        signal_trials=now.signal_trials,
    )
    study, number = load_study(scene), int(key["seed"])
    wanted = [
        (name, entry, effect)
        for name, entry in sorted(key["campaigns"].items())
        if entry["engine"] in engines and entry["kind"] in kinds
        for effect in entry["effects"]
        if (name, effect["name"]) not in known
    ]
    if not wanted:
        return
    motions = catalogue(number, settings.catalogue)
    contact = TypeAdapter(ContactModel).validate_python(key.get("contact", {}))
    first = build_engine(settings.engines[0], study, contact)
    thresholds = [overturning_acceleration(first, motion) for motion in motions]
    meters: dict[tuple[str, int], SignalMeter] = {}
    for name, entry, effect in wanted:
        engine = build_engine(entry["engine"], study, contact)
        if effect["name"] not in engine.effects:
            continue
        place = (entry["engine"], int(entry["protocol"]))
        if place not in meters:
            rng = pack_generator(number, PackStream.PROTOCOL, place[1])
            protocol = draw_protocol(rng, motions, thresholds, settings)
            meters[place] = SignalMeter(engine, protocol, settings, seed)
        relative = meters[place].signal(effect["name"], effect["values"]) / RULES.detected
        yield {
            "campaign": name,
            "engine": entry["engine"],
            "kind": entry["kind"],
            "effect": effect["name"],
            "values": " ".join(f"{k}={v:.4g}" for k, v in sorted(effect["values"].items())),
            "sealed": f"{effect['relative']:.3g}",
            "measured": f"{relative:.3g}",
        }


def page(results: Path, rows: list[dict[str, str]]) -> str:
    """Counts, and the scores of single effects in groups of what was measured."""
    found = {(row["campaign"], row["effect"]): float(row["measured"]) for row in rows}
    cases = [case for part in read_parts(results) for case in part]
    singles = [
        replace(case, relative=found[case.id, case.effects[0]["name"]])
        for case in cases
        if case.kind == Kind.SINGLE and (case.id, case.effects[0]["name"]) in found
    ]
    lines = [
        "# Strengths measured again",
        "",
        "Signal over noise over 3 at the sealed values, as `vsr2 blind make` measures each draw "
        "now, beside the magnitude over the detection limit that was sealed.",
    ]
    for engine in sorted({case.engine for case in singles}):
        mine = [case for case in singles if case.engine == engine]
        lines += ["", f"## {engine}, {len({case.id for case in mine})} single effects", ""]
        lines += ["| measured | sealed below 2 | sealed 2 or more |", "| --- | --- | --- |"]
        sealed = {case.id: float(case.effects[0]["relative"]) for case in mine}
        strength = {case.id: case.relative for case in mine}
        for label, low, high in WINDOWS:
            inside = [name for name, value in strength.items() if low <= value < high]
            strong = sum(sealed[name] >= 2 for name in inside)
            lines.append(f"| {label} | {len(inside) - strong} | {strong} |")
        for label, low, high in WINDOWS:
            group = [case for case in mine if low <= case.relative < high]
            scores = {
                tier: score_cases([case for case in group if case.tier == tier])
                for tier in sorted({case.tier for case in group})
            }
            lines += ["", f"### {engine}, measured {label}", ""]
            lines += ["| score | " + " | ".join(scores) + " |", "| --- |" + " --- |" * len(scores)]
            for code in SHOWN:
                cells = []
                for tier, one in scores.items():
                    score = one[tier, "all"].get(code)
                    cells.append("" if score is None else f"{score.value:.2f} ({score.count})")
                lines.append(f"| {SCORES[code]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def spread(name: str, scene: Path, path: Path, count: int) -> None:
    """Signals in one engine of fixed effects on one protocol over seeds of measuring."""
    settings = PackSettings(engines=(name,))
    engine = build_engine(name, load_study(scene))
    motions = catalogue(11, settings.catalogue)
    thresholds = [overturning_acceleration(engine, motion) for motion in motions]
    rng = pack_generator(11, PackStream.PROTOCOL, 0)
    protocol = draw_protocol(rng, motions, thresholds, settings)
    rows: dict[str, dict[str, str]] = {}
    seeds = range(1, count + 1)
    for seed in seeds:
        meter = SignalMeter(engine, protocol, settings, seed)
        for effect, sizes in SPREAD.items():
            for values in sizes if effect in engine.effects else ():
                label = f"{effect} " + " ".join(f"{k}={v:g}" for k, v in values.items())
                row = rows.setdefault(label, {"effect": label})
                row[f"seed {seed}"] = f"{meter.signal(effect, values) / RULES.detected:.3g}"
        write_rows(path, ("effect", *(f"seed {s}" for s in seeds)), list(rows.values()))
        print(f"seed {seed}", flush=True)
    table = np.array([[float(row[f"seed {s}"]) for s in seeds] for row in rows.values()])
    table = table[np.median(table, axis=1) >= RULES.window[0]]  # weaker ones are not drawn
    off = np.abs(np.log(table / np.median(table, axis=1, keepdims=True)))
    ratio = np.percentile(table.max(axis=1) / table.min(axis=1), [50, 80, 100])
    near = np.mean(off < math.log(1.5))
    print(f"{name}, {len(table)} draws: within a factor 1.5 of the median: {near:.2f}")
    print(f"largest over smallest: {ratio[0]:.2g}, {ratio[1]:.2g} at 80 %, {ratio[2]:.2g} at most")


def read_rows(path: Path) -> list[dict[str, str]]:
    """Of a table, none where there is no file."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, columns: tuple[str, ...], rows: list[dict[str, str]]) -> None:
    """A table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    raise SystemExit(main())
