"""Trials a second, as a diagnosis and as plain batches, against another version and against MuJoCo.

    pip install '.[benchmark]'
    python benchmarks/throughput.py [--against PYTHON_FOLDER] [--works NAME ...] [--rounds N]
                                    [--trials N] [--draws N] [--threads N]
                                    [--time-step S] [--out CSV]

The works are those of throughput_work.py: campaigns under fresh nuisances and effects, and plain
batches. `--against` names the folder `python` of another checkout with its native module in it:
the same work is then done by that version too. What acts in campaigns is drawn once, by this
version, from the effects and nuisances that both have, and both get the values; the table says how
many of its own each side draws from. Batches are run by `mujoco.rollout` as well, whose
rock is shaken by an inertial force (mujoco_rock.py), and by MJX and MuJoCo Warp on the CPU where
they are installed (`pip install mujoco-mjx mujoco-warp`); those two are slower than MuJoCo, so they
run a part of each motion and their trials are counted by it.

MuJoCo is favoured: it runs the motions alone, from a rock that was settled before, and ours settle
and rest afterwards within the time that is measured. A rock that has fallen ends a trial in both.

Every measurement is a process of its own, and what is imported, built once and compiled is not
timed. Engines follow one another in every round, so that a change of the machine's speed meets all
of them. The table gives totals: trials of all rounds over their summed time, and ratios of these,
by wall time and by CPU time, with the least and greatest ratio of a single round. Where the machine
is shared, CPU time is the one to read. It also says which part of the CPU time the thread takes
that makes the trials. Works whose data are absent are skipped, and the reason is printed.
`--out` keeps rows of other works and time steps that the file has.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import vsr2
from throughput_work import (
    DRAWS,
    Draw,
    Known,
    campaign_and_study,
    drawn,
    known,
    library_of,
    study_of,
    usual_nuisances,
)
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
        overturned: share of the trials with an outcome, NaN where it is not known.
        failed: trials without outcome.
    """

    trials: float
    wall: float
    cpu: float
    making: float
    overturned: float
    failed: int


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


class Drawn(NamedTuple):
    """Campaigns of a work, drawn once for all versions that simulate them.

    Attributes:
        draws: of all rounds.
        effects, nuisances: how many all versions have, and how many each has, by engine.
    """

    draws: list[Draw]
    effects: dict[str, str]
    nuisances: dict[str, str]


def common_to(versions: Sequence[Known]) -> Known:
    """What all versions know by the same name and with the same description."""
    first, *others = versions
    return {
        kind: {
            name: described
            for name, described in members.items()
            if all(other[kind].get(name) == described for other in others)
        }
        for kind, members in first.items()
    }


def drawn_once(work: str, options: argparse.Namespace) -> Drawn:
    """Draw all campaigns of a work from what this version and the other one have."""
    campaign, study = campaign_and_study(work, options.trials, options.time_step)
    pools = library_of(campaign, study), usual_nuisances()
    has = {"vsr2": known(*pools)}
    if options.against is not None:
        has["against"] = json.loads(done(work, "against", 0, options, know=True))
    common = common_to([*has.values()])
    count = options.rounds * (options.draws or DRAWS[work])
    made = drawn(*pools, common, range(count))
    effects, nuisances = (
        {name: f"{len(common[kind])} of {len(own[kind])}" for name, own in has.items()}
        for kind in ("effects", "nuisances")
    )
    return Drawn(made, effects, nuisances)


def done(
    work: str,
    engine: str,
    round_: int,
    options: argparse.Namespace,
    *,
    draws: Sequence[Draw] | None = None,
    know: bool = False,
) -> str:
    """The last line that throughput_work.py prints, in a process of its own.

    Args:
        work: which.
        engine: as of `Key`.
        round_: from 0.
        options: of the command.
        draws: campaigns; None: the work is a batch, or `know`.
        know: ask what can be drawn from.

    Raises:
        SystemExit: it fails.
    """
    own = Path(vsr2.__file__).resolve().parents[1]
    imported = options.against if engine == "against" else own
    command = [sys.executable, str(FOLDER / "throughput_work.py"), work]
    command += ["vsr2" if engine == "against" else engine, str(round_)]
    for name in ("trials", "threads", "time_step"):
        if getattr(options, name) is not None:
            command += [f"--{name.replace('_', '-')}", str(getattr(options, name))]
    command += ["--know"] * know + ["--given"] * (draws is not None)
    environment = {**os.environ, "PYTHONPATH": str(imported), "VSR2_LAB_DATA": str(LAB)}
    finished = subprocess.run(
        command, env=environment, input=json.dumps(draws), capture_output=True, text=True
    )
    if finished.returncode:
        raise SystemExit(f"{work} by {engine} failed:\n{finished.stderr[-2000:]}")
    return finished.stdout.splitlines()[-1]


def possible(options: argparse.Namespace) -> list[str]:
    """Works that can be done here; says why others cannot."""
    works = []
    for work in options.works:
        reason = refusal(work)
        if reason:
            print(f"{work} is skipped: {reason}", flush=True)
        else:
            works.append(work)
    return works


def measured(
    options: argparse.Namespace, campaigns: Mapping[str, Drawn]
) -> dict[Key, list[Measured]]:
    """All rounds of all works that can be done.

    Args:
        options: of the command.
        campaigns: by the work.
    """
    found: dict[Key, list[Measured]] = {}
    for round_ in range(options.rounds):
        for work in options.works:
            draws = None
            if work in campaigns:
                count = len(campaigns[work].draws) // options.rounds
                draws = campaigns[work].draws[round_ * count : (round_ + 1) * count]
                print(f"round {round_ + 1}: {work}, {acting_in(draws)}", flush=True)
            for engine in engines_of(work, options.against):
                one = Measured(**json.loads(done(work, engine, round_, options, draws=draws)))
                found.setdefault((work, engine), []).append(one)
                rate, cost = one.trials / one.wall, 1e3 * one.cpu / one.trials
                what = f"round {round_ + 1}: {work}, {engine}"
                outside = f"{one.making / one.cpu:.1%} outside the core's threads"
                print(
                    f"{what}: {rate:.1f} trials a second, {cost:.3g} ms of CPU each, {outside}, "
                    f"{one.overturned:.3f} overturned, {one.failed} without outcome",
                    flush=True,
                )
    return found


def acting_in(draws: Sequence[Draw]) -> str:
    """Names of the effects of campaigns."""
    return "; ".join(" and ".join(draw["effects"]) or "none" for draw in draws)


HEADER = [
    "work",
    "engine",
    "time step [ms]",
    "rounds",
    "trials",
    "effects drawn from, of all",
    "nuisances drawn, of all",
    "trials a second",
    "CPU time of a trial [ms]",
    "of it outside the core's threads [ms]",
    "share",
    "overturned",
    "without outcome",
    "vsr2 over it, wall",
    "least",
    "greatest",
    "vsr2 over it, CPU",
    "least",
    "greatest",
]


def table(
    found: Mapping[Key, Sequence[Measured]],
    campaigns: Mapping[str, Drawn],
    steps: Mapping[str, float],
) -> list[list[str]]:
    """Rows below `HEADER`.

    Args:
        found: by work and engine.
        campaigns: by the work.
        steps: the time step of each work [s].
    """
    rows = []
    for (work, engine), rounds in found.items():
        ours = found[work, "vsr2"]
        trials, making = sum(one.trials for one in rounds), sum(one.making for one in rounds)
        cpu = sum(one.cpu for one in rounds)
        failed = sum(one.failed for one in rounds)
        overturned = sum((one.trials - one.failed) * one.overturned for one in rounds)
        pools = campaigns.get(work, Drawn([], {}, {}))
        cells = [work, engine, f"{1e3 * steps[work]:g}", str(len(rounds)), f"{trials:.0f}"]
        cells += [pools.effects.get(engine, ""), pools.nuisances.get(engine, "")]
        cells += [f"{trials / sum(one.wall for one in rounds):.1f}", f"{1e3 * cpu / trials:.2f}"]
        cells += [
            f"{1e3 * making / trials:.3f}",
            f"{making / cpu:.3f}",
            f"{overturned / (trials - failed):.3f}",
            str(failed),
        ]
        for clock in ("wall", "cpu"):
            singles = [times_as_fast([a], [b], clock) for a, b in zip(ours, rounds, strict=True)]
            ratios = times_as_fast(ours, rounds, clock), min(singles), max(singles)
            cells += [f"{ratio:.2f}" for ratio in ratios]
        rows.append(cells)
    return rows


def times_as_fast(ours: Sequence[Measured], theirs: Sequence[Measured], clock: str) -> float:
    """Trials over time, in all rounds together, over those of another."""
    ours_, theirs_ = (
        sum(one.trials for one in rounds) / sum(getattr(one, clock) for one in rounds)
        for rounds in (ours, theirs)
    )
    return float(ours_ / theirs_)


def write(rows: Sequence[Sequence[str]], path: Path) -> None:
    """A CSV of these rows, and of those that the file has of other works and time steps."""
    kept: list[list[str]] = []
    if path.is_file():
        with path.open(newline="") as file:
            header, *old = csv.reader(file)
        if header == HEADER:
            new = {(row[0], row[2]) for row in rows}
            kept = [row for row in old if (row[0], row[2]) not in new]
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADER, *kept, *rows])


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", type=Path, help="folder `python` of another checkout")
    parser.add_argument("--works", nargs="+", choices=WORKS, default=WORKS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--trials", type=int, help="of a campaign or a batch, fewer than all")
    parser.add_argument("--draws", type=int, help="simulated campaigns a round")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--time-step", type=float, help="[s]; of the study, if not given")
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    options = parser.parse_args()
    if options.against is not None:
        options.against = options.against.resolve()
        if not (options.against / "vsr2").is_dir():
            raise SystemExit(f"--against: {options.against} holds no package vsr2")
    options.works = possible(options)
    campaigns = {w: drawn_once(w, options) for w in options.works if w.startswith("campaign")}
    steps = {
        work: study_of(work.split("-")[1], options.time_step).engine.time_step
        for work in options.works
    }
    rows = table(measured(options, campaigns), campaigns, steps)
    print(f"{options.rounds} rounds, {options.threads} threads; {base_provenance()['processor']}")
    print("| " + " | ".join(HEADER) + " |\n| --- | --- |" + " ---: |" * (len(HEADER) - 2))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    if options.out is not None:
        write(rows, options.out)


if __name__ == "__main__":
    main()
