"""Show what the time step of `fast` costs in truth: overturning margins at several steps.

    python studies/time_step.py [--scenes NAME ...] [--records N] [--replicates N]
    VSR2_LAB_DATA=FOLDER python studies/time_step.py --scenes SP1

A margin is the logarithm of the factor on a record at which the rock overturns, sought by halving
between 0.2 and 3 times the record. Each replicate has a perturbed start, as in
engine_equivalence.py, and VSR2's own contact and damping. A record is resampled in time, so that
every step sees the same motion, and all steps see the same starts. No record is chosen by what it
does at one of the steps: near the threshold responses are chaotic, and a record that is borderline
at one step is less so at all others. Compared with the least step are the margins, with the
standard error over records, and the largest tilt under 0.8 times the record of the margin at the
least step, where rocks stand at both: the median of the logarithm of the ratio.

Each scene and step is written to `--parts` when it is done; a run that was stopped goes on from
there. Writes `time_step.csv`, one row a scene and a step.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_equivalence import part, record, replicates, write_table
from quiet_stretches import SCENES, options_of, scene, settled
from vsr2.analysis.overturning_margin import seek_margins
from vsr2.motion import Motion, Record, build_recorded_motion
from vsr2.scene import Pose, Scene
from vsr2.simulation import run_batch
from vsr2.trial import Trial

Array = NDArray[np.float64]
STEPS = (0.00025, 0.0005, 0.001, 0.002, 0.004)
"""Time steps [s]; the others are compared with the first."""
ENDS = (math.log(0.2), math.log(3.0))
"""Of the logarithm of the factor on a record."""
HALVINGS = 8
"""So that a margin is good to 0.01."""
CALM = math.log(0.8)
"""Logarithm of the factor, over that of the margin, under which largest tilts are compared."""
MOVED = 0.01
"""Largest tilt from which a rock rocked [rad]."""


def at_step(given: Scene, time_step: float) -> Scene:
    """A scene at another time step."""
    engine = given.engine.model_copy(update={"time_step": time_step})
    return Scene(given.rock, given.pedestal, engine, given.contact)


@cache
def unscaled(seed: int, step: float) -> Motion:
    """A synthetic record, resampled in time."""
    motion = record(seed, 1.0)
    return build_recorded_motion(
        Record(motion.name, motion.time_step, displacement=motion.displacement), step
    )


def responses(
    given: Scene, base: Pose, factors: Array, step: float, threads: int
) -> tuple[NDArray[np.bool_], Array, float]:
    """Whether each replicate overturns, its largest tilt [rad], and CPU time of all [s].

    Args:
        given: at the time step.
        base: pose at rest.
        factors: on each record for each replicate, shape (records, replicates).
        step: time step [s].
        threads: of the batch.
    """
    trials: list[Trial] = []
    for seed, row in enumerate(factors):
        for k, factor in enumerate(row):
            motion = unscaled(seed, step).scaled(float(factor))
            trials += replicates(given, base, motion, 1, [13, seed, k])
    begun = time.process_time()
    result = run_batch(trials, threads=threads, keep_logs=False)
    cpu = time.process_time() - begun
    if not result.judged.all():
        raise SystemExit(f"{(~result.judged).sum()} trials failed at {step} s")
    shape = factors.shape
    return result.overturned.reshape(shape), result["peak_tilt"].reshape(shape), cpu


def margins(
    given: Scene, base: Pose, step: float, options: argparse.Namespace, calm: Array | None
) -> dict[str, Any]:
    """Margins of all replicates at a step, their CPU time, and largest tilts under calmer motions.

    Args:
        given: the scene, at any step.
        base: pose at rest.
        step: time step [s].
        options: sizes.
        calm: margins at the least step; None: this is it.
    """
    stepped = at_step(given, step)
    shape = (options.records, options.replicates)
    cpu = 0.0

    def overturns(logs: Array) -> Array:
        nonlocal cpu
        fell, _, spent = responses(stepped, base, np.exp(logs), step, options.threads)
        cpu += spent
        return fell.astype(float)

    found = seek_margins(overturns, shape, ENDS, HALVINGS)
    calmer = np.exp((found if calm is None else calm) + CALM)
    fell, tilt, _ = responses(stepped, base, calmer, step, options.threads)
    tilt = np.where(fell, 0.0, tilt)
    return {"margin": found.tolist(), "tilt": tilt.tolist(), "cpu_s": cpu}


def rows_of(name: str, found: list[dict[str, Any]]) -> list[dict[str, str]]:
    """One row a step."""
    margin = np.array([f["margin"] for f in found])
    tilt = np.array([f["tilt"] for f in found])
    cpu = [f["cpu_s"] for f in found]
    width = (ENDS[1] - ENDS[0]) / 2**HALVINGS
    sought = (margin > ENDS[0] + width) & (margin < ENDS[1] - width)
    rows = []
    for k, step in enumerate(STEPS):
        # Of each record the mean over the replicates whose margin lies within the ends at both.
        both = sought[k] & sought[0]
        change = np.where(both, margin[k] - margin[0], np.nan)
        by_record = np.nanmean(change[both.any(axis=1)], axis=1)
        rocked = np.minimum(tilt[k], tilt[0]) > MOVED
        ratio = np.log(tilt[k][rocked] / tilt[0][rocked])
        rows.append(
            {
                "scene": name,
                "time_step_ms": f"{1e3 * step:g}",
                "records": str(len(by_record)),
                "replicates": str(margin.shape[2]),
                "margin_change": f"{by_record.mean():+.4f}",
                "standard_error": f"{by_record.std(ddof=1) / math.sqrt(len(by_record)):.4f}",
                "margin_scatter": f"{np.nanstd(change):.4f}",
                "ln_tilt_median": f"{np.median(ratio):+.4f}",
                "ln_tilt_size": f"{np.median(np.abs(ratio)):.4f}",
                "cpu_over_1_ms": f"{cpu[k] / cpu[STEPS.index(0.001)]:.2f}",
            }
        )
    return rows


def main() -> None:
    """Run what parts are missing and write the table."""
    options = options_of(__doc__, "time_step", SCENES, records=150, replicates=2)
    rows: list[dict[str, str]] = []
    for name in options.scenes:
        folder = options.parts / f"{name}_{options.records}_{options.replicates}"
        folder.mkdir(parents=True, exist_ok=True)
        given = scene(name, "quiet")
        pose = part(folder / "start.json", partial(settled, given))
        base = Pose(tuple(pose["position"]), tuple(pose["orientation"]))
        found: list[dict[str, Any]] = []
        for step in STEPS:
            calm = np.array(found[0]["margin"]) if found else None
            make = partial(margins, given, base, step, options, calm)
            found.append(part(folder / f"step_{1e3 * step:g}.json", make))
        rows += rows_of(name, found)
        for row in rows[-len(STEPS) :]:
            print(*row.values(), flush=True)
    write_table(rows, options.out / "time_step.csv")


if __name__ == "__main__":
    main()
