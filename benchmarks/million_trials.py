"""What a million trials take: peak memory and bytes on disk, of a batch and of a simulation cache.

    python benchmarks/million_trials.py [--simulations N] [--trials N] [--out CSV]

- `cache`: campaigns of 150 trials asked of a simulation cache, one after another, as a diagnosis
  does; responses of 2 and 36 numbers cost nothing to make.
- `cache, opened`: the same file read by a new process, which resumes from it.
- `batch`: very short trials by `run_batch` with a checkpoint.
- `batch, resumed`: the same by a new process, from a journal that holds all of them; the result is
  saved.

Each figure is of a process of its own. Memory a trial is the growth of peak resident memory from a
fifth of the trials to all of them; `MB for 1.2 million` goes on in proportion.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling import many, resident, short_trial
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.simulator import Request, Responses
from vsr2.results import prepare_folder, save_result
from vsr2.simulation import run_batch

RESULTS = Path(__file__).resolve().parent.parent / "docs" / "results"
CAMPAIGN = 150
"""Trials of a campaign."""
NUISANCES, FEATURES = 20, 36
WANTED = 1_200_000
"""Trials of 8,000 campaigns."""
WORKS = ("cache", "cache, opened", "batch", "batch, resumed")
HEADER = ("work", "trials", "memory a trial [byte]", "disk a trial [byte]", "MB for 1.2 million")


class Cheap:
    """A simulator whose responses depend on the request and cost nothing."""

    identity = "cheap"
    variants = ()
    nuisance_names = tuple(f"n{i}" for i in range(NUISANCES))

    def __init__(self) -> None:
        self.library: Library = {}

    def nuisance_draw(self, index: int) -> NDArray[np.float64]:
        """As its index says, shape (`NUISANCES`,)."""
        return np.full(NUISANCES, float(index))

    def run(self, requests: Sequence[Request]) -> Responses:
        """Numbers of trial and draw."""
        peak = np.array([one.trial / CAMPAIGN + one.nuisance for one in requests])
        features = np.tile(peak[:, None], (1, FEATURES))
        return Responses((peak % 1 > 0.5).astype(float), peak, features)


def ask(folder: Path, count: int) -> None:
    """Ask a cache in the folder for so many simulations."""
    with SimulationCache(Cheap(), folder / "simulations.jsonl") as cache:
        for draw in range(max(1, count // CAMPAIGN)):
            cache.run([Request(trial, (), draw, 1) for trial in range(CAMPAIGN)])


def run(folder: Path, count: int, *, save: bool) -> None:
    """Run so many trials into the folder, or go on there and save the result."""
    trials = many(short_trial("fast"), count)
    result = run_batch(trials, checkpoint=prepare_folder(folder, resume=True))
    if save:
        save_result(result, folder, streamed_logs=True)


def child(work: str, folder: Path, count: int) -> None:
    """Do a piece of work in this process and print its peak memory [byte]."""
    if work == "cache, opened":
        SimulationCache(Cheap(), folder / "simulations.jsonl").close()
    elif work == "cache":
        ask(folder, count)
    else:
        run(folder, count, save=work == "batch, resumed")
    print(1e6 * resident("VmHWM"))


def peak(work: str, folder: Path, count: int) -> float:
    """Peak memory of a piece of work in a process of its own [byte]."""
    command = [sys.executable, __file__, "--child", work, str(folder), str(count)]
    return float(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def rows_of(counts: dict[str, int]) -> list[list[str]]:
    """One row a work below `HEADER`."""
    rows = []
    for works, count in ((WORKS[:2], counts["cache"]), (WORKS[2:], counts["batch"])):
        fewer = count // 5
        with tempfile.TemporaryDirectory() as few, tempfile.TemporaryDirectory() as all_:
            for work in works:
                taken = peak(work, Path(all_), count)
                each = (taken - peak(work, Path(few), fewer)) / (count - fewer)
                total = (taken + (WANTED - count) * each) / 1e6
                files = (file for file in Path(all_).rglob("*") if file.is_file())
                disk = sum(file.stat().st_size for file in files) / count
                rows.append([work, str(count), f"{each:.0f}", f"{disk:.0f}", f"{total:.0f}"])
                print(*rows[-1], sep=" | ", flush=True)
    return rows


def main() -> None:
    """Measure all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--simulations", type=int, default=WANTED)
    parser.add_argument("--trials", type=int, default=100_000)
    parser.add_argument("--out", type=Path, default=RESULTS / "million_trials.csv")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        work, folder, count = options.child
        child(work, Path(folder), int(count))
        return
    rows = rows_of({"cache": options.simulations, "batch": options.trials})
    with options.out.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADER, *rows])


if __name__ == "__main__":
    main()
