"""Trials a second, as a diagnosis and as plain batches, against another version and against MuJoCo.

    pip install '.[benchmark]'
    python benchmarks/throughput.py [--against PYTHON_FOLDER] [--works NAME ...] [--rounds N]
                                    [--trials N] [--draws N] [--threads N] [--out CSV]

The works are those of throughput_work.py: campaigns under fresh nuisances and effects, and plain
batches. `--against` names the folder `python` of another checkout with its native module in it:
the same work is then done by that version too. Batches are run by `mujoco.rollout` as well, whose
rock is shaken by an inertial force (mujoco_rock.py), and by MJX and MuJoCo Warp on the CPU where
they are installed (`pip install mujoco-mjx mujoco-warp`); those two are slower than MuJoCo, so they
run a part of each motion and their trials are counted by it.

MuJoCo is favoured: it runs the motions alone, from a rock that was settled before, and ours settle
and rest afterwards within the time that is measured. A rock that has fallen ends a trial in both.

Every measurement is a process of its own, and what is imported, built once and compiled is not
timed. Engines follow one another in every round, so that a change of the machine's speed meets all
of them. The table gives medians over the rounds and the median of the rounds' ratios, by wall time
and by CPU time; where the machine is shared, CPU time is the one to read. It also says which part
of a trial's CPU time the thread takes that makes the trials. Works whose data are
absent are skipped, and the reason is printed.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import vsr2
from vsr2.results import base_provenance

FOLDER = Path(__file__).resolve().parent
LAB = Path(os.environ.get("VSR2_LAB_DATA", FOLDER.parent.parent / "shared" / "lab"))
WORKS = ("campaign-block", "campaign-SP1", "batch-block", "batch-SP1")
RIVALS = {"mujoco": "mujoco", "mjx": "mujoco.mjx", "warp": "mujoco_warp"}
"""Engines beside ours and the module that each needs."""


class Measured(NamedTuple):
    """One piece of work, done once.

    Attributes:
        trials: a part of one counts as such.
        wall: [s].
        cpu: of all threads [s].
        making: CPU time of the thread that makes trials and takes results [s]: all that is outside
            the core's own threads, and building its scenes.
        overturned: share of the trials, NaN where it is not known.
    """

    trials: float
    wall: float
    cpu: float
    making: float
    overturned: float


Key = tuple[str, str]
"""Work and engine: `vsr2`, `against`, or one of `RIVALS`."""


def engines_of(work: str, against: Path | None) -> list[str]:
    """Those that can do the work here."""
    found = ["vsr2"] + ["against"] * (against is not None)
    if work.startswith("batch"):
        found += [name for name, module in RIVALS.items() if installed(module)]
    return found


def installed(module: str) -> bool:
    """Whether a module is there, its package too."""
    package = module.partition(".")[0]
    return bool(importlib.util.find_spec(package) and importlib.util.find_spec(module))


def refusal(work: str) -> str | None:
    """Why a work cannot be done here."""
    if work.endswith("SP1") and not (LAB / "trials.csv").is_file():
        return f"{LAB} holds no trials.csv; set VSR2_LAB_DATA to the laboratory data"
    return None


def measure(work: str, engine: str, round_: int, options: argparse.Namespace) -> Measured:
    """Do a piece of work in a process of its own.

    Raises:
        SystemExit: it fails.
    """
    own = Path(vsr2.__file__).resolve().parents[1]
    imported = options.against if engine == "against" else own
    command = [sys.executable, str(FOLDER / "throughput_work.py"), work]
    command += ["vsr2" if engine == "against" else engine, str(round_)]
    for name in ("trials", "draws", "threads"):
        if getattr(options, name) is not None:
            command += [f"--{name}", str(getattr(options, name))]
    environment = {**os.environ, "PYTHONPATH": str(imported), "VSR2_LAB_DATA": str(LAB)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{work} by {engine} failed:\n{done.stderr[-2000:]}")
    return Measured(**json.loads(done.stdout.splitlines()[-1]))


def measured(options: argparse.Namespace) -> dict[Key, list[Measured]]:
    """All rounds of all works that can be done."""
    found: dict[Key, list[Measured]] = {}
    works = []
    for work in options.works:
        reason = refusal(work)
        if reason:
            print(f"{work} is skipped: {reason}", flush=True)
        else:
            works.append(work)
    for round_ in range(options.rounds):
        for work in works:
            for engine in engines_of(work, options.against):
                done = measure(work, engine, round_, options)
                found.setdefault((work, engine), []).append(done)
                rate, cost = done.trials / done.wall, 1e3 * done.cpu / done.trials
                what = f"round {round_ + 1}: {work}, {engine}"
                outside = f"{done.making / done.cpu:.1%} outside the core's threads"
                print(
                    f"{what}: {rate:.1f} trials a second, {cost:.3g} ms of CPU each, {outside}",
                    flush=True,
                )
    return found


HEADER = [
    "work",
    "engine",
    "trials a second",
    "least",
    "greatest",
    "CPU time of a trial [ms]",
    "of it outside the core's threads [ms]",
    "share",
    "overturned",
    "vsr2 over it, wall",
    "vsr2 over it, CPU",
]


def table(found: dict[Key, list[Measured]]) -> list[list[str]]:
    """Rows below `HEADER`: medians over the rounds, and of the rounds' ratios."""
    rows = []
    for (work, engine), done in found.items():
        rates = [one.trials / one.wall for one in done]
        costs = [one.cpu / one.trials for one in done]
        ours = found[work, "vsr2"]
        wall = [one.trials / one.wall / rate for one, rate in zip(ours, rates, strict=True)]
        cpu = [cost * one.trials / one.cpu for one, cost in zip(ours, costs, strict=True)]
        cells = [f"{f(rates):.1f}" for f in (statistics.median, min, max)]
        cells.append(f"{1e3 * statistics.median(costs):.2f}")
        cells.append(f"{1e3 * statistics.median(one.making / one.trials for one in done):.3f}")
        cells.append(f"{statistics.median(one.making / one.cpu for one in done):.3f}")
        cells.append(f"{statistics.fmean(one.overturned for one in done):.3f}")
        cells += [f"{statistics.median(ratios):.2f}" for ratios in (wall, cpu)]
        rows.append([work, engine, *cells])
    return rows


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", type=Path, help="folder `python` of another checkout")
    parser.add_argument("--works", nargs="+", choices=WORKS, default=WORKS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--trials", type=int, help="of a campaign or a batch, fewer than all")
    parser.add_argument("--draws", type=int, help="simulated campaigns a round")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    options = parser.parse_args()
    if options.against is not None:
        options.against = options.against.resolve()
        if not (options.against / "vsr2").is_dir():
            raise SystemExit(f"--against: {options.against} holds no package vsr2")
    rows = table(measured(options))
    print(f"{options.rounds} rounds, {options.threads} threads; {base_provenance()['processor']}")
    print("| " + " | ".join(HEADER) + " |\n| --- | --- |" + " ---: |" * (len(HEADER) - 2))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([HEADER, *rows])


if __name__ == "__main__":
    main()
