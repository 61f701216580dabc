"""What lanes would give at most: several trials in one register, which does what any of them needs.

    VSR2_LAB_DATA=FOLDER python benchmarks/lane_occupancy.py [--trials N] [--out CSV]

The plain batches of throughput_work.py run with every step taken and their contacts logged. From
the log each step is of one of three kinds: no contact, all contacts stick (solved at once), or one
slides (swept). A register of 4 or 8 lanes then runs the trials in lockstep, each in its own phase,
refilled as trials end, and pays for every kind that one of its lanes has. With `grouped` it takes,
of 64 trials under way, lanes of one kind as long as there are any; moving trials between registers
is free. What a kind costs are the instructions of docs/results/instructions.csv, and for a swept
step `SWEPT`. The bound lets detection, rows, solving and bookkeeping run in lanes without a loss.

The committed table is docs/results/lane_occupancy.csv.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from throughput_work import LAB, block, laboratory, thinned, trials_of
from vsr2.results import CONTACT_COLUMNS
from vsr2.simulation import run_batch
from vsr2.trial import Trial

RESULTS = Path(__file__).resolve().parent.parent / "docs" / "results"
FREE, STICK, SLIDE = range(3)
COMMON, STUCK = 3200, 970
"""Instructions of a step without its solve, and of solving sticking contacts at once."""
SWEPT = 9800
"""Of sweeps: the 0.98 us by which a swept step takes longer, at 10 instructions a nanosecond
(docs/results/engine_speed_SP1.csv)."""
LANES = (4, 8)
IN_FLIGHT = 64
SLIDING = 0.999
"""Of the friction's limit, from which a contact counts as sliding."""

Kinds = NDArray[np.int8]


def kinds_of(trial: Trial) -> Kinds:
    """The kind of each step of a trial, without its settling."""
    output = trial.output.model_copy(update={"contacts_every": 1, "log_every": 1})
    result = run_batch([replace(trial, output=output)], threads=1)
    log, scene = result.logs[0], trial.scene
    if log is None:
        raise SystemExit(f"{trial.label} has no log: {result['message'][0]}")
    steps = int((log.time > 0).sum())
    kinds = np.full(steps, FREE, np.int8)
    column = {name: i for i, name in enumerate(CONTACT_COLUMNS)}
    rows = log.contacts
    at = np.rint(rows[:, column["time"]] / scene.engine.time_step).astype(int) - 1
    contact = scene.contact
    friction = contact.rock.lateral_friction * contact.pedestal.lateral_friction
    normal = rows[:, column["normal_impulse"]]
    lateral = np.hypot(rows[:, column["lateral_impulse_1"]], rows[:, column["lateral_impulse_2"]])
    pressed = (normal > 0) & (at >= 0) & (at < steps)
    kinds[at[pressed]] = STICK
    kinds[at[pressed & (lateral >= SLIDING * friction * normal)]] = SLIDE
    return kinds


def cost(kinds: Counter[int]) -> int:
    """Instructions of a register that holds these kinds."""
    return COMMON + STUCK * bool(kinds[STICK]) + SWEPT * bool(kinds[SLIDE])


def scalar(trials: list[Kinds]) -> int:
    """Instructions of all steps, one trial after another."""
    return sum(cost(Counter({kind: 1})) * int((one == kind).sum()) for one in trials
               for kind in (FREE, STICK, SLIDE))  # fmt: skip


def in_lanes(trials: list[Kinds], lanes: int, *, grouped: bool) -> int:
    """Instructions where so many trials share a register."""
    waiting = [one for one in trials if len(one)]
    flying: list[tuple[Kinds, int]] = []
    spent = 0
    while waiting or flying:
        while waiting and len(flying) < (IN_FLIGHT if grouped else lanes):
            flying.append((waiting.pop(), 0))
        if grouped:
            flying.sort(key=lambda one: one[1] - len(one[0]))  # the longest to go first
            counts = Counter(int(one[at]) for one, at in flying)
            kind = max(counts, key=lambda k: min(counts[k], lanes) + counts[k] / IN_FLIGHT)
            flying.sort(key=lambda one: int(one[0][one[1]]) != kind)
        stepped = flying[:lanes]
        spent += cost(Counter(int(one[at]) for one, at in stepped))
        flying = [(one, at + 1) for one, at in stepped if at + 1 < len(one)] + flying[lanes:]
    return spent


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--out", type=Path, default=RESULTS / "lane_occupancy.csv")
    options = parser.parse_args()
    works = {"block": block} | ({"SP1": laboratory} if LAB.is_dir() else {})
    rows: list[dict[str, str]] = []
    for name, make in works.items():
        campaign, study = make()
        kinds = [kinds_of(trial) for trial in trials_of(thinned(campaign, options.trials), study)]
        every = np.concatenate(kinds)
        alone = scalar(kinds)
        for lanes in LANES:
            for grouped in (False, True):
                gain = alone / in_lanes(kinds, lanes, grouped=grouped)
                rows.append(
                    {
                        "scene": name,
                        "lanes": str(lanes),
                        "grouped": "yes" if grouped else "no",
                        "share_free": f"{(every == FREE).mean():.3f}",
                        "share_sliding": f"{(every == SLIDE).mean():.3f}",
                        "gain_at_most": f"{gain:.2f}",
                    }
                )
                print(*rows[-1].values(), flush=True)
    with options.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
