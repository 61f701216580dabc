"""What a million trials take: peak memory and bytes on disk, of a batch and of a simulation cache.

    python benchmarks/million_trials.py [--simulations N] [--trials N] [--dask N] [--only WORK]
        [--out CSV]

- `cache`: campaigns of 150 trials asked of a simulation cache, one after another, as a diagnosis
  does; responses of 2 and 36 numbers cost nothing to make.
- `cache, opened`: the same file read by a new process, which resumes from it.
- `batch`: very short trials by `run_batch` with a checkpoint.
- `batch, resumed`: the same by a new process, from a journal that holds all of them; the result is
  saved.
- `dask, client and scheduler`, `dask, a worker`: the batch on a local cluster of two worker
  processes of a thread each, whose scheduler lives in the client's process; of the workers the one
  that took more.

`--only batch` measures that work alone (may be repeated) and leaves the other rows of the table.
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

import distributed
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
WORKS: dict[str, dict[str, tuple[str, ...]]] = {
    "cache": {"cache": ("cache",), "cache, opened": ("cache, opened",)},
    "batch": {"batch": ("batch",), "batch, resumed": ("batch, resumed",)},
    "dask": {"dask": ("dask, client and scheduler", "dask, a worker")},
}
"""Pieces of each work, one after another in a folder, and the rows of the table that each gives."""
WORKERS = 2
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


def run_on_workers(folder: Path, count: int) -> float:
    """Run so many trials into the folder on a cluster; the workers' larger peak memory [byte]."""
    with (
        distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=WORKERS, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,  # type: ignore[no-untyped-call]
    ):
        trials = many(short_trial("fast"), count)
        result = run_batch(trials, client=client, checkpoint=prepare_folder(folder, resume=True))
        assert result.judged.all(), set(result["status"])
        peaks: dict[str, float] = client.run(resident, "VmHWM")
        return 1e6 * max(peaks.values())


def child(work: str, folder: Path, count: int) -> None:
    """Do a piece of work in this process and print its peak memory, and its workers' [byte]."""
    of_workers: tuple[float, ...] = ()
    if work == "cache, opened":
        SimulationCache(Cheap(), folder / "simulations.jsonl").close()
    elif work == "cache":
        ask(folder, count)
    elif work == "dask":
        of_workers = (run_on_workers(folder, count),)
    else:
        run(folder, count, save=work == "batch, resumed")
    print(1e6 * resident("VmHWM"), *of_workers)


def peaks(piece: str, folder: Path, count: int) -> list[float]:
    """Peak memory of a piece of work in a process of its own, and of its workers [byte]."""
    command = [sys.executable, __file__, "--child", piece, str(folder), str(count)]
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [float(number) for number in said.split()]


def rows_of(pieces: dict[str, tuple[str, ...]], count: int) -> list[list[str]]:
    """Rows of a work below `HEADER`."""
    rows = []
    fewer = count // 5
    with tempfile.TemporaryDirectory() as few, tempfile.TemporaryDirectory() as all_:
        for piece, names in pieces.items():
            taken, before = peaks(piece, Path(all_), count), peaks(piece, Path(few), fewer)
            files = (file for file in Path(all_).rglob("*") if file.is_file())
            disk = sum(file.stat().st_size for file in files) / count
            for name, most, fewer_most in zip(names, taken, before, strict=True):
                each = (most - fewer_most) / (count - fewer)
                total = (most + (WANTED - count) * each) / 1e6
                rows.append([name, str(count), f"{each:.0f}", f"{disk:.0f}", f"{total:.0f}"])
                print(*rows[-1], sep=" | ", flush=True)
    return rows


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--simulations", type=int, default=WANTED)
    parser.add_argument("--trials", type=int, default=100_000)
    parser.add_argument("--dask", type=int, default=100_000, help="trials of the batch under Dask")
    parser.add_argument("--only", choices=list(WORKS), action="append", help="may be repeated")
    parser.add_argument("--out", type=Path, default=RESULTS / "million_trials.csv")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        work, folder, count = options.child
        child(work, Path(folder), int(count))
        return
    counts = {"cache": options.simulations, "batch": options.trials, "dask": options.dask}
    rows: dict[str, list[str]] = {}
    if options.only and options.out.exists():
        with options.out.open(newline="") as file:
            rows = {row[0]: row for row in list(csv.reader(file))[1:]}
    for work in options.only or WORKS:
        rows |= {row[0]: row for row in rows_of(WORKS[work], counts[work])}
    with options.out.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADER, *rows.values()])


if __name__ == "__main__":
    main()
