"""Show what the time step of `fast` costs in truth: ensembles at several steps against the least.

    python studies/time_step.py [--scenes NAME ...] [--records N] [--replicates N]
    VSR2_LAB_DATA=FOLDER python studies/time_step.py --scenes SP1

Replicates with perturbed starts under borderline records, as in engine_equivalence.py, with VSR2's
own contact and damping, are run at each time step from the same starts. A record is resampled in
time, so that every step sees the same motion. Compared with the least step are the overturn
probability, with McNemar's standard error, and the largest tilt of rocks that stand in both: the
median of the logarithm of the ratio, over trials that rock by more than `MOVED`.

Each ensemble is written to `--parts` when it is done; a run that was stopped goes on from there.
Writes `time_step.csv`, one row a scene and a step.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import partial
from typing import Any

import numpy as np

from engine_equivalence import replicates, write_table
from quiet_stretches import by_scene, options_of, scene
from vsr2.motion import Motion, Record, build_recorded_motion
from vsr2.scene import Pose, Scene
from vsr2.simulation import run_batch

STEPS = (0.00025, 0.0005, 0.001, 0.002, 0.004)
"""Time steps [s]; the others are compared with the first."""
MOVED = 0.01
"""Largest tilt from which a rock rocked [rad]."""


def at_step(given: Scene, time_step: float) -> Scene:
    """A scene at another time step."""
    engine = given.engine.model_copy(update={"time_step": time_step})
    return Scene(given.rock, given.pedestal, engine, given.contact)


def ensembles(
    name: str, base: Pose, motion: Motion, seed: int, options: argparse.Namespace
) -> dict[str, Any]:
    """Outcomes, largest tilts [rad] and CPU time [s] at each step under one record."""
    given = scene(name, "quiet")
    record = Record(motion.name, motion.time_step, displacement=motion.displacement)
    found: dict[str, Any] = {"fell": [], "tilt": [], "cpu_s": []}
    for step in STEPS:
        resampled = build_recorded_motion(record, step)
        trials = replicates(
            at_step(given, step), base, resampled, options.replicates, [13, seed, 0]
        )
        begun = time.process_time()
        result = run_batch(trials, threads=options.threads, keep_logs=False)
        found["cpu_s"].append(time.process_time() - begun)
        if not result.judged.all():
            raise SystemExit(f"{(~result.judged).sum()} trials failed at {step} s")
        found["fell"].append(result.overturned.tolist())
        found["tilt"].append(result["peak_tilt"].tolist())
    return found


def rows_of(name: str, found: list[dict[str, Any]]) -> list[dict[str, str]]:
    """One row a step."""
    fell = np.array([f["fell"] for f in found])
    tilt = np.array([f["tilt"] for f in found])
    cpu = np.array([f["cpu_s"] for f in found]).sum(axis=0)
    n = fell.shape[2]
    rows = []
    for k, step in enumerate(STEPS):
        difference = fell[:, k].mean(axis=1) - fell[:, 0].mean(axis=1)
        flipped = (fell[:, k] != fell[:, 0]).mean(axis=1)
        variance = np.maximum(flipped + 1 / n - difference**2, 1 / n) / n
        rocked = ~fell[:, k] & ~fell[:, 0] & (np.minimum(tilt[:, k], tilt[:, 0]) > MOVED)
        ratio = np.log(tilt[:, k][rocked] / tilt[:, 0][rocked])
        rows.append(
            {
                "scene": name,
                "time_step_ms": f"{1e3 * step:g}",
                "records": str(len(found)),
                "replicates": str(n),
                "overturned": f"{fell[:, k].mean():.4f}",
                "difference": f"{difference.mean():+.4f}",
                "standard_error": f"{math.sqrt(variance.sum()) / len(found):.4f}",
                "outcomes_that_differ": f"{flipped.mean():.4f}",
                "ln_tilt_median": f"{np.median(ratio):+.4f}",
                "ln_tilt_size": f"{np.median(np.abs(ratio)):.4f}",
                "cpu_over_1_ms": f"{cpu[k] / cpu[STEPS.index(0.001)]:.2f}",
            }
        )
    return rows


def main() -> None:
    """Run what parts are missing and write the table."""
    options = options_of(__doc__, "time_step", records=40, replicates=50)
    rows: list[dict[str, str]] = []
    for name, found in by_scene(options, "quiet", partial(ensembles, options=options)):
        rows += rows_of(name, found)
        for row in rows[-len(STEPS) :]:
            print(*row.values(), flush=True)
    write_table(rows, options.out / "time_step.csv")


if __name__ == "__main__":
    main()
