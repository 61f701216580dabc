"""The nominal scene of blind packs in Bullet against MuJoCo: what a default of the contact does.

    python studies/nominal_scene.py [--motions 60] [--seed 32] [--threads N] [--out FILE]

One block of configs/blind.yaml without any effect is shaken by the independent simulation's own
motions, at 1.5, 2 and 2.5 times the acceleration of uplift, squarely and at 35 to 45 degrees. Every
row of the table is one set of contact values in Bullet; `original` is `preset: original`. Trials in
which no engine overturned and MuJoCo's largest tilt is above 0.01 rad are compared: the medians of
ln(Bullet's largest tilt / MuJoCo's) and of the same of the second excursion, and the mean turn
about the vertical at the end. Ranges are 95 %, by a bootstrap over the motions. A minute; the
committed table is docs/results/nominal_scene.csv.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_equivalence import ROOT, write_table
from vsr2.analysis.intervals import INTERVALS
from vsr2.blind.mujoco import Situation, TableMotion, block, ground_motion, run_trial
from vsr2.blind.mujoco.mujoco_trial import TRIAL
from vsr2.config import Study, load_study
from vsr2.config.study import BoxRock
from vsr2.ensemble.observed.features import TILT_FEATURES, tilt_features
from vsr2.motion import Record, build_recorded_motion
from vsr2.results import TrialLog
from vsr2.scene import build_scene
from vsr2.simulation import run_batch
from vsr2.trial import Trial

Array = NDArray[np.float64]
SECOND = [feature.name for feature in TILT_FEATURES].index("second_excursion")

STRENGTHS = (1.5, 2.0, 2.5)
"""Peak accelerations over that of uplift."""
VARIANTS: dict[str, tuple[str, ...]] = {
    "original": ("preset=original",),
    "velocity damping 0.04 1/s alone": (
        "engine.linear_damping=0.04",
        "engine.angular_damping=0.04",
    ),
    "spinning friction 0.9 m alone": (
        "contact.rock.spinning_friction=0.5",
        "contact.pedestal.spinning_friction=0.5",
    ),
    "physical": (),
    "physical, contact patch with a lever of 0.2 mm": (
        "contact.rock.spinning_friction=1.1e-4",
        "contact.pedestal.spinning_friction=1.1e-4",
    ),
    "physical, restitution 0": ("contact.rock.restitution=0.0",),
    "physical, rebounds at any speed": ("engine.restitution_velocity_threshold=0.0",),
    "physical, 2 ms": ("engine.time_step=0.002",),
    "physical, 2 ms in 2 substeps": ("engine.time_step=0.002", "engine.substeps=2"),
    "physical, 0.5 ms": ("engine.time_step=0.0005",),
}


def shaken(motions: int, squarely: bool, seed: int) -> list[tuple[TableMotion, float]]:
    """The table's motion and the block's yaw [rad] of every trial."""
    rng = np.random.default_rng(seed)
    rock = nominal().rock
    assert isinstance(rock, BoxRock)
    uplift = 9.81 * rock.size[0] / rock.size[2]
    trials = []
    for i in range(motions):
        ground = ground_motion(f"m{i}", rng)
        yaw = 0.0 if squarely else math.radians(rng.uniform(35.0, 45.0))
        for strength in STRENGTHS:
            moved = ground.displacement * uplift * strength
            trials.append((TableMotion(ground.interval, moved), yaw))
    return trials


def nominal(overrides: tuple[str, ...] = ()) -> Study:
    """configs/blind.yaml with some keys set."""
    return load_study(ROOT / "configs" / "blind.yaml", overrides=overrides)


def in_mujoco(trials: list[tuple[TableMotion, float]]) -> Array:
    """Outcome and tilts of each trial, shape (n, 4).

    Columns: overturned (0 or 1), largest tilt [rad], turn at the end [rad], logarithm of the second
    excursion's largest tilt [rad].
    """
    rock, contact = nominal().rock, nominal().contact
    assert isinstance(rock, BoxRock)
    body = block(*rock.size, rock.density or 0.0)
    friction = contact.rock.lateral_friction * contact.pedestal.lateral_friction
    rows = []
    for table, yaw in trials:
        end = run_trial(Situation(body, table, friction=friction, yaw=yaw))
        _, _, z, w = end.orientation[-1]
        second = tilt_features(end.time, end.tilt)[SECOND]
        rows.append((end.overturned, end.peak_tilt, 2 * math.atan2(z, w), second))
    return np.array(rows, dtype=np.float64)


def in_bullet(
    trials: list[tuple[TableMotion, float]], overrides: tuple[str, ...], threads: int
) -> Array:
    """As :func:`in_mujoco`."""
    batch = []
    for table, yaw in trials:
        study = nominal((f"rock.start.yaw={math.degrees(yaw)!r}", "output.log_every=1", *overrides))
        record = Record("m", table.interval, displacement=table.x)
        batch.append(
            Trial(
                scene=build_scene(study),
                motion=build_recorded_motion(record, study.engine.time_step),
                settling=study.settling,
                outcome=study.outcome,
                output=study.output,
            )
        )
    result = run_batch(batch, threads=threads)
    second = [sampled_tilt_features(log)[SECOND] for log in result.logs]
    return np.column_stack([result.overturned, result["peak_tilt"], result["final_yaw"], second])


def sampled_tilt_features(log: TrialLog | None) -> Array:
    """Features of a log sampled as MuJoCo's series are."""
    assert log is not None
    moves = log.time >= 0
    time = np.arange(0.0, log.time[-1], TRIAL.series_interval)
    return tilt_features(time, np.interp(time, log.time[moves], log.tilt[moves]))


def compared(bullet: Array, mujoco: Array, seed: int = 0) -> dict[str, str]:
    """A row of the table."""
    stood = (bullet[:, 0] == 0) & (mujoco[:, 0] == 0) & (mujoco[:, 1] > 0.01)
    tilt = median_and_ends(np.where(stood, np.log(bullet[:, 1] / mujoco[:, 1]), np.nan), seed)
    second = median_and_ends(np.where(stood, bullet[:, 3] - mujoco[:, 3], np.nan), seed)
    turn = np.degrees(np.abs(np.stack([bullet[stood, 2], mujoco[stood, 2]])).mean(axis=1))
    return {
        "trials": f"{len(bullet)}",
        "outcomes_that_differ": f"{np.mean(bullet[:, 0] != mujoco[:, 0]):.3f}",
        "compared": f"{stood.sum()}",
        **{f"ln_tilt_{name}": f"{value:+.4f}" for name, value in tilt.items()},
        **{f"ln_second_{name}": f"{value:+.4f}" for name, value in second.items()},
        "turn_bullet_deg": f"{turn[0]:.3f}",
        "turn_mujoco_deg": f"{turn[1]:.3f}",
    }


def median_and_ends(values: Array, seed: int) -> dict[str, float]:
    """The median over the trials that have a value, and its interval over motions."""
    motion = np.arange(len(values)) // len(STRENGTHS)
    known = np.isfinite(values)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(2000):
        counts = np.bincount(rng.choice(motion[-1] + 1, motion[-1] + 1), minlength=motion[-1] + 1)
        drawn.append(np.median(np.repeat(values[known], counts[motion[known]])))
    low, high = np.quantile(drawn, INTERVALS.ends)
    return {"median": float(np.median(values[known])), "low": float(low), "high": float(high)}


def main() -> None:
    """Run both directions and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=60)
    parser.add_argument("--seed", type=int, default=32)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "nominal_scene.csv")
    options = parser.parse_args()
    rows: list[dict[str, str]] = []
    for squarely in (True, False):
        trials = shaken(options.motions, squarely, options.seed)
        mujoco = in_mujoco(trials)
        for name, overrides in VARIANTS.items():
            bullet = in_bullet(trials, overrides, options.threads)
            row = {"shaken": "squarely" if squarely else "at 35 to 45 deg", "bullet": name}
            rows.append(row | compared(bullet, mujoco))
            print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    write_table(rows, options.out)


if __name__ == "__main__":
    main()
