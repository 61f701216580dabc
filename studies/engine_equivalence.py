"""Compare the engine `fast` with `exact`, and so with `parity`, on ensembles.

    python studies/engine_equivalence.py --scene pbr_scan [--threads N]
    VSR2_LAB_DATA=FOLDER python studies/engine_equivalence.py --scene SP1 [--threads N]
    python studies/engine_equivalence.py --scene block [--threads N]
    python studies/engine_equivalence.py --scene block --records 16 --sweeps 150 3000

A rocking response is chaotic near its threshold, so engines that do not share every bit are judged
on ensembles: the overturn probability and the distribution of the largest tilt over replicates
with perturbed starts, under borderline records.

Scenes: the embedded scan, which stands level on a flat base; the block of configs/blind.yaml with
its own contact, at 1 ms; and specimen SP1 of the laboratory campaign, which stands on few points
(its mesh is read from VSR2_LAB_DATA, else ../shared/lab beside the repository). `exact` settles the
rock once; every replicate of both engines starts from that pose, at rest, turned about the vertical
(standard deviation 0.5 degree), leaned about a random horizontal axis (1e-4 rad), moved (1 mm) and
lifted (up to 0.1 mm), and is shaken at once.
`fast` runs twice: from the starts of `exact` (paired: differences are of the engines alone, as far
as chaos does not part them) and from starts of its own (independent: a check of the first).

Records are synthetic (seeded) and scaled until about half of a separate set of `fast` replicates
overturn; those outside 0.15 to 0.85 are left out.

Every part (the replicates of one engine under one record) is written to `--parts` when it is
done; a run that was stopped goes on from there, and the table is made of the parts that exist.
Writes `engine_equivalence_SCENE.csv` (one row a record) and `.txt` (the verdicts, also printed):

- overturn probability: two one-sided tests at 5 % of the mean difference over records with a
  margin of 0.03, paired and independent; and the sum over records of the squared difference over
  its standard error, independent;
- largest tilt: two-sample Kolmogorov-Smirnov tests with Holm's correction over records, and their
  power against tilts that are 25 % greater below overturning;
- the greatest distance of the two engines' mass centres in the first 1000 steps of a record from
  the same start; and, beside it, of `exact` from itself when the start is moved by 1e-15 m or so
  (the greatest of eight moves): no engine that rounds otherwise can be nearer than that.

With `--sweeps` it runs `fast` alone, from the starts of `exact`, with contacts that are swept so
many times and with contacts that are solved at once, prints overturn probabilities and writes no
table.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import os
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2, ks_2samp, norm

from vsr2.config import load_study
from vsr2.config.study import (
    ORIGINAL,
    Contact,
    Engine,
    EngineMode,
    FixedStart,
    MeshRock,
    Outcome,
    Output,
    PrismPedestal,
    Settling,
)
from vsr2.motion import Motion, synthetic_motion
from vsr2.results.atomic import write_atomic
from vsr2.scene import Pose, Scene, build_pedestal, build_rock, build_scene
from vsr2.scene.rotation import matrix_from_quaternion, multiply, yaw_quaternion
from vsr2.simulation import run_batch
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent
ENGINES: tuple[EngineMode, ...] = ("exact", "fast")
RUNS = {"exact": ("exact", 0), "paired": ("fast", 0), "fast": ("fast", 1)}
"""Engine of each run, and the seed of its starts."""
MARGIN = 0.03
"""Greatest difference of overturn probabilities that counts as none."""
TURN = math.radians(0.5)
"""Standard deviation of the starts' turn about the vertical [rad]."""
LEAN = 1e-4
"""Standard deviation of the starts' turn about a horizontal axis [rad]."""
PLACE = 1e-3
"""Standard deviation of the starts' place, along x and y [m]."""
LIFT = 1e-4
"""Greatest lift of the starts [m]."""
NO_SETTLING = Settling(linear_speed=1e3, angular_speed=1e3, window=1e-3, timeout=1e-2)
"""The first step counts as rest."""
TAIL = 5.0
"""Time after the motion, far longer than a fall takes [s]."""


def rock_of(scene: str) -> MeshRock:
    """The rock of a scene: the embedded scan or SP1 with the original's start."""
    if scene == "pbr_scan":
        return MeshRock(shape="mesh", file=ROOT / "models" / "pbr_scan.obj", density=2650.0)
    lab = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))
    mesh = lab / "models" / "final_sp1_pca.obj"
    if not mesh.is_file():
        raise SystemExit(f"{mesh} does not exist; set VSR2_LAB_DATA to the laboratory data")
    orientation = (0.86766, 0.06594, 0.47910, 0.11521)
    start = FixedStart(mode="pose", position=(0.0, 0.0, 2.78), orientation=orientation)
    return MeshRock(shape="mesh", file=mesh, mass=353.8, start=start)


def scene_of(name: str, mode: str) -> Scene:
    """The rock on the default prism with the original's contact, for one engine."""
    if name == "block":
        study = load_study(ROOT / "configs" / "blind.yaml")
        # Every step is taken: quiet stretches are judged by themselves (quiet_stretches.py).
        own = {"mode": mode, "time_step": 1e-3, "skip": "none"}
        engine = study.engine.model_copy(update=own)
        return build_scene(study.model_copy(update={"engine": engine}))
    pedestal = build_pedestal(PrismPedestal())
    rock = build_rock(rock_of(name), pedestal, clearance=0.002)
    engine = Engine(mode=mode, **ORIGINAL["engine"])
    return Scene(rock, pedestal, engine, Contact(**ORIGINAL["contact"]))


def still(steps: int) -> Motion:
    """No motion."""
    rest = np.zeros(steps + 1)
    return Motion("still", 1e-3, rest, rest, rest, "recording")


def settled_pose(scene: Scene) -> Pose:
    """Where the model frame rests. SP1 rocks on by some 0.1 degree for a minute: near enough."""
    settling = Settling(linear_speed=0.02, angular_speed=0.05, window=0.25, timeout=60.0)
    trial = Trial(scene, still(2), settling=settling, outcome=Outcome(tail=1e-3))
    result = run_batch([trial], threads=1)
    log = result.logs[0]
    if log is None or not result.judged[0]:
        raise SystemExit(f"settling failed: {result['status'][0]} {result['message'][0]}")
    x, y, z, w = log.principal_axes.tolist()
    orientation = multiply(tuple(log.settled_orientation.tolist()), (-x, -y, -z, w))
    offset = matrix_from_quaternion(orientation) @ log.mass_center
    px, py, pz = (log.settled_position - offset).tolist()
    return Pose((px, py, pz), orientation)


def replicates(
    scene: Scene, base: Pose, motion: Motion, count: int, seed: Sequence[int]
) -> list[Trial]:
    """Trials with perturbed starts, drawn before dispatch."""
    random = np.random.default_rng(seed)
    trials = []
    for _ in range(count):
        turn, lean, x, y = random.normal(size=4) * (TURN, LEAN, PLACE, PLACE)
        lift, azimuth = random.uniform(size=2) * (LIFT, 2 * math.pi)
        half = 0.5 * lean
        tilt = (math.sin(half) * math.cos(azimuth), math.sin(half) * math.sin(azimuth), 0.0)
        orientation = multiply(
            multiply(yaw_quaternion(turn), (*tilt, math.cos(half))), base.orientation
        )
        # A lean turns the rock about its model frame's origin: at most some 0.1 mm into the top.
        px, py, pz = base.position
        pose = Pose((px + x, py + y, pz + lift), orientation)
        trials.append(
            Trial(
                scene,
                motion,
                start=pose,
                settling=NO_SETTLING,
                outcome=Outcome(tail=TAIL),
                output=Output(log_every=0),
            )
        )
    return trials


def responses(trials: list[Trial], threads: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Whether each trial overturned, and its largest tilt [rad]."""
    result = run_batch(trials, threads=threads, keep_logs=False)
    bad = ~result.judged
    if bad.any():
        raise SystemExit(f"{bad.sum()} trials failed: {result['status'][bad][0]}")
    return result.overturned, result["peak_tilt"]


def record(seed: int, factor: float) -> Motion:
    """A synthetic record, scaled."""
    random = np.random.default_rng([7, seed])
    pgv_pga_s = float(random.uniform(0.05, 0.12))
    name = f"synthetic_{seed:03d}"
    return synthetic_motion(0.5, pgv_pga_s, 4.0, seed, 1e-3, name=name).scaled(factor, name=name)


def borderline(scene: Scene, base: Pose, seed: int, threads: int | None) -> float | None:
    """The factor at which about half of a small ensemble overturns; None if there is none."""
    low, high = 0.2, 3.0
    for step in range(9):
        factor = math.sqrt(low * high)
        trials = replicates(scene, base, record(seed, factor), 24, [11, seed, step])
        fraction = responses(trials, threads)[0].mean()
        if 0.3 <= fraction <= 0.7:
            break
        low, high = (factor, high) if fraction < 0.5 else (low, factor)
    trials = replicates(scene, base, record(seed, factor), 100, [12, seed])
    fraction = responses(trials, threads)[0].mean()
    return factor if 0.15 <= fraction <= 0.85 else None


def first_steps(
    scenes: Mapping[EngineMode, Scene], base: Pose, motion: Motion
) -> tuple[float, float]:
    """Greatest distance of mass centres in the first 1000 steps [m]: engines, moved start."""
    short = Motion(
        "first",
        1e-3,
        motion.displacement[:1001],
        motion.velocity[:1001],
        motion.acceleration[:1001],
        "recording",
    )

    def path(scene: Scene, move: float = 0.0) -> np.ndarray:
        x, y, z = base.position
        start = Pose((x + move, y, z * (1 + move)), base.orientation)
        trial = Trial(scene, short, start=start, settling=NO_SETTLING, outcome=Outcome(tail=1e-3))
        log = run_batch([trial], threads=1).logs[0]
        assert log is not None
        return np.asarray(log.position[:1000])

    def apart(other: np.ndarray) -> float:
        return float(np.linalg.norm(other - exact, axis=1).max())

    exact = path(scenes["exact"])
    moves = (2e-16, 4e-16, 1e-15, 2e-15)
    moved = max(apart(path(scenes["exact"], sign * m)) for m in moves for sign in (1, -1))
    return apart(path(scenes["fast"])), moved


def part(path: Path, make: Any) -> dict[str, Any]:
    """What a part holds, made now unless an earlier run did."""
    if not path.exists():
        text = json.dumps(make(), allow_nan=False)
        write_atomic(path, lambda file: file.write(text.encode()))
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def row_of(
    motion: Motion, parts: dict[str, dict[str, Any]], steps: tuple[float, float]
) -> dict[str, str]:
    """One row of the table."""
    test = ks_2samp(parts["exact"]["tilt"], parts["fast"]["tilt"])
    flips = np.not_equal(parts["exact"]["overturned"], parts["paired"]["overturned"])
    row = {
        "record": motion.name,
        "pga_g": f"{motion.pga_g:.3f}",
        "pgv_pga_s": f"{motion.pgv_pga_s:.3f}",
        "replicates": str(len(parts["exact"]["tilt"])),
    }
    for run in RUNS:
        row[f"overturned_{run}"] = f"{np.mean(parts[run]['overturned']):.4f}"
    row["flipped"] = f"{np.mean(flips):.4f}"
    row["ks_statistic"] = f"{test.statistic:.4f}"
    row["ks_p"] = f"{test.pvalue:.4f}"
    row["first_1000_steps_m"] = f"{steps[0]:.1e}"
    row["exact_moved_m"] = f"{steps[1]:.1e}"
    return row


def verdicts(
    rows: list[dict[str, str]], tilts: list[np.ndarray], cpu: Mapping[EngineMode, float]
) -> str:
    """What the table shows."""
    n = int(rows[0]["replicates"])
    exact, paired, fast = (np.array([float(r[f"overturned_{e}"]) for r in rows]) for e in RUNS)
    flipped = np.array([float(r["flipped"]) for r in rows])
    # With one pseudo-count either way, so that a fraction of 0 has a spread.
    share = (n * 0.5 * (exact + fast) + 1) / (n + 2)
    variance = 2 * share * (1 - share) / n
    # Of a paired difference: McNemar's, with one pseudo-count.
    paired_variance = np.maximum(flipped + 1 / n - (paired - exact) ** 2, 1 / n) / n
    spread = float(np.sum((fast - exact) ** 2 / variance))
    p_values = np.sort([float(r["ks_p"]) for r in rows])
    holm = min(1.0, float((p_values * np.arange(len(p_values), 0, -1)).min()))
    # How often the test finds tilts that are 25 % greater below overturning.
    random = np.random.default_rng(14)
    hits = []
    for tilt in tilts:
        for _ in range(20):
            a, b = random.choice(tilt, n), random.choice(tilt, n)
            hits.append(ks_2samp(a, np.where(b < 1.0, 1.25 * b, b)).pvalue < 0.05)
    columns = ("first_1000_steps_m", "exact_moved_m")
    worst, moved = (max(float(row[column]) for row in rows) for column in columns)
    near = sum(float(r["first_1000_steps_m"]) < 1e-10 for r in rows)
    border = int(np.sum((exact >= 0.1) & (exact <= 0.9)))
    return "\n".join(
        (
            f"{len(rows)} records ({border} with 0.1 <= exact <= 0.9), {n} replicates an engine",
            f"same starts: {flipped.mean():.4f} of the outcomes differ; "
            + equivalence(exact, paired, paired_variance),
            "independent starts: " + equivalence(exact, fast, variance),
            f"by record: sum of squared standardised differences {spread:.1f} "
            f"(p = {chi2.sf(spread, len(rows)):.2f}); greatest difference "
            f"{np.abs(fast - exact).max():.3f}",
            f"largest tilt: smallest p after Holm {holm:.3f} "
            f"({'no difference' if holm >= 0.05 else 'DIFFERENT'} at 5 %); power against 25 % "
            f"greater tilts {np.mean(hits):.2f} a record",
            f"first 1000 steps: at most {worst:.1e} m apart, below 1e-10 m in {near} records; "
            f"exact from itself with a start moved by some 1e-15 m: at most {moved:.1e} m",
            f"CPU time: exact {cpu['exact']:.0f} s, fast {cpu['fast']:.0f} s "
            f"({platform.processor() or platform.machine()})",
        )
    )


def equivalence(exact: np.ndarray, fast: np.ndarray, variance: np.ndarray) -> str:
    """Two one-sided tests of the mean difference of overturn probabilities."""
    difference = float(np.mean(fast - exact))
    error = math.sqrt(np.sum(variance)) / len(exact)
    p = max(norm.sf((difference + MARGIN) / error), norm.cdf((difference - MARGIN) / error))
    return (
        f"overturned exact {exact.mean():.4f}, fast {fast.mean():.4f}; difference "
        f"{difference:+.4f}, standard error {error:.4f}; equal within {MARGIN}: p = {p:.2g} "
        f"({'shown' if p < 0.05 else 'NOT shown'} at 5 %)"
    )


def borderline_records(
    scene: Scene, base: Pose, parts: Path, options: argparse.Namespace
) -> Iterator[tuple[int, Motion]]:
    """Seeds and records, searched now unless an earlier run did."""
    found = 0
    for seed in range(10 * options.records):
        factor = part(
            parts / f"factor_{seed:03d}.json",
            lambda seed=seed: {"factor": borderline(scene, base, seed, options.threads)},
        )["factor"]
        if factor is not None:
            yield seed, record(seed, factor)
            found += 1
        if found == options.records:
            return


def ensemble(
    scene: Scene, base: Pose, motion: Motion, seed: list[int], options: argparse.Namespace
) -> dict[str, Any]:
    """Replicates of one engine under one record."""
    begun = time.process_time()
    trials = replicates(scene, base, motion, options.replicates, seed)
    fell, tilt = responses(trials, options.threads)
    used = time.process_time() - begun
    return {"overturned": fell.tolist(), "tilt": tilt.tolist(), "cpu_s": used}


def by_solver(scene: Scene, base: Pose, parts: Path, options: argparse.Namespace) -> str:
    """Overturn probabilities of `fast` from the same starts, by how contacts are solved."""
    solvers = {
        f"swept_{count}": {"converged_contacts": False, "solver_iterations": count}
        for count in options.sweeps
    } | {"at_once": {"converged_contacts": True}}
    fell: dict[str, list[float]] = {name: [] for name in solvers}
    for seed, motion in borderline_records(scene, base, parts, options):
        for name, settings in solvers.items():
            solved = replace(scene, engine=scene.engine.model_copy(update=settings))
            found = part(
                parts / f"{name}_{seed:03d}.json",
                lambda solved=solved, motion=motion, seed=seed: ensemble(
                    solved, base, motion, [13, seed, 0], options
                ),
            )
            fell[name].append(float(np.mean(found["overturned"])))
    return "\n".join(
        f"{name}: overturned {np.mean(shares):.4f} over {len(shares)} records"
        for name, shares in fell.items()
    )


def main() -> None:
    """Run what parts are missing, write the table, print the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", choices=("pbr_scan", "SP1", "block"), default="pbr_scan")
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--replicates", type=int, default=300)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--sweeps", type=int, nargs="+")
    parser.add_argument("--parts", type=Path, default=ROOT / "out" / "engine_equivalence")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results")
    options = parser.parse_args()
    parts = options.parts / f"{options.scene}_{options.replicates}"
    parts.mkdir(parents=True, exist_ok=True)
    scenes = {mode: scene_of(options.scene, mode) for mode in ENGINES}
    found = part(parts / "start.json", lambda: vars_of(settled_pose(scenes["exact"])))
    base = Pose(tuple(found["position"]), tuple(found["orientation"]))
    if options.sweeps:
        print(by_solver(scenes["fast"], base, parts, options))
        return
    rows: list[dict[str, str]] = []
    tilts = []
    cpu = dict.fromkeys(ENGINES, 0.0)
    for seed, motion in borderline_records(scenes["fast"], base, parts, options):
        results = {
            name: part(
                parts / f"{name}_{seed:03d}.json",
                lambda engine=engine, motion=motion, which=which, seed=seed: ensemble(
                    scenes[engine], base, motion, [13, seed, which], options
                ),
            )
            for name, (engine, which) in RUNS.items()
        }
        steps = first_steps(scenes, base, motion)
        rows.append(row_of(motion, results, steps))
        tilts.append(np.array(results["exact"]["tilt"]))
        for engine in ENGINES:
            cpu[engine] += results[engine]["cpu_s"]
        print(*rows[-1].values(), flush=True)
    text = verdicts(rows, tilts, cpu)
    print(text)
    name = f"engine_equivalence_{options.scene}"
    write_table(rows, options.out / f"{name}.csv")
    command = f"python studies/engine_equivalence.py --scene {options.scene}"
    write_atomic(options.out / f"{name}.txt", lambda f: f.write(f"{command}\n{text}\n".encode()))


def write_table(rows: Sequence[dict[str, str]], path: Path) -> None:
    """Rows of equal keys as CSV, in a folder that is made where it is missing."""
    table = io.StringIO()
    writer = csv.DictWriter(table, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, lambda file: file.write(table.getvalue().encode()))


def vars_of(pose: Pose) -> dict[str, list[float]]:
    """A pose as JSON holds it."""
    return {"position": list(pose.position), "orientation": list(pose.orientation)}


if __name__ == "__main__":
    main()
