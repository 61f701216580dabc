"""Microseconds a step of every engine, of PyBullet and of MuJoCo, interleaved in one run.

    pip install '.[benchmark]'
    python benchmarks/engine_speed.py [--mesh MESH --mass KG] [--orientation X Y Z W]
                                      [--rounds N] [--steps N] [--out CSV]

All drive the same rock through the same record (embedded: configs/motions/synthetic_07.csv) on the
same prism. CPU time of the stepping loop alone, one round of each engine after the other, so that
a change of the machine's speed meets all of them; the table gives medians, the spread, and ratios
to PyBullet's and MuJoCo's medians. PyBullet and MuJoCo are stepped from Python without reading the
state, our engines inside the core as a batch of one trial does. Where one of the two is not
installed the table goes without it.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsr2.config.study import (
    ORIGINAL,
    Engine,
    MeshRock,
    Outcome,
    Output,
    PrismPedestal,
    Settling,
    YawStart,
)
from vsr2.config.study import Contact as ContactConfig
from vsr2.motion import Motion, build_recorded_motion, read_record
from vsr2.results import base_provenance
from vsr2.scene import Scene, build_pedestal, build_rock
from vsr2.simulation import native_scene, run_batch
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent


def scene_of(rock: MeshRock, mode: str) -> Scene:
    """The rock on the default prism, for one engine, with the values that PyBullet has below."""
    pedestal = build_pedestal(PrismPedestal())
    body = build_rock(rock, pedestal, clearance=0.002)
    original = ContactConfig(**ORIGINAL["contact"])
    scene = Scene(body, pedestal, Engine(mode=mode, **ORIGINAL["engine"]), original)
    native_scene(scene)  # built here, not where it is timed
    return scene


def record(steps: int) -> Motion:
    """The embedded record, repeated or cut to `steps` time steps, too weak to overturn."""
    motion = build_recorded_motion(read_record(ROOT / "configs/motions/synthetic_07.csv"), 1e-3)
    repeats = -(-steps // (motion.displacement.size - 1))
    parts = [0.6 * getattr(motion, name) for name in ("displacement", "velocity", "acceleration")]
    tiled = [np.concatenate([p[:1], *[p[1:]] * repeats])[: steps + 1] for p in parts]
    return Motion("bench", 1e-3, *tiled, "recording")


def native(rock: MeshRock, mode: str, motion: Motion) -> Callable[[], float]:
    """CPU seconds of the steps of one trial, without settling."""
    trial = Trial(
        scene=scene_of(rock, mode),
        motion=motion,
        settling=Settling(linear_speed=0.05, angular_speed=0.2),
        outcome=Outcome(tail=1e-3),
        output=Output(log_every=0),
    )
    short = replace(
        motion,
        displacement=motion.displacement[:2],
        velocity=motion.velocity[:2],
        acceleration=motion.acceleration[:2],
    )
    still = replace(trial, motion=short)

    def measure() -> float:
        def cpu(what: Trial) -> float:
            start = time.process_time()
            result = run_batch([what], threads=1)
            assert result["status"][0] in ("ok", "tail_timeout"), result["status"][0]
            return time.process_time() - start

        return cpu(trial) - cpu(still)

    return measure


def pybullet_loop(rock: MeshRock, motion: Motion) -> Callable[[], float]:
    """CPU seconds of PyBullet's loop over the record."""
    import pybullet
    import pybullet_data

    scene = scene_of(rock, "parity")

    def measure() -> float:
        client = pybullet.connect(pybullet.DIRECT)
        c = {"physicsClientId": client}
        pybullet.setGravity(0, 0, -9.81, **c)
        pybullet.setTimeStep(1e-3, **c)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=150,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
            solverResidualThreshold=0,
            **c,
        )
        pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), **c)
        pybullet.loadURDF("plane.urdf", **c)
        base = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[25, 7, 1], **c)
        link = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[5, 5, 0.25], **c)
        robot = pybullet.createMultiBody(
            baseMass=0,
            baseCollisionShapeIndex=base,
            basePosition=[0, 0, 1],
            linkMasses=[2e5],
            linkCollisionShapeIndices=[link],
            linkVisualShapeIndices=[-1],
            linkPositions=[[0, 0, 1.25]],
            linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0]],
            linkInertialFrameOrientations=[[0, 0, 0, 1]],
            linkParentIndices=[0],
            linkJointTypes=[pybullet.JOINT_PRISMATIC],
            linkJointAxis=[[1, 0, 0]],
            **c,
        )
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(rock.file), **c)
        frame, start = scene.body_frame, scene.body_pose(scene.rock.start)
        body = pybullet.createMultiBody(
            baseMass=scene.rock.mass.mass,
            baseCollisionShapeIndex=shape,
            baseInertialFramePosition=frame.position,
            baseInertialFrameOrientation=frame.orientation,
            **c,
        )
        inertia = scene.rock.mass.principal_inertia.tolist()
        pybullet.changeDynamics(body, -1, localInertiaDiagonal=inertia, **c)
        for each, index in ((robot, 0), (body, -1)):
            pybullet.changeDynamics(
                each,
                index,
                restitution=0.35,
                lateralFriction=0.7,
                spinningFriction=0.5,
                contactStiffness=2.6e9,
                contactDamping=1e7,
                **c,
            )
        pybullet.resetBasePositionAndOrientation(body, start.position, start.orientation, **c)
        for _ in range(600):
            pybullet.stepSimulation(**c)
        begin = time.process_time()
        for x in motion.displacement[1:].tolist():
            pybullet.setJointMotorControl2(
                robot, 0, pybullet.POSITION_CONTROL, targetPosition=x, force=5e8, **c
            )
            pybullet.stepSimulation(**c)
        used = time.process_time() - begin
        pybullet.disconnect(client)
        return used

    return measure


def mujoco_loop(rock: MeshRock, motion: Motion) -> Callable[[], float]:
    """CPU seconds of MuJoCo's loop with its default settings (1 ms), same hull."""
    import mujoco

    scene = scene_of(rock, "parity")
    points = native_scene(scene).rock_hull_vertices
    start = scene.body_pose(scene.rock.start)
    inertia = " ".join(map(str, scene.rock.mass.principal_inertia))
    x, y, z, w = start.orientation
    vertices = " ".join(f"{v:.9g}" for v in points.ravel())
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><option timestep="0.001"/>
      <asset><mesh name="rock" vertex="{vertices}"/></asset>
      <worldbody>
        <body name="pedestal" mocap="true" pos="0 0 2.25"><geom type="box" size="5 5 0.25"/></body>
        <body name="rock" pos="{" ".join(map(str, start.position))}" quat="{w} {x} {y} {z}">
          <freejoint/>
          <inertial pos="0 0 0" mass="{scene.rock.mass.mass}" diaginertia="{inertia}"/>
          <geom type="mesh" mesh="rock" friction="0.7 0.005 0.0001" condim="4"/>
        </body>
      </worldbody>
    </mujoco>""")

    def measure() -> float:
        data = mujoco.MjData(model)
        for _ in range(600):
            mujoco.mj_step(model, data)
        begin = time.process_time()
        for x in motion.displacement[1:].tolist():
            data.mocap_pos[0, 0] = x
            mujoco.mj_step(model, data)
        return time.process_time() - begin

    return measure


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=ROOT / "models" / "pbr_scan.obj")
    parser.add_argument("--mass", type=float, default=446.6, help="[kg]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=15000)
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    parser.add_argument(
        "--orientation",
        type=float,
        nargs=4,
        default=(0.0, 0.0, 0.0, 1.0),
        help="of the mesh where it stands, quaternion x y z w",
    )
    options = parser.parse_args()
    rock = MeshRock(
        shape="mesh",
        file=options.mesh,
        mass=options.mass,
        start=YawStart(base_orientation=tuple(options.orientation)),
    )
    motion = record(options.steps)
    loops: dict[str, Callable[[], float]] = {}
    if importlib.util.find_spec("pybullet"):
        loops["PyBullet"] = pybullet_loop(rock, motion)
    if importlib.util.find_spec("mujoco"):
        loops["MuJoCo default"] = mujoco_loop(rock, motion)
    for mode in ("parity", "exact", "fast"):
        loops[mode] = native(rock, mode, motion)
    times: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(options.rounds):
        for name, measure in loops.items():
            times[name].append(measure() / options.steps * 1e6)
    hull = len(native_scene(scene_of(rock, "parity")).rock_hull_vertices)
    print(
        f"{options.mesh.name}: {hull} hull vertices, {options.steps} steps, "
        f"{options.rounds} rounds; CPU microseconds a step; {processor()}"
    )
    header = ["engine", "median", "min", "max", "times PyBullet", "times MuJoCo"]
    rows = []
    for name, values in times.items():
        row = [name, *(f"{f(values):.2f}" for f in (statistics.median, min, max))]
        for other in ("PyBullet", "MuJoCo default"):
            ratios = [a / b for a, b in zip(times.get(other, []), values, strict=False)]
            row.append(f"{statistics.median(ratios):.1f}" if ratios else "-")
        rows.append(row)
    print("| " + " | ".join(header) + " |\n| --- |" + " ---: |" * (len(header) - 1))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file).writerows(
                [
                    ["mesh", "hull_vertices", *header],
                    *([options.mesh.stem, hull, *row] for row in rows),
                ]
            )


def processor() -> str:
    """Model of the processor."""
    return str(base_provenance()["processor"])


if __name__ == "__main__":
    main()
