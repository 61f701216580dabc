"""How cost and memory grow: with trials, time steps, hull vertices, worlds and streamed batches.

    python benchmarks/scaling.py [--trials N] [--logged N] [--engine MODE] [--out CSV]
    python benchmarks/scaling.py --only hull_vertices    # the other rows stay as they are

Cost is CPU time of one thread, the median of interleaved rounds. Memory is resident memory of a
process of its own for each figure. The committed table is docs/results/scaling.csv.

- `trials`: batches of equal short trials; `steps`: one trial with longer and longer records;
- `hull_vertices`: a time step of a standing rock with more and more vertices, for each engine and
  shape: a cylinder on its level ring of half the vertices, a ball with a flattened base, a ball on
  three feet. `fast, swept` does not solve contacts that stick at once;
- `world_memory`: growth per world while many are alive that share one scene;
- `streamed`: peak of a process that runs N very short trials into a folder, with and without logs.

Every trial takes all its steps (`engine.skip: none`): quiet stretches would pass over a rock that
rests.

The exponent is the slope of log(cost) against log(size) over the larger half of the sizes: 1 where
cost grows in proportion.
"""

from __future__ import annotations

import argparse
import csv
import gc
import itertools
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import Contact, Engine, MeshRock, Outcome, PrismPedestal, Study
from vsr2.motion import Motion
from vsr2.results import prepare_folder, save_result
from vsr2.scene import Pose, Scene, build_pedestal, build_rock
from vsr2.simulation import Simulation, native_scene, run_batch, study_trials
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent
ENGINES = ("parity", "exact", "fast")
SWEPT = "fast, swept"
VERTICES = (8, 100, 550, 2000)
"""Asked for; Bullet's hull of many has fewer."""
ROUNDS = 3
Array = NDArray[np.float64]
Add = Callable[..., None]


def short_trial(engine: str, log_every: int = 0) -> Trial:
    """A block under a pulse of 64 ms, with as little settling and tail as can be."""
    study = Study.model_validate(
        {
            "engine": {"mode": engine, "skip": "none"},
            "rock": {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0},
            "settling": {"window": 0.01},
            "outcome": {"rest_window": 0.01, "tail": 1.0},
            "motion": {"mode": "single_cosine", "pga_g": 0.2, "pgv_pga_s": 0.01},
            "output": {"log_every": log_every},
        }
    )
    return study_trials(study)[0]


def many(trial: Trial, count: int) -> list[Trial]:
    """So many trials with eight motions among them."""
    motions = [trial.motion.scaled(1 + 0.1 * k, name=f"pulse {k}") for k in range(8)]
    return [replace(trial, motion=motions[i % 8], seed=i, name=f"trial {i}") for i in range(count)]


def cpu(trials: list[Trial]) -> float:
    """CPU time of a batch on one thread [s]."""
    gc.collect()
    start = time.process_time()
    result = run_batch(trials, threads=1, keep_logs=False)
    used = time.process_time() - start
    assert result.judged.all(), result["status"]
    return used


def shaken(trial: Trial, steps: int) -> Trial:
    """The trial under a weak hum of so many steps, without a tail."""
    t = np.arange(steps + 1) * 1e-3
    w = 2 * np.pi * 3.0
    x, v, a = 2e-3 * (1 - np.cos(w * t)), 2e-3 * w * np.sin(w * t), 2e-3 * w**2 * np.cos(w * t)
    motion = Motion("hum", 1e-3, x, v, a, "recording")
    return replace(trial, motion=motion, outcome=Outcome(tail=1e-3))


def cylinder(vertices: int) -> Array:
    """Points of a cylinder: its base is a level ring of half of them, shape (vertices, 3) [m]."""
    around = np.arange(vertices // 2) * (4 * np.pi / vertices)
    ring = np.stack([0.4 * np.cos(around), 0.4 * np.sin(around)], axis=1)
    return np.concatenate([np.insert(ring, 2, z, axis=1) for z in (0.0, 0.9)])


def ball(vertices: int) -> Array:
    """Points spread evenly over a ball, on a spiral, shape (vertices, 3) [m]."""
    place = np.arange(vertices) + 0.5
    z = 1 - 2 * place / vertices
    turn = place * np.pi * (1 + np.sqrt(5))
    across = np.sqrt(1 - z * z)
    return 0.5 * np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def flattened_ball(vertices: int) -> Array:
    """The ball with its lowest tenth pressed into a level base."""
    points = ball(vertices)
    points[:, 2] = np.maximum(points[:, 2], -0.4)
    return points


def ball_on_feet(vertices: int) -> Array:
    """The ball on three points."""
    around = np.arange(3) * (2 * np.pi / 3)
    feet = np.stack([0.3 * np.cos(around), 0.3 * np.sin(around), np.full(3, -0.55)], axis=1)
    return np.concatenate([ball(vertices - 3), feet])


SHAPES = {
    "level ring": cylinder,
    "flattened ball": flattened_ball,
    "ball on three feet": ball_on_feet,
}


def standing(points: Array, engine: str) -> Scene:
    """The hull of the points as a rock on the pedestal, as a mesh file gives it."""
    import trimesh

    pedestal = build_pedestal(PrismPedestal())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hull.obj"
        trimesh.convex.convex_hull(points).export(file)
        rock = build_rock(MeshRock(shape="mesh", file=file, mass=600.0), pedestal, clearance=0.002)
    how = Engine(mode=engine.split(",")[0], skip="none", converged_contacts=engine != SWEPT)
    return Scene(rock, pedestal, how, Contact())


def medians(measure: Callable[[int], float], sizes: Iterable[int]) -> dict[int, float]:
    """Median cost by size, the sizes interleaved."""
    found: dict[int, list[float]] = {size: [] for size in sizes}
    for _ in range(ROUNDS):
        for size, costs in found.items():
            costs.append(measure(size))
    return {size: statistics.median(values) for size, values in found.items()}


def hull_costs(trial: Trial, shape: str, engine: str) -> dict[int, float]:
    """CPU time of a step [us] by the vertices that Bullet's hull has."""
    still: dict[int, Trial] = {}
    for vertices in VERTICES:
        scene = standing(SHAPES[shape](vertices), engine)
        still[len(native_scene(scene).rock_hull_vertices)] = replace(trial, scene=scene)

    def longer(size: int) -> float:
        return cpu([shaken(still[size], 11_000)]) - cpu([shaken(still[size], 1000)])

    longer(min(still))  # what is imported late is imported here
    return {size: value / 10_000 * 1e6 for size, value in medians(longer, still).items()}


def exponent(costs: dict[int, float]) -> float:
    """Slope of log cost against log size over the larger half of the sizes."""
    sizes = sorted(costs)[len(costs) // 2 - 1 :]
    return float(np.polyfit(np.log(sizes), np.log([costs[size] for size in sizes]), 1)[0])


def resident(field: str) -> float:
    """`VmRSS` or `VmHWM` (its peak) of this process [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field):
            return int(line.split()[1]) * 1024 / 1e6
    raise RuntimeError(f"no {field} in /proc/self/status")


def world_memory(engine: str, count: int) -> float:
    """Resident memory of one of many live worlds with a scanned rock in contact [MB]."""
    pedestal = build_pedestal(PrismPedestal())
    file = ROOT / "models" / "pbr_scan.obj"
    rock = build_rock(MeshRock(shape="mesh", file=file, mass=446.6), pedestal, clearance=0.002)
    scene = Scene(rock, pedestal, Engine(mode=engine), Contact())
    worlds = [Simulation(scene) for _ in range(20)]
    worlds[0].step(0.0, steps=300)
    before = resident("VmRSS")
    worlds = worlds + [Simulation(scene) for _ in range(count)]
    for world in worlds[-count:]:
        world.step(0.0, steps=300)
        assert len(world.contacts()) > 0
    return (resident("VmRSS") - before) / count


def streamed(engine: str, count: int, log_every: int) -> tuple[float, float, float]:
    """Peak memory [MB], wall time [s] and size on disk [MB] of a batch into a folder."""
    trial = short_trial(engine, log_every)
    trials = many(trial, count)
    with tempfile.TemporaryDirectory() as name:
        folder = prepare_folder(name)
        start = time.perf_counter()
        result = run_batch(trials, checkpoint=folder, keep_logs=False)
        save_result(result, folder, streamed_logs=True)
        wall = time.perf_counter() - start
        assert set(result["status"]) == {"ok"}
        size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return resident("VmHWM"), wall, size / 1e6


def in_a_process(*arguments: object) -> list[float]:
    """The figures that a child of this script prints."""
    command = [sys.executable, __file__, "--child", *map(str, arguments)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return [float(value) for value in done.stdout.split()]


def child(name: str, engine: str, *numbers: str) -> None:
    """Measure one memory figure in this process and print it."""
    if name == "world_memory":
        print(world_memory(engine, *map(int, numbers)))
    else:
        print(*streamed(engine, *map(int, numbers)))


def measure_trials(options: argparse.Namespace, add: Add) -> None:
    """Batches of equal short trials."""
    mode, short = options.engine, short_trial(options.engine)
    costs = medians(lambda n: cpu(many(short, n)), (250, 500, 1000, 2000, 4000))
    for size, value in costs.items():
        add("trials", mode, size, value, "CPU s")
    add("trials", mode, 0, exponent(costs), "exponent")


def measure_steps(options: argparse.Namespace, add: Add) -> None:
    """One trial with longer and longer records."""
    mode = options.engine
    pose = Pose((0.0, 0.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    rock = replace(short_trial(mode), start=pose)
    costs = medians(lambda n: cpu([shaken(rock, n)]), (10_000, 20_000, 40_000, 80_000))
    for size, value in costs.items():
        add("steps", mode, size, value, "CPU s")
    add("steps", mode, 0, exponent(costs), "exponent")


def measure_hulls(options: argparse.Namespace, add: Add) -> None:
    """A time step of a standing rock with more and more vertices."""
    short = short_trial(options.engine)
    for shape, engine in itertools.product(SHAPES, (*ENGINES, SWEPT)):
        for size, value in hull_costs(short, shape, engine).items():
            add("hull_vertices", engine, size, value, "CPU us a step", shape)


def measure_worlds(options: argparse.Namespace, add: Add) -> None:
    """Growth of memory a world."""
    for engine in ENGINES:
        [memory] = in_a_process("world_memory", engine, options.worlds)
        add("world_memory", engine, options.worlds, memory, "MB a world")


def measure_streams(options: argparse.Namespace, add: Add) -> None:
    """Batches into a folder, with and without logs."""
    for log_every, count in ((0, options.trials), (20, options.logged)):
        what = "streamed+logs" if log_every else "streamed"
        peak, wall, disk = in_a_process("streamed", options.engine, count, log_every)
        add(what, options.engine, count, peak, "MB peak resident")
        add(what, options.engine, count, wall, "wall s")
        add(what, options.engine, count, disk, "MB on disk")


PARTS: dict[str, Callable[[argparse.Namespace, Add], None]] = {
    "trials": measure_trials,
    "steps": measure_steps,
    "hull_vertices": measure_hulls,
    "world_memory": measure_worlds,
    "streamed": measure_streams,
}
WHAT = tuple(PARTS)
"""In the order of the table."""


def main() -> None:
    """Measure all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100_000, help="of the streamed batch")
    parser.add_argument("--logged", type=int, default=100_000, help="of the one with logs")
    parser.add_argument("--worlds", type=int, default=200)
    parser.add_argument("--engine", default="fast", help="of trials, steps and streamed")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "scaling.csv")
    parser.add_argument("--only", choices=WHAT, help="measure this part alone")
    parser.add_argument("--child", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(*options.child)
        return
    rows: list[list[object]] = []
    if options.only and options.out.exists():
        with options.out.open(newline="") as file:
            kept = list(csv.reader(file))[1:]
        rows += [list(row) for row in kept if not row[0].startswith(options.only)]

    def add(what: str, engine: str, size: int, value: float, unit: str, shape: str = "") -> None:
        rows.append([what, engine, shape, size, f"{value:.4g}", unit])
        print(f"{what:14} {engine:11} {shape:18} {size:7} {value:10.4g} {unit}", flush=True)

    for what in (options.only,) if options.only else WHAT:
        PARTS[what](options, add)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("w", newline="") as file:
        csv.writer(file).writerows([["what", "engine", "shape", "size", "value", "unit"], *rows])
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
