"""Supplement Fig. S2: runtime of a campaign of 582 earthquake recordings against processor cores.

    python studies/figure_s2.py measure [--threads 1,2,4,8] [--engines exact,fast] [--rounds N]
    python studies/figure_s2.py plot

The recordings are the twelve embedded ones at strengths of 0.2 to 1.6 times their own, 582 in all,
on the embedded rock, so that anyone can run it; the supplement's were of the laboratory. `measure`
appends to docs/results/figure_s2.csv one row a run: wall time, CPU time, and how many processors
other programs kept busy meanwhile. It needs no matplotlib; `plot` draws docs/results/figure_s2.png
from the table, on any machine, with the supplement's own times (S4: 9300 s on one core, 1550 s on
eight) beside it. Rows measured while others kept more than a tenth of a processor busy are drawn
hollow.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "docs" / "results" / "figure_s2.csv"
COLUMNS = (
    "processor", "processors", "engine", "recordings", "steps", "threads", "wall_s", "cpu_s",
    "others_busy",
)  # fmt: skip
RECORDINGS = 582
SUPPLEMENT = {1: 9300.0, 8: 1550.0}
"""Wall time by cores of the original system, as its text states [s]."""
QUIET = 0.1


def measure(options: argparse.Namespace) -> None:
    """Run the campaign at each number of threads and append to the table."""
    sys.path.append(str(ROOT / "benchmarks"))
    from machine_load import busy_seconds
    from vsr2.config import load_study
    from vsr2.results import base_provenance
    from vsr2.simulation import run_batch, study_trials

    numbers = [int(number) for number in options.threads.split(",")]
    for _ in range(options.rounds):
        for engine in options.engines.split(","):
            study = load_study(
                ROOT / "configs" / "demo.yaml",
                overrides=["preset=original", f"engine.mode={engine}", "output.log_every=0"],
            )
            base = study_trials(study)
            scales = np.geomspace(0.2, 1.6, -(-options.recordings // len(base)))
            trials = [
                replace(trial, motion=trial.motion.scaled(float(scale)))
                for scale in scales
                for trial in base
            ][: options.recordings]
            for number in numbers:
                wall, own, busy = time.perf_counter(), time.process_time(), busy_seconds()
                result = run_batch(trials, threads=number)
                wall, own = time.perf_counter() - wall, time.process_time() - own
                others = max(0.0, busy_seconds() - busy - own) / wall
                row = {
                    "processor": base_provenance()["processor"],
                    "processors": len(os.sched_getaffinity(0)),
                    "engine": engine,
                    "recordings": len(trials),
                    "steps": int(result["steps"].sum()),
                    "threads": number,
                    "wall_s": f"{wall:.2f}",
                    "cpu_s": f"{own:.2f}",
                    "others_busy": f"{others:.2f}",
                }
                append(options.table, row)
                print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)


def append(table: Path, row: dict[str, object]) -> None:
    """Add a row, and the header to a new table."""
    new = not table.exists()
    table.parent.mkdir(parents=True, exist_ok=True)
    with table.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if new:
            writer.writeheader()
        writer.writerow(row)


def plot(options: argparse.Namespace) -> None:
    """Draw the figure from the table."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with options.table.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if int(row["recordings"]) == RECORDINGS]
    if not rows:
        raise SystemExit(f"{options.table} holds no run of {RECORDINGS} recordings; measure first")
    figure, axes = pyplot.subplots(figsize=(7, 5), layout="constrained")
    axes.plot(*zip(*SUPPLEMENT.items(), strict=True), "ks--", label="original system (S4)")
    groups = sorted({(row["engine"], row["processor"]) for row in rows})
    for colour, (engine, processor) in enumerate(groups):
        own = [row for row in rows if (row["engine"], row["processor"]) == (engine, processor)]
        threads = sorted({int(row["threads"]) for row in own})
        medians = [
            float(np.median([float(r["wall_s"]) for r in own if int(r["threads"]) == number]))
            for number in threads
        ]
        label = f"{engine}, {processor}"
        axes.plot(threads, medians, "-", color=f"C{colour}", label=label)
        ideal = [medians[0] * threads[0] / number for number in threads]
        axes.plot(threads, ideal, ":", color=f"C{colour}", linewidth=0.8)
        for row in own:
            quiet = float(row["others_busy"]) <= QUIET
            axes.plot(
                int(row["threads"]), float(row["wall_s"]), "o", color=f"C{colour}",
                markerfacecolor=f"C{colour}" if quiet else "none",
            )  # fmt: skip
    axes.set(
        xscale="log", yscale="log", xlabel="cores", ylabel="runtime [s]",
        title=f"{RECORDINGS} recordings (dotted: in proportion; hollow: machine was shared)",
    )  # fmt: skip
    ticks = sorted({1, 2, 4, 8} | {int(row["threads"]) for row in rows})
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    target = options.table.with_suffix(".png")
    figure.savefig(target, dpi=110)
    print(f"wrote {target}")


def main() -> None:
    """Measure, or plot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    one = verbs.add_parser("measure", help="run the campaign and append to the table")
    one.add_argument("--threads", default="1,2,4,8")
    one.add_argument("--engines", default="exact,fast")
    one.add_argument("--rounds", type=int, default=1)
    one.add_argument("--recordings", type=int, default=RECORDINGS)
    one.set_defaults(run=measure)
    two = verbs.add_parser("plot", help="draw the figure from the table")
    two.set_defaults(run=plot)
    for verb in (one, two):
        verb.add_argument("--table", type=Path, default=TABLE)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
