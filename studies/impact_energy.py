"""What an impact leaves of the energy, by engine and time step, over Housner's ratio.

    python studies/impact_energy.py [--members 16] [--out FILE]

The block of configs/blind.yaml is shaken squarely by one cycle of a sine, 15 of them, and then
rocks freely. From the largest tilts of one excursion and the next follows what the impact between
them left, which Housner (1963) says is (1 - 3/2 sin^2 alpha)^2. Rows of one contact model have the
median over the motions. Rows of a family have the mean and the standard deviation of these medians
over members of the family that the diagnosis draws from, or of MuJoCo's of packs of development.
Half a minute; the committed table is docs/results/impact_energy.csv.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_equivalence import ROOT, write_table
from nominal_scene import nominal
from vsr2.blind.mujoco import (
    ContactModel,
    Situation,
    TableMotion,
    block,
    draw_contact,
    run_trial,
)
from vsr2.config.study import BoxRock
from vsr2.ensemble.simulated.contact_family import AlternativeContact
from vsr2.motion import Record, build_recorded_motion
from vsr2.scene import build_scene
from vsr2.simulation import run_batch
from vsr2.trial import Trial

Array = NDArray[np.float64]

PEAKS = (7.5, 8.2, 9.0)
"""Of the table's acceleration [m/s^2]; that of uplift is 4.1."""
DURATIONS = (0.25, 0.3, 0.35, 0.4, 0.45)
"""Of the cycle [s]."""
FREE = 0.46
"""From when the table moves on evenly [s]; excursions that begin later are compared."""
UPLIFT = 0.004
"""Tilt above which the block has lifted off [rad]."""
IMPACTS = 3
STEPS_MS = (2.0, 1.0, 0.5, 0.25)
STEP = 0.001
"""Of the table's motion and of the tilt that is read [s]."""
LENGTH = 5.0
FAMILY = AlternativeContact()


def cycles() -> list[TableMotion]:
    """The table's motions."""
    time = np.arange(0, LENGTH, STEP)
    out = []
    for peak in PEAKS:
        for duration in DURATIONS:
            a = np.where(time < duration, peak * np.sin(2 * np.pi * time / duration), 0.0)
            out.append(TableMotion(STEP, np.cumsum(np.cumsum(a)) * STEP**2))
    return out


def excursions(time: Array, tilt: Array) -> list[tuple[float, float]]:
    """Largest tilt [rad] and duration [s] of each excursion of the free block."""
    up = np.concatenate([[False], tilt > UPLIFT, [False]])
    starts, ends = np.flatnonzero(up[1:] & ~up[:-1]), np.flatnonzero(up[:-1] & ~up[1:])
    return [
        (float(tilt[a:b].max()), float(time[b - 1] - time[a]))
        for a, b in zip(starts, ends, strict=True)
        if time[a] > FREE
    ]


def in_bullet(
    tables: Sequence[TableMotion],
    overrides: tuple[str, ...] = (),
    contact: dict[str, float] | None = None,
) -> list[list[tuple[float, float]]]:
    """Excursions in Bullet, by motion.

    Args:
        tables: motions.
        overrides: of the study.
        contact: values of a member of the contact family.
    """
    study = nominal(("output.log_every=1", *overrides))
    batch = []
    for table in tables:
        record = Record("cycle", table.interval, displacement=table.x)
        trial = Trial(
            scene=build_scene(study),
            motion=build_recorded_motion(record, study.engine.time_step),
            settling=study.settling,
            outcome=study.outcome,
            output=study.output,
        )
        batch.append(trial if contact is None else FAMILY.change(trial, contact))
    out = []
    for log in run_batch(batch, threads=1).logs:
        assert log is not None
        time, tilt = np.asarray(log.time), np.asarray(log.tilt)
        out.append(excursions(time[time >= 0], tilt[time >= 0]))
    return out


def in_mujoco(
    tables: Sequence[TableMotion], contact: ContactModel
) -> list[list[tuple[float, float]]]:
    """Excursions in MuJoCo, by motion."""
    study = nominal()
    assert isinstance(study.rock, BoxRock)
    body = block(*study.rock.size, study.rock.density or 0.0)
    friction = study.contact.rock.lateral_friction * study.contact.pedestal.lateral_friction
    responses = (
        run_trial(Situation(body, t, friction=friction, contact=contact), series_interval=STEP)
        for t in tables
    )
    return [excursions(one.time, one.tilt) for one in responses]


def left(found: list[list[tuple[float, float]]]) -> Array:
    """Medians of energies left over Housner's, and of the durations before, shape (2, IMPACTS)."""
    rock = nominal().rock
    assert isinstance(rock, BoxRock)
    alpha = math.atan2(rock.size[0], rock.size[2])
    housner = (1 - 1.5 * math.sin(alpha) ** 2) ** 2
    ratios = np.full((len(found), IMPACTS), np.nan)
    durations = np.full((len(found), IMPACTS), np.nan)
    for row, one in enumerate(found):
        energy = [math.cos(alpha - tilt) - math.cos(alpha) for tilt, _ in one]
        if not one or one[0][0] >= alpha:
            continue
        for k in range(min(IMPACTS, len(one) - 1)):
            ratios[row, k] = energy[k + 1] / energy[k] / housner
            durations[row, k] = one[k][1]
    return np.stack([np.nanmedian(ratios, axis=0), np.nanmedian(durations, axis=0)])


def columns(values: Array, spread: Array | None = None) -> dict[str, str]:
    """Of a row of the table."""
    out = {}
    for k, name in enumerate(("first", "second", "third")):
        out[f"{name}_left"] = f"{values[0, k]:.3f}"
        out[f"{name}_sd"] = "" if spread is None else f"{spread[0, k]:.3f}"
        out[f"{name}_duration_s"] = f"{values[1, k]:.3f}"
    return out


def main() -> None:
    """Compare, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--members", type=int, default=16, help="of each family (default: 16)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/results/impact_energy.csv")
    options = parser.parse_args()
    tables = cycles()
    rows = []
    for step in STEPS_MS:
        one = left(in_bullet(tables, (f"engine.time_step={step / 1000!r}",)))
        rows.append({"simulation": f"Bullet, {step:g} ms", **columns(one)})
    drawn = []
    for member in range(options.members):
        rng = np.random.default_rng([6, member])
        values = {p.name: float(rng.uniform(p.lower, p.upper)) for p in FAMILY.parameters}
        drawn.append(left(in_bullet(tables, contact=values)))
    others = [
        left(in_mujoco(tables, draw_contact(np.random.default_rng([5, member]), development=True)))
        for member in range(options.members)
    ]
    for name, family in (("Bullet, contact family", drawn), ("MuJoCo, contact family", others)):
        of = columns(np.mean(family, axis=0), np.std(family, axis=0))
        rows.append({"simulation": name, **of})
    write_table(rows, options.out)


if __name__ == "__main__":
    main()
