"""What each effect costs a step: CPU time with it over that without, at its prior's far end.

    python benchmarks/effects.py [--mesh MESH] [--rounds N] [--engine MODE]

On the block and on a scanned rock, each under the pulses of the checks (two that just lift it,
four that nearly overturn it, one that makes it slide). In every round a batch with the effect
follows one without, so that a change of the machine's speed meets both; the table gives the median
of the rounds' ratios and its quartiles.
CPU time of whole trials over their steps, building of the worlds included. A part of a ratio is the
changed response: a rock that slides or stands is cheaper than one that rocks, whatever the effect.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from vsr2.effects import in_order, library, with_effects
from vsr2.simulation import run_batch
from vsr2.simulation.bench import EffectBench, Rock
from vsr2.simulation.effect_checks import CHECK, ensemble, shaking
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent


def cpu_time(trials: list[Trial]) -> float:
    """CPU seconds a step of a batch."""
    start = time.process_time()
    result = run_batch(trials, threads=1)
    seconds = time.process_time() - start
    return float(seconds / result["steps"].sum())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=ROOT / "models/pbr_scan.obj")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--engine", default="fast", choices=["parity", "exact", "fast"])
    arguments = parser.parse_args()
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
