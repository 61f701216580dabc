"""By how much two correct engines differ in largest tilts and series, from blind packs.

    python studies/engine_discrepancy.py PART [PART ...] [--out FOLDER]

PART is a folder of a scored blind check (`out/blind/validation/part1`). Of its campaigns without
effect, residuals against the diagnosis' own model without effect are compared between campaigns,
which share motions and nothing else: what two campaigns have in common in one trial, or in two
trials of one motion, is a difference between the engines, over the square of the emulator's
scatter. `DISCREPANCY` of `vsr2.diagnosis.where.discrepancy` rests on it. The part's cache
of simulations is copied and used. Writes `table.csv`, committed as
docs/results/engine_discrepancy.csv. Three minutes a part.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import sys
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.form.seal import open_key, read_pack
from vsr2.blind.pack_diagnoses import pack_nuisances
from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.diagnosis import Budget, Hypotheses
from vsr2.diagnosis.budget import Schedule
from vsr2.diagnosis.likelihood.emulator import fit_emulator
from vsr2.diagnosis.likelihood.evidence import Data, tabulate
from vsr2.diagnosis.likelihood.score import crossfitted_none
from vsr2.diagnosis.observed.observations import Observations, observe_campaign
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import screen, simulate_design
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator

Array = NDArray[np.float64]

DRAWS = 24
FARTHEST = 4.0
"""Residuals are clipped, as the scan does."""


def residuals(part: Path, out: Path) -> tuple[dict[str, Array], Observations, NDArray[np.int64]]:
    """Of each engine's campaigns, shape (campaigns, trials, features), and the trials' motions."""
    pack, key = read_pack(part / "data"), open_key(part / "data", part / "key")
    names = {
        name: entry["engine"] for name, entry in key["campaigns"].items() if entry["kind"] == "none"
    }
    seen = {name: observe_campaign(load_campaign(part / "data" / name), "T") for name in names}
    first = next(iter(seen.values()))
    simulator = SceneSimulator(
        first.campaign,
        load_study(part / "data" / pack.scene),
        hypotheses=Hypotheses(nuisances=pack_nuisances(pack)),
        series=True,
        threads=1,
        seed=0,
    )
    effects = simulator.library
    copy = out / f"{part.name}.jsonl"
    shutil.copyfile(part / "verdicts" / "simulations.jsonl", copy)
    with SimulationCache(simulator, copy) as cache:
        schedule = Schedule(Budget(draws=DRAWS), cache, len(first), effects)
        screening = screen(
            cache, first, runs=schedule.screening_runs, most=schedule.most_trials, seed=0
        )
        draws = dict.fromkeys(effects, DRAWS)
        design, _ = simulate_design(cache, first, screening, effects, draws, seed=0)
    kept = screening.kept
    emulator = fit_emulator(effects, design)
    none = tabulate(emulator, "")
    scatter = np.sqrt(emulator.scatter)
    found: dict[str, list[Array]] = {}
    for name, engine in names.items():
        data = Data(seen[name].overturned[None, kept], seen[name].features[None, kept])
        centre = crossfitted_none(none, data, first.motion[kept]).centre
        found.setdefault(engine, []).append((data.features - centre)[0] / scatter)
    stacked = {k: np.clip(np.stack(v), -FARTHEST, FARTHEST) for k, v in found.items()}
    return stacked, first, first.motion[kept]


def common(z: Array, motion: NDArray[np.int64]) -> tuple[float, float]:
    """Mean products of residuals of different campaigns: in one trial, in two of one motion."""
    same, other = [], []
    alike = motion[:, None] == motion[None]
    np.fill_diagonal(alike, False)
    for one, two in combinations(z, 2):
        same.append(one * two)
        other.append(np.where(alike, one[:, None] * two[None], np.nan).ravel())
    return float(np.nanmean(same)), float(np.nanmean(other))


def rows_of(part: Path, out: Path) -> list[dict[str, Any]]:
    """One row an engine and feature."""
    found, seen, motion = residuals(part, out)
    rows = []
    for engine, z in sorted(found.items()):
        for k, feature in enumerate(seen.measured):
            values = z[:, :, k]
            trial, group = common(values, motion)
            rows.append(
                {
                    "pack": part.name,
                    "engine": engine,
                    "feature": feature.name,
                    "campaigns": len(z),
                    "residuals": int(np.isfinite(values).sum()),
                    "deviation": f"{np.nanstd(values):.3f}",
                    "variance_by_trial": f"{trial:.3f}",
                    "variance_by_motion": f"{group:.3f}",
                }
            )
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("out/engine_discrepancy"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    rows = [row for part in options.part for row in rows_of(part, options.out)]
    with (options.out / "table.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(f"wrote {options.out / 'table.csv'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
