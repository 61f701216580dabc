"""What lanes give: kernels that run several trials in one register, timed beside the core's step.

    python benchmarks/lanes.py [--rounds N] [--trials N] [--core LIBRARY] [--out CSV]

benchmarks/lanes/ is a program of its own, no part of the product. This builds it (CMake, a C++
compiler and Bullet as for the core) and runs it. `--core` names a `libvsr2_core.a` that is built.

`step`: the plain batch of the block (throughput_work.py), every step of its motions taken, without
tails. The core's stepper runs the trials one by one. A kernel runs them in lockstep, each in its
own phase, and fills a lane again where its trial ends. A step that the kernel does not know (a
contact slides, or one alone bears) is the core's. The scalar kernel, lanes across trials, lanes
across the four contacts of one trial, and impulses in single precision are one source, so that
their bits are comparable. `sweep`: one sweep of projected Gauss-Seidel over four contacts, from 30
sweeps of each of 256 problems.

Times are CPU time, all in turn in each round; ratios are medians over rounds. `plain_batch` and
`campaign` say by Amdahl's law how many times as fast a trial would become with the measured gain.
The committed tables are docs/results/lanes.csv and, of the numbers compared with the core's step
by step, docs/results/lanes_agreement.csv.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

from throughput_work import block, thinned, trials_of

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
BUILD = ROOT / "build" / "lanes"
STEPPER_OF_BATCH = 0.77
"""Share of the core's instructions in the stepper, of the block's plain batch
(docs/results/instructions.csv: 3,237 of 4,183)."""
STEPPER_OF_CAMPAIGN = 0.53
"""The same in campaigns with effects, by callgrind (docs/validation/engines.md)."""
OUTSIDE_OF_BATCH, OUTSIDE = 0.24, 0.17
"""Shares of CPU time outside the core, of the block's plain batch and of its campaigns
(docs/results/throughput.csv)."""
GIVEN = ["kernel", "instructions", "across", "impulses", "lanes", "bits_of_scalar", "share_alone"]
HEADER = [*GIVEN, "overturned", "ns", "times_core", "least", "greatest", "times_scalar"]
HEADER += ["plain_batch", "campaign"]
Table = list[dict[str, str]]


def work(count: int) -> list[float]:
    """What the program reads: the block, its material and so many of its batch's motions."""
    campaign, study = block()
    motions = [trial.motion for trial in trials_of(thinned(campaign, count), study)]
    rock, contact = study.rock, study.contact
    if contact.rock != contact.pedestal:
        raise SystemExit("the program gives rock and pedestal one material")
    head = [study.engine.time_step, *rock.size, rock.density]  # type: ignore[union-attr]
    head += [*contact.rock.model_dump().values(), len(motions)]
    samples = [np.asarray(motion.displacement, float) for motion in motions]
    return [*head, *map(len, samples), *np.concatenate(samples)]


def built(core: Path | None) -> Path:
    """The program."""
    given = "" if core is None else core.resolve()
    source = str(ROOT / "benchmarks" / "lanes")
    configure = ["cmake", "-S", source, "-B", str(BUILD), "-G", "Ninja"]
    configure += ["-DCMAKE_BUILD_TYPE=Release", f"-DVSR2_CORE={given}"]
    for command in (configure, ["cmake", "--build", str(BUILD)]):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return BUILD / "lanes"


def amdahl(share: float, gain: float) -> float:
    """Times as fast, where a share of the time becomes so many times as fast."""
    return 1 / (1 - share + share / gain)


def plain_batch(gain: float) -> float:
    """The same of a trial of a plain batch, whose stepper has the gain."""
    return amdahl(1 - OUTSIDE_OF_BATCH, amdahl(STEPPER_OF_BATCH, gain))


def campaign(gain: float) -> float:
    """The same of a trial of a campaign."""
    return amdahl(1 - OUTSIDE, amdahl(STEPPER_OF_CAMPAIGN, gain))


def tables(printed: str) -> tuple[Table, Table]:
    """Speeds and agreement, from what the program prints."""
    lines = list(csv.reader(printed.splitlines()))
    agreement = [{"what": line[1], "value": line[2]} for line in lines if line[0] == "check"]
    measured = [
        (line[:8], [float(time) for time in line[8:]]) for line in lines if line[0] != "check"
    ]
    core = {line[0]: times for line, times in measured if line[2] == "the core"}
    alone = ["trials", "double", "1"]
    scalar = {line[0]: times for line, times in measured if line[2:5] == alone}
    speeds = []
    for line, times in measured:
        row = dict(zip(HEADER, line, strict=False))
        row["share_alone"] = f"{float(row['share_alone']):.4f}"
        row["overturned"] = f"{float(row['overturned']):.3f}" if line[0] == "step" else ""
        ratios = [a / b for a, b in zip(core[line[0]], times, strict=True)]
        gain = median(ratios)
        by_scalar = median(a / b for a, b in zip(scalar[line[0]], times, strict=True))
        row |= {"ns": f"{median(times):.1f}", "times_core": f"{gain:.2f}"}
        row |= {"least": f"{min(ratios):.2f}", "greatest": f"{max(ratios):.2f}"}
        row |= {"times_scalar": f"{by_scalar:.2f}", "plain_batch": "", "campaign": ""}
        if line[0] == "step":
            row["plain_batch"] = f"{plain_batch(gain):.2f}"
            row["campaign"] = f"{campaign(gain):.2f}"
        speeds.append(row)
    return speeds, agreement


def write(rows: Table, path: Path) -> None:
    """A table as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Build, measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--trials", type=int, default=150)
    parser.add_argument("--core", type=Path, help="the core's library, if it is built already")
    parser.add_argument("--out", type=Path, default=RESULTS / "lanes.csv")
    options = parser.parse_args()
    program = built(options.core)
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder) / "work.bin"
        np.asarray(work(options.trials)).tofile(given)
        command = [str(program), str(given), str(options.rounds)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    speeds, agreement = tables(done.stdout)
    write(speeds, options.out)
    write(agreement, options.out.with_name(f"{options.out.stem}_agreement.csv"))
    for row in (*speeds, *agreement):
        print(*row.values(), sep="  ")


if __name__ == "__main__":
    main()
