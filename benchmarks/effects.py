"""What each effect costs a step: CPU time with it over that without, at its prior's far end.

    python benchmarks/effects.py [--mesh MESH] [--rounds N] [--engine MODE]
    python benchmarks/effects.py --quiet [--trials N] [--out CSV]

On the block and on a scanned rock, each under the pulses of the checks (two that just lift it,
four that nearly overturn it, one that makes it slide). In every round a batch with the effect
follows one without, so that a change of the machine's speed meets both; the table gives the median
of the rounds' ratios and its quartiles.
CPU time of whole trials over their steps, building of the worlds included. A part of a ratio is the
changed response: a rock that slides or stands is cheaper than one that rocks, whatever the effect.

`--quiet`: what quiet stretches save under each effect. The campaign of `campaign-block` in
throughput_work.py runs with `engine.skip: quiet` and with `none`, under one draw of nuisances and
the effect at its far end; the table gives the ratio of CPU times and the share of outcomes that
differ. The committed table is docs/results/quiet_effects.csv.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from throughput_work import block, thinned
from vsr2.effects import Effect, in_order, library, with_effects
from vsr2.ensemble.simulated.library import (
    free_parameters,
    primary_parameters,
    sides,
    values_at,
)
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.simulation import run_batch
from vsr2.simulation.bench import EffectBench, Rock
from vsr2.simulation.effect_checks import CHECK, ensemble, shaking
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent
NUISANCE = 3
"""The draw that both ways share."""
QUIET_HEADER = [
    "effect",
    "CPU time of a trial, every step [ms]",
    "quiet over it",
    "outcomes differ",
]


def cpu_time(trials: list[Trial]) -> float:
    """CPU seconds a step of a batch."""
    start = time.process_time()
    result = run_batch(trials, threads=1)
    seconds = time.process_time() - start
    return float(seconds / result["steps"].sum())


def what_quiet_saves(count: int) -> list[list[str]]:
    """CPU time with quiet stretches over that with every step, by effect, least first."""
    campaign, study = block()
    campaign = thinned(campaign, count)
    simulators = {}
    for skip in ("none", "quiet"):
        engine = study.engine.model_copy(update={"skip": skip})
        changed = study.model_copy(update={"engine": engine})
        simulators[skip] = SceneSimulator(campaign, changed, threads=1)
        simulators[skip].run(
            [Request(0, (), NUISANCE, 0)]
        )  # what is imported late is imported here
    known = simulators["none"].library
    found: list[tuple[float, list[str]]] = []
    for name in (None, *(name for name in known if sides(known[name]))):
        given = () if name is None else ((name, far_end(known[name])),)
        requests = [Request(i, given, NUISANCE, 0) for i in range(len(campaign))]
        seconds, overturned = {}, {}
        for skip, simulator in simulators.items():
            start = time.process_time()
            overturned[skip] = simulator.run(requests).overturned
            seconds[skip] = time.process_time() - start
        ratio = seconds["quiet"] / seconds["none"]
        differ = float(np.mean(overturned["quiet"] != overturned["none"]))
        cells = [name or "none", f"{1e3 * seconds['none'] / len(campaign):.2f}"]
        found.append((ratio, [*cells, f"{ratio:.2f}", f"{differ:.3f}"]))
        print(" ".join(found[-1][1]), flush=True)
    return [row for _, row in sorted(found, key=lambda item: item[0])]


def far_end(effect: Effect) -> tuple[float, ...]:
    """Its values at the end of its first side, what is not its size in the middle of its range."""
    primary = len(primary_parameters(effect))
    others = len(free_parameters(effect)) - primary
    return values_at(effect, sides(effect)[0], [1.0] * primary, [0.5] * others)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=ROOT / "models/pbr_scan.obj")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--engine", default="fast", choices=["parity", "exact", "fast"])
    parser.add_argument("--quiet", action="store_true", help="what quiet stretches save")
    parser.add_argument("--trials", type=int, default=150, help="of the campaign of --quiet")
    parser.add_argument("--out", type=Path, help="also write the table of --quiet as CSV")
    arguments = parser.parse_args()
    if arguments.quiet:
        rows = what_quiet_saves(arguments.trials)
        if arguments.out is not None:
            with arguments.out.open("w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([QUIET_HEADER, *rows])
        return
    bench = EffectBench(arguments.engine, arguments.mesh)
    print(f"{'engine':8} {'effect':20} {'block':>6}  {'quartiles':14} {'scan':>6}  quartiles")
    rocks: dict[Rock, Trial] = {"block": bench.block(), "scan": bench.scan()}
    plain = {
        rock: ensemble(trial, shaking(trial, CHECK.turns[rock]), CHECK.turns[rock], 1)
        for rock, trial in rocks.items()
    }
    for effect in in_order(library()):
        cells = []
        for trials in plain.values():
            given = [(effect, effect.extreme())]
            changed = with_effects(trials, given, relative_order=[1.0] * len(trials))
            ratios = []
            for _ in range(arguments.rounds):
                off = cpu_time(trials)
                ratios.append(cpu_time(changed) / off)
            low, middle, high = np.percentile(ratios, [25, 50, 75])
            cells.append(f"{middle:6.2f}  {f'{low:.2f} to {high:.2f}':14}")
        print(f"{arguments.engine:8} {effect.name:20} {' '.join(cells).rstrip()}", flush=True)


if __name__ == "__main__":
    main()
