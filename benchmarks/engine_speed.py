"""Microseconds a step of every engine, of PyBullet and of MuJoCo, interleaved in one run.

    pip install '.[benchmark]'
    python benchmarks/engine_speed.py [--mesh MESH --mass KG] [--orientation X Y Z W]
                                      [--strength S] [--rounds N] [--steps N] [--out CSV]

All shake the same rock, from where it rests, by the same record on the same table. The record is
embedded (configs/motions/synthetic_07.csv), here `--strength` times as strong. Like is compared
with like: under the drive `motor` Bullet's joint motor moves the table, in PyBullet as in our
engines; under `prescribed` the table goes from sample to sample and nothing slows it. MuJoCo has
the prescribed table alone, as an inertial force on the rock (mujoco_rock.py). In this very run
every rock must follow a table that moves too gently for sliding or rocking, and must come through
the record without overturning.

CPU time of the stepping alone, one round of each engine after the other, so that a change of the
machine's speed meets all of them; the table gives medians, the spread, the largest tilt of each
rock, and ratios to PyBullet under the same drive and to MuJoCo, which are medians of the rounds'
ratios. PyBullet is stepped from Python without reading the state, MuJoCo by `mujoco.rollout`, our
engines inside the core as a batch of one trial does. Where one of the two is not installed the
table goes without it.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import math
import statistics
import time
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import (
    ORIGINAL,
    Engine,
    FixedStart,
    MeshRock,
    Outcome,
    Output,
    PrismPedestal,
    Settling,
    YawStart,
)
from vsr2.config.study import Contact as ContactConfig
from vsr2.motion import Motion, build_recorded_motion, cosine_motion, read_record
from vsr2.results import base_provenance
from vsr2.scene import Scene, build_pedestal, build_rock
from vsr2.scene.rotation import matrix_from_quaternion, multiply
from vsr2.simulation import Simulation, native_scene, run_batch
from vsr2.trial import Trial

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parent.parent
STEP = 1e-3
"""[s]."""
SETTLING = Settling(linear_speed=0.05, angular_speed=0.2)
"""A rock that still trembles on its points counts as settled, so that the wait is short."""
GENTLE = cosine_motion(0.03, 0.4, STEP)
"""A table that goes 60 mm to and fro at 0.02 g at most: no rock slides on it or lifts off."""
CARRIED = 0.02
"""Greatest distance between a rock that is carried and its table, over the table's way.

Contacts of MuJoCo give way by some 0.1 mm; of a rock that is not shaken it is 1.
"""


class Shaken(Protocol):
    """One engine with the rock on its table."""

    def seconds(self, motion: Motion) -> float:
        """CPU time of a step [s]."""
        ...

    def follow(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Displacement of table and rock [m] and the rock's tilt [rad] after every step."""
        ...


class NativeRock:
    """The rock in an engine of our own.

    Args:
        scene: with the engine's name.
        drive: motor or prescribed.
    """

    def __init__(self, scene: Scene, drive: str) -> None:
        native_scene(scene)  # built here, not where it is timed
        self._scene, self._drive = scene, drive

    def seconds(self, motion: Motion) -> float:
        """CPU time of a step: that of a trial less that of its settling, over the steps [s].

        Raises:
            SystemExit: the trial failed or the rock overturned, which ends it early.
        """
        trial = Trial(
            scene=self._scene,
            motion=motion,
            drive=self._drive,  # type: ignore[arg-type]
            settling=SETTLING,
            outcome=Outcome(tail=STEP),
            output=Output(log_every=0),
        )
        names = ("displacement", "velocity", "acceleration")
        short = replace(motion, **{name: getattr(motion, name)[:2] for name in names})
        (shaken, steps), (still, none) = map(_timed, (trial, replace(trial, motion=short)))
        return (shaken - still) / (steps - none)

    def follow(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Where table and rock go in the world, and how far the rock tilts.

        Returns:
            Displacement of table [m] and mass centre [m] along x, tilt away from the start [rad],
            after every step, each of shape (samples - 1,).
        """
        drive = {"motor": "motor_position"}.get(self._drive, self._drive)
        with Simulation(self._scene, drive=drive) as simulation:
            simulation.settle(SETTLING)
            start = simulation.state
            assert start is not None
            place = start.position[0]
            x, y, z, w = start.body_orientation
            rows = []
            for goal in motion.displacement[1:].tolist():
                state = simulation.step(goal)
                assert state is not None
                turned = multiply(tuple(state.body_orientation), (-x, -y, -z, w))
                cosine = 1 - 2 * (turned[0] ** 2 + turned[1] ** 2)
                tilt = math.acos(min(cosine, 1.0))
                rows.append((state.pedestal_position, state.position[0] - place, tilt))
        table, rock, tilts = np.array(rows).T
        return table, rock, tilts


def _timed(trial: Trial) -> tuple[float, int]:
    """CPU time of a trial [s] and its steps."""
    start = time.process_time()
    result = run_batch([trial], threads=1)
    used = time.process_time() - start
    if not result.judged[0] or result.overturned[0]:
        ended = f"{result['status'][0]}, {result['outcome'][0]}"
        raise SystemExit(f"a trial ended as {ended}; take another --strength")
    return used, int(result["steps"][0])


SWEPT = "fast, swept"
"""`fast` that sweeps every step as often as Bullet does."""


def scene_of(rock: MeshRock, mode: str) -> Scene:
    """The rock on the default prism, for one engine, with the values that PyBullet has."""
    pedestal = build_pedestal(PrismPedestal())
    body = build_rock(rock, pedestal, clearance=0.002)
    original = ContactConfig(**ORIGINAL["contact"])
    values = {**ORIGINAL["engine"], "converged_contacts": mode != SWEPT}
    return Scene(body, pedestal, Engine(mode=mode.split(",")[0], **values), original)


def settled(rock: MeshRock) -> MeshRock:
    """The rock with the pose as its start in which it comes to rest in `exact`."""
    scene = scene_of(rock, "exact")
    with Simulation(scene) as simulation:
        simulation.settle()
        state = simulation.state
    x, y, z, w = scene.body_frame.orientation
    orientation = multiply(tuple(state.body_orientation), (-x, -y, -z, w))
    turned = matrix_from_quaternion(orientation) @ scene.body_frame.position
    position = tuple((state.position - turned).tolist())
    start = FixedStart(mode="pose", position=position, orientation=orientation)
    return rock.model_copy(update={"start": start})


def record(steps: int, strength: float = 0.6) -> Motion:
    """The embedded record, repeated or cut to `steps` time steps."""
    motion = build_recorded_motion(read_record(ROOT / "configs/motions/synthetic_07.csv"), STEP)
    repeats = -(-steps // (motion.displacement.size - 1))

    def tiled(part: Array) -> Array:
        part = strength * part
        return np.concatenate([part[:1], *[part[1:]] * repeats])[: steps + 1]

    return Motion(
        "bench",
        STEP,
        tiled(motion.displacement),
        tiled(motion.velocity),
        tiled(motion.acceleration),
        "recording",
    )


def engines(rock: MeshRock) -> dict[tuple[str, str], Shaken]:
    """All that are installed, by name and drive."""
    found: dict[tuple[str, str], Shaken] = {}
    for drive in ("motor", "prescribed"):
        if importlib.util.find_spec("pybullet"):
            from pybullet_rock import PyBulletRock

            found["PyBullet", drive] = PyBulletRock(scene_of(rock, "parity"), rock.file, drive)
        if drive == "prescribed" and importlib.util.find_spec("mujoco"):
            from mujoco_rock import MujocoRock

            found["MuJoCo", drive] = MujocoRock(scene_of(rock, "parity"))
        for mode in ("parity", "exact", SWEPT, "fast"):
            found[mode, drive] = NativeRock(scene_of(rock, mode), drive)
    return found


def carried(name: str, engine: Shaken) -> tuple[float, float]:
    """Ways of table and rock under the gentle motion: largest displacements along x [m].

    Raises:
        SystemExit: the rock does not follow its table.
    """
    table, rock, _ = engine.follow(GENTLE)
    way, apart = float(np.abs(table).max()), float(np.abs(rock - table).max())
    if way < 0.5 * GENTLE.displacement.max() or not apart < CARRIED * way:
        raise SystemExit(
            f"{name}: its table moved by {1e3 * way:.1f} mm, and its rock parted from it by "
            f"{1e3 * apart:.1f} mm: it is not carried, and its times mean nothing"
        )
    return way, float(np.abs(rock).max())


def rounds_of(shaken: dict[tuple[str, str], Shaken], motion: Motion, count: int) -> Rounds:
    """CPU times of a step [us], one value a round, engines in turn."""
    times: Rounds = {key: [] for key in shaken}
    for _ in range(count):
        for key, engine in shaken.items():
            times[key].append(engine.seconds(motion) * 1e6)
    return times


Rounds = dict[tuple[str, str], list[float]]


def ratio(times: Rounds, other: tuple[str, str], values: list[float]) -> str:
    """Median of the rounds' ratios to another engine; a dash where it was not measured."""
    ratios = [a / b for a, b in zip(times.get(other, []), values, strict=False)]
    return f"{statistics.median(ratios):.2f}" if ratios else "-"


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=ROOT / "models" / "pbr_scan.obj")
    parser.add_argument("--mass", type=float, default=446.6, help="[kg]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=15000)
    parser.add_argument("--strength", type=float, default=0.6, help="of the record, over its own")
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    parser.add_argument(
        "--orientation",
        type=float,
        nargs=4,
        default=(0.0, 0.0, 0.0, 1.0),
        help="of the mesh where it is let go, quaternion x y z w",
    )
    return parser.parse_args()


def main() -> None:
    """Check, measure and print the table."""
    options = parsed()
    start = YawStart(base_orientation=tuple(options.orientation))
    rock = settled(MeshRock(shape="mesh", file=options.mesh, mass=options.mass, start=start))
    motion = record(options.steps, options.strength)
    shaken = engines(rock)
    ways = {key: carried(" ".join(key), engine) for key, engine in shaken.items()}
    tilts = {key: float(engine.follow(motion)[2].max()) for key, engine in shaken.items()}
    times = rounds_of(shaken, motion, options.rounds)
    hull = len(native_scene(scene_of(rock, "parity")).rock_hull_vertices)
    print(
        f"{options.mesh.name}: {hull} hull vertices, strength {options.strength:g}, "
        f"{options.steps} steps, {options.rounds} rounds; CPU microseconds a step; "
        f"{base_provenance()['processor']}"
    )
    header = ["engine", "drive", "median", "min", "max", "times PyBullet", "times MuJoCo"]
    header += ["largest tilt [mrad]", "table carried [mm]", "rock carried [mm]"]
    rows = []
    for (name, drive), values in times.items():
        cells = [f"{f(values):.2f}" for f in (statistics.median, min, max)]
        cells.append(ratio(times, ("PyBullet", drive), values))
        same = drive == "prescribed"
        cells.append(ratio(times, ("MuJoCo", drive), values) if same else "-")
        cells.append(f"{1e3 * tilts[name, drive]:.1f}")
        cells += [f"{1e3 * way:.1f}" for way in ways[name, drive]]
        rows.append([name, drive, *cells])
    print("| " + " | ".join(header) + " |\n| --- | --- |" + " ---: |" * (len(header) - 2))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(
                [
                    ["mesh", "hull_vertices", "strength", *header],
                    *([options.mesh.stem, hull, options.strength, *row] for row in rows),
                ]
            )


if __name__ == "__main__":
    main()
