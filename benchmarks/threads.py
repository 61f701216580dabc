"""Speed-up with threads, and the same bits at any number of them.

    python benchmarks/threads.py [--threads 1,2] [--rounds N] [--engine MODE] [--out CSV]

One batch of equal trials (the embedded rock under an embedded record at strengths below
overturning) is run at each number of threads, one after the other, round after round, so that a
change of the machine's speed meets all of them. The table gives the median wall time, the median
over the rounds of the speed-up against one thread in the same round with its spread, how many
processors other programs kept busy meanwhile (a figure counts only where that is near 0), and what
the machine itself gives: the speed-up of as many processes of one thread each, which share nothing,
over the same trials. First all results are compared bit for bit, logs included, at 1, 2, 3, 8 and
the numbers given.
"""

from __future__ import annotations

import argparse
import csv
import os
import statistics
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from machine_load import busy_seconds
from vsr2.config import load_study
from vsr2.config.study import Output
from vsr2.results import BatchResult, base_provenance
from vsr2.simulation import run_batch, study_trials
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent


def trials_of(engine: str, count: int) -> list[Trial]:
    """Trials of about the same length: one record, slightly different strengths."""
    study = load_study(
        ROOT / "configs" / "demo.yaml",
        overrides=[f"engine.mode={engine}", "motion.pattern=synthetic_07.csv"],
    )
    [trial] = study_trials(study)
    silent = replace(trial, output=Output(log_every=0))
    scales = np.linspace(0.3, 0.5, count)
    return [replace(silent, motion=silent.motion.scaled(float(s))) for s in scales]


def bits(result: BatchResult) -> bytes:
    """Everything a result holds, the provenance aside."""
    columns = [str(result[name].tolist()).encode() for name in result.trials]
    logs = [log.state.tobytes() + log.contacts.tobytes() for log in result.logs if log]
    return b"".join(columns + logs)


def in_processes(trials: list[Trial], count: int) -> float:
    """Wall time of the trials in as many processes of one thread each [s]."""
    begun = time.perf_counter()
    children = []
    for i in range(count):
        child = os.fork()
        if child == 0:
            run_batch(trials[i::count], threads=1)
            os._exit(0)
        children.append(child)
    if any(os.waitpid(child, 0)[1] != 0 for child in children):
        raise SystemExit("a process of the comparison failed")
    return time.perf_counter() - begun


def main() -> None:
    """Compare, measure, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", default="1,2", help="comma-separated (default 1,2)")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--engine", default="exact", help="parity, exact or fast")
    parser.add_argument("--trials", type=int, default=48, help="a multiple of all thread numbers")
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    options = parser.parse_args()
    numbers = sorted({1, *map(int, options.threads.split(","))})
    trials = trials_of(options.engine, options.trials)

    logged = [replace(trial, output=Output(log_every=20, contacts_every=50)) for trial in trials]
    some = logged[: max(8, options.trials // 6)]
    reference = bits(run_batch(some, threads=1))
    compared = sorted({2, 3, 8, *numbers} - {1})
    for number in compared:
        if bits(run_batch(some, threads=number)) != reference:
            raise SystemExit(f"{number} threads give other bits than one")

    walls: dict[int, list[float]] = {number: [] for number in numbers}
    others: dict[int, list[float]] = {number: [] for number in numbers}
    apart: dict[int, list[float]] = {number: [] for number in numbers}
    for _ in range(options.rounds):
        for number in numbers:
            wall, own, all_ = time.perf_counter(), time.process_time(), busy_seconds()
            run_batch(trials, threads=number)
            wall = time.perf_counter() - wall
            walls[number].append(wall)
            foreign = busy_seconds() - all_ - (time.process_time() - own)
            others[number].append(max(0.0, foreign) / wall)
            apart[number].append(in_processes(trials, number))
    print(
        f"engine {options.engine}, {len(trials)} trials, {options.rounds} rounds, "
        f"{len(os.sched_getaffinity(0))} processors ({base_provenance()['processor']}); same bits "
        f"at 1, {', '.join(map(str, compared))} threads"
    )
    header = [
        "threads",
        "wall_s",
        "speedup",
        "speedup_min",
        "speedup_max",
        "others_busy",
        "processes",
    ]
    rows = []
    for number in numbers:
        speedups = [a / b for a, b in zip(walls[1], walls[number], strict=True)]
        values = [statistics.median(walls[number]), statistics.median(speedups)]
        values += [min(speedups), max(speedups), statistics.median(others[number])]
        values.append(
            statistics.median(a / b for a, b in zip(apart[1], apart[number], strict=True))
        )
        rows.append([str(number), *(f"{value:.2f}" for value in values)])
    print("| " + " | ".join(header) + " |\n|" + " ---: |" * len(header))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file).writerows([["engine", *header], *([options.engine, *r] for r in rows)])


if __name__ == "__main__":
    main()
