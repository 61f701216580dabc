"""Compare the engine `fast` with `exact`, and so with `parity`, on ensembles.

Run as:

    python studies/engine_equivalence.py [--records 20] [--replicates 300] [--out FOLDER]

A rocking response is chaotic near its threshold, so engines that do not share every bit are judged
on ensembles: the overturn probability over replicates with perturbed starts (turn about the
vertical, place on the pedestal) under borderline records, and the distribution of the largest tilt.

Records are synthetic (seeded) and scaled until about half of a separate set of `fast` replicates
overturn; those outside 0.1 to 0.9 are left out. Replicates of the two engines have different seeds.

Writes `engine_equivalence.csv` (one row a record) and prints the verdicts: equivalence of the
overturn probability by two one-sided tests at 5 % with margin 0.03, and two-sample
Kolmogorov-Smirnov tests of the largest tilt with Holm's correction over records. The power of the
latter is stated for tilts 25 % greater.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp, norm

from vsr2.config.study import Contact, Engine, MeshRock, Outcome, Output, PrismPedestal
from vsr2.motion import Motion, synthetic_motion
from vsr2.scene import Pose, build_pedestal, build_rock
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation import Scene, Trial, make_scene, run_batch

ROOT = Path(__file__).resolve().parent.parent
MARGIN = 0.03
"""Greatest difference of overturn probabilities that counts as none."""
TURN = math.radians(0.5)
"""Standard deviation of the starts' turn about the vertical [rad]."""
PLACE = 1e-3
"""Standard deviation of the starts' place, along x and y [m]."""


def scene_of(mode: str) -> Scene:
    """The embedded scanned rock on the default prism."""
    pedestal = build_pedestal(PrismPedestal())
    config = MeshRock(shape="mesh", file=ROOT / "models" / "pbr_scan.obj", density=2650.0)
    rock = build_rock(config, pedestal, clearance=0.002)
    return make_scene(rock, pedestal, Engine(mode=mode), Contact())


def replicates(scene: Scene, motion: Motion, count: int, seed: Sequence[int]) -> list[Trial]:
    """Trials with perturbed starts, drawn before dispatch."""
    random = np.random.default_rng(seed)
    trials = []
    for _ in range(count):
        turn, x, y = random.normal(size=3) * (TURN, PLACE, PLACE)
        start = scene.rock.start
        position = (start.position[0] + x, start.position[1] + y, start.position[2])
        pose = Pose(position, multiply(yaw_quaternion(turn), start.orientation))
        trials.append(
            Trial(scene, motion, start=pose, outcome=Outcome(), output=Output(log_every=0))
        )
    return trials


def overturned(trials: list[Trial], threads: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Whether each trial overturned, and its largest tilt [rad]."""
    result = run_batch(trials, threads=threads, keep_logs=False)
    bad = ~np.isin(result["status"], ("ok", "tail_timeout"))
    if bad.any():
        raise SystemExit(f"{bad.sum()} trials failed: {result['message'][bad][0]}")
    return result["outcome"] == "overturned", result["peak_tilt"]


def borderline(scene: Scene, seed: int, threads: int | None) -> Motion | None:
    """A synthetic record scaled to overturn about half of a small ensemble; None if none does."""
    random = np.random.default_rng([7, seed])
    pgv_pga = float(random.uniform(0.05, 0.12))
    record = synthetic_motion(0.5, pgv_pga, 4.0, seed, 1e-3, name=f"synthetic_{seed:03d}")
    low, high = 0.3, 3.0
    for step in range(9):
        middle = math.sqrt(low * high)
        motion = record.scaled(middle, name=record.name)
        fraction = overturned(replicates(scene, motion, 24, [11, seed, step]), threads)[0].mean()
        if 0.3 <= fraction <= 0.7:
            break
        low, high = (middle, high) if fraction < 0.5 else (low, middle)
    fraction = overturned(replicates(scene, motion, 100, [12, seed]), threads)[0].mean()
    return motion if 0.1 <= fraction <= 0.9 else None


def main() -> None:
    """Run the study, write its table, print the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--replicates", type=int, default=300)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results")
    options = parser.parse_args()
    begun = time.time()
    scenes = {mode: scene_of(mode) for mode in ("exact", "fast")}
    motions: list[Motion] = []
    for seed in range(20 * options.records):
        motion = borderline(scenes["fast"], seed, options.threads)
        if motion is not None:
            motions.append(motion)
        if len(motions) == options.records:
            break
    rows = []
    tilts = {}
    for k, motion in enumerate(motions):
        found = {}
        for engine, scene in scenes.items():
            seed = [13, k, engine == "fast"]
            found[engine] = overturned(
                replicates(scene, motion, options.replicates, seed), options.threads
            )
        tilts[k] = (found["exact"][1], found["fast"][1])
        test = ks_2samp(*tilts[k])
        p = {engine: float(fell.mean()) for engine, (fell, _) in found.items()}
        rows.append(
            {
                "record": motion.name,
                "pga_g": f"{motion.pga / 9.80665:.3f}",
                "pgv_pga_s": f"{motion.pgv_pga:.3f}",
                "replicates": options.replicates,
                "overturned_exact": f"{p['exact']:.4f}",
                "overturned_fast": f"{p['fast']:.4f}",
                "ks_statistic": f"{test.statistic:.4f}",
                "ks_p": f"{test.pvalue:.4f}",
            }
        )
        print(*rows[-1].values(), flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    with open(options.out / "engine_equivalence.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)

    n = options.replicates
    exact, fast = (np.array([float(r[f"overturned_{e}"]) for r in rows]) for e in scenes)
    difference = float(np.mean(fast - exact))
    error = math.sqrt(np.sum((exact * (1 - exact) + fast * (1 - fast)) / n)) / len(rows)
    p_equal = max(norm.sf((difference + MARGIN) / error), norm.cdf((difference - MARGIN) / error))
    spread = float(np.sum((fast - exact) ** 2 / ((exact * (1 - exact) + fast * (1 - fast)) / n)))
    p_values = np.sort([float(r["ks_p"]) for r in rows])
    holm = p_values * np.arange(len(p_values), 0, -1)
    # Power: how often the test finds tilts that are 25 % greater below overturning.
    hits = []
    random = np.random.default_rng(14)
    for tilt, _ in tilts.values():
        for _ in range(20):
            a, b = random.choice(tilt, n), random.choice(tilt, n)
            b = np.where(b < 1.0, 1.25 * b, b)
            hits.append(ks_2samp(a, b).pvalue < 0.05)
    print(f"{len(rows)} records, {n} replicates an engine, {time.time() - begun:.0f} s")
    print(f"overturn probability: exact {exact.mean():.4f}, fast {fast.mean():.4f}")
    print(
        f"difference {difference:+.4f}, standard error {error:.4f}; equivalence within "
        f"{MARGIN}: p = {p_equal:.2g} ({'shown' if p_equal < 0.05 else 'NOT shown'} at 5 %)"
    )
    print(f"sum of squared standardised differences {spread:.1f} over {len(rows)} records")
    print(
        f"largest tilt: smallest p after Holm {min(1.0, holm.min()):.3f} "
        f"({'no difference' if holm.min() >= 0.05 else 'DIFFERENT'} at 5 %); power against 25 % "
        f"greater tilts {np.mean(hits):.2f} a record"
    )


if __name__ == "__main__":
    main()
