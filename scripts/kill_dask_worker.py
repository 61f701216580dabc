"""Kill one of two Dask workers at a random moment of a batch, and compare with an undisturbed run.

    python scripts/kill_dask_worker.py STUDY.yaml --work out/dask --rounds 5 [--seed 0]

Two worker processes of a thread each run the study's trials, with logs, into a folder that keeps
what is finished. A round ends one of them by SIGKILL while trials are under way; the other goes on,
with the one that Dask starts in its place. Each round has workers of its own. Then the folder must
hold, to the bit, what the same batch without Dask wrote. Exit code 1: something differs. One line a
round; the table `dask_kills.csv` in the folder of --work is written after each.
"""

from __future__ import annotations

import argparse
import csv
import logging
import os
import random
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import distributed

from vsr2.config import load_study
from vsr2.results import prepare_folder, save_result
from vsr2.simulation import run_batch, study_trials
from vsr2.trial import Trial

WORKERS = 2
HEADER = ("round", "trials", "finished_before", "differs")


def content(out: Path) -> dict[str, bytes]:
    """Table and logs of a result, by file."""
    files = [out / "trials.csv", *sorted(out.glob("logs/*"))]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def run(trials: list[Trial], out: Path, client: distributed.Client | None = None) -> None:
    """Run trials into a new folder."""
    shutil.rmtree(out, ignore_errors=True)
    result = run_batch(trials, client=client, checkpoint=prepare_folder(out))
    save_result(result, out, streamed_logs=True)


@contextmanager
def workers() -> Iterator[distributed.Client]:
    """The client of a new cluster on this machine."""
    with (
        distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=WORKERS,
            threads_per_worker=1,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,  # type: ignore[no-untyped-call]
    ):
        client.wait_for_workers(WORKERS)
        yield client


def finished(out: Path) -> int:
    """Trials in the journal of a batch that is under way."""
    journal = out / "journal.jsonl"
    return journal.read_bytes().count(b"\n") - 1 if journal.exists() else 0


class Killer(threading.Thread):
    """Ends a process at a moment of a batch, if the batch is still under way.

    Attributes:
        before: trials that were finished then; None: the batch had ended.
    """

    def __init__(self, process: int, moment_s: float, out: Path, count: int) -> None:
        super().__init__(daemon=True)
        self.before: int | None = None
        self._target, self._moment_s, self._out, self._count = process, moment_s, out, count

    def run(self) -> None:
        """Wait, look and kill."""
        while not (self._out / "journal.jsonl").exists():
            time.sleep(0.001)
        time.sleep(self._moment_s)
        done = finished(self._out)
        if 0 <= done < self._count:
            os.kill(self._target, signal.SIGKILL)
            self.before = done


def disturbed(trials: list[Trial], out: Path, moment_s: float) -> int | None:
    """One batch with a kill: trials finished before it; None: the batch had ended."""
    shutil.rmtree(out, ignore_errors=True)
    with workers() as client:
        process = min(client.run(os.getpid).values())
        killer = Killer(process, moment_s, out, len(trials))
        killer.start()
        run(trials, out, client)
        killer.join()
    return killer.before


def main() -> int:
    """Rounds until so many kills met a batch under way."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    work = asked.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    chance = random.Random(asked.seed)
    trials = list(study_trials(load_study(asked.study, overrides=["output.log_every=10"])))
    run(trials, work / "calm")
    expected = content(work / "calm")
    rows: list[tuple[int, ...]] = []
    with workers() as client:
        began = time.monotonic()
        run(trials, work / "far", client)
        usual_s = time.monotonic() - began
    differed = content(work / "far") != expected
    print(f"{len(trials)} trials on {WORKERS} workers in {usual_s:.1f} s, undisturbed", flush=True)
    out = work / "killed"
    while len(rows) < asked.rounds:
        before = disturbed(trials, out, chance.uniform(0.0, usual_s))
        if before is None:
            continue
        differs = content(out) != expected
        rows.append((len(rows) + 1, len(trials), before, int(differs)))
        said = "differs" if differs else "equal to the bit"
        print(f"round {len(rows)}: killed after {before} trials, {said}", flush=True)
        with (work / "dask_kills.csv").open("w", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows([HEADER, *rows])
    bad = sum(row[-1] for row in rows) + differed
    print(f"{len(rows)} kills, {bad} results that differ")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
