"""`parity` against PyBullet: the same bits on every step, compared in the same run."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from vsr2.config.study import (
    ORIGINAL,
    BoxRock,
    Contact,
    Engine,
    FixedStart,
    MeshRock,
    PrismPedestal,
)
from vsr2.motion import Motion, build_recorded_motion, cosine_motion, read_record
from vsr2.scene import Scene, build_pedestal, build_rock
from vsr2.simulation import Simulation, native_scene

pybullet = pytest.importorskip("pybullet", reason="the test extra installs PyBullet")

ROOT = Path(__file__).resolve().parents[2]
MESH = ROOT / "models" / "pbr_scan.obj"
MOTION = ROOT / "configs" / "motions" / "synthetic_12.csv"
HOLD = 300
"""Steps at rest before the motion."""


class Reference:
    """The original's scene in PyBullet."""

    def __init__(self, scene: Scene, *, mesh: Path | None) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        c = {"physicsClientId": self.client}
        engine, rock, contact = scene.engine, scene.rock, scene.contact
        pybullet.setGravity(0, 0, -engine.gravity, **c)
        pybullet.setTimeStep(engine.time_step, **c)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=engine.solver_iterations,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
            useSplitImpulse=1,
            splitImpulsePenetrationThreshold=-0.04,
            solverResidualThreshold=0,
            **c,
        )
        import pybullet_data

        pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), **c)
        pybullet.loadURDF("plane.urdf", **c)
        base = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[25, 7, 1], **c)
        link = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[5, 5, 0.25], **c)
        self.robot = pybullet.createMultiBody(
            baseMass=0,
            baseCollisionShapeIndex=base,
            basePosition=[0, 0, 1],
            linkMasses=[scene.pedestal.mass],
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
        for index in (-1, 0):
            pybullet.setCollisionFilterGroupMask(self.robot, index, 1, 1, **c)
        if mesh is None:
            half = [0.5 * size for size in rock.parts[0].size]
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **c)
        else:
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(mesh), **c)
        frame = scene.body_frame
        self.rock = pybullet.createMultiBody(
            baseMass=rock.mass.mass,
            baseCollisionShapeIndex=shape,
            baseInertialFramePosition=frame.position,
            baseInertialFrameOrientation=frame.orientation,
            **c,
        )
        if not rock.inertia_from_aabb:
            pybullet.changeDynamics(
                self.rock, -1, localInertiaDiagonal=rock.mass.principal_inertia.tolist(), **c
            )
        for body, index, material in (
            (self.robot, 0, contact.pedestal),
            (self.rock, -1, contact.rock),
        ):
            pybullet.changeDynamics(
                body,
                index,
                restitution=material.restitution,
                lateralFriction=material.lateral_friction,
                spinningFriction=material.spinning_friction,
                contactStiffness=material.stiffness,
                contactDamping=material.damping,
                **c,
            )
        if scene.engine.linear_damping == 0:  # else PyBullet's own, which nobody sets
            for body in (self.robot, self.rock):
                pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, **c)
        start = scene.body_pose(rock.start)
        pybullet.resetBasePositionAndOrientation(self.rock, start.position, start.orientation, **c)
        pybullet.resetBaseVelocity(self.rock, [0, 0, 0], [0, 0, 0], **c)
        self.c = c

    def step(self, position: float, velocity: float) -> np.ndarray:
        pybullet.setJointMotorControl2(
            self.robot,
            0,
            pybullet.POSITION_CONTROL,
            targetPosition=position,
            targetVelocity=velocity,
            force=5e8,
            maxVelocity=200,
            **self.c,
        )
        pybullet.stepSimulation(**self.c)
        p, q = pybullet.getBasePositionAndOrientation(self.rock, **self.c)
        x, v = pybullet.getJointState(self.robot, 0, **self.c)[:2]
        return np.array([*p, *q, x, v])

    def inertia(self) -> np.ndarray:
        return np.array(pybullet.getDynamicsInfo(self.rock, -1, **self.c)[2])

    def close(self) -> None:
        pybullet.disconnect(self.client)


def scene_of(body: str, inertia: str, preset: str = "original") -> Scene:
    pedestal = build_pedestal(PrismPedestal())
    if body == "box":
        start = FixedStart(
            mode="pose",
            position=(0.0, 0.0, 2.978),
            orientation=(0.0, 0.0, np.sin(0.1), np.cos(0.1)),
        )
        config = BoxRock(shape="box", size=(0.4, 0.55, 0.95), mass=353.8, start=start)
    else:
        config = MeshRock(shape="mesh", file=MESH, mass=353.8, inertia=inertia)
    rock = build_rock(config, pedestal, clearance=0.002)
    if body == "box" and inertia == "aabb":
        from dataclasses import replace

        rock = replace(rock, inertia_from_aabb=True)
    if preset == "physical":
        return Scene(rock, pedestal, Engine(mode="parity"), Contact())
    engine = Engine(mode="parity", **ORIGINAL["engine"])
    return Scene(rock, pedestal, engine, Contact(**ORIGINAL["contact"]))


def motion_of(kind: str) -> Motion:
    if kind == "cosine":
        return cosine_motion(0.12, 1.2, 1e-3)
    return build_recorded_motion(read_record(MOTION), 1e-3, channel="auto", filter=None, scale=1.0)


@pytest.mark.parametrize(
    ("body", "inertia", "kind", "preset"),
    [
        *itertools.product(
            ("box", "mesh"), ("mesh", "aabb"), ("cosine", "recording"), ["original"]
        ),
        ("box", "mesh", "cosine", "physical"),
        ("mesh", "mesh", "recording", "physical"),
    ],
)
def test_same_bits_as_pybullet_on_every_step(
    body: str, inertia: str, kind: str, preset: str
) -> None:
    scene = scene_of(body, inertia, preset)
    motion = motion_of(kind)
    drive = "motor_position_velocity" if kind == "cosine" else "motor_position"
    simulation = Simulation(scene, drive=drive)
    reference = Reference(scene, mesh=MESH if body == "mesh" else None)
    try:
        np.testing.assert_array_equal(reference.inertia(), native_scene(scene).rock_inertia)
        steps = HOLD + min(motion.displacement.size + 1000, 9000)
        tilted = 0.0
        for k in range(steps):
            i = min(max(0, k - HOLD), motion.displacement.size - 1)
            x = float(motion.displacement[i])
            v = float(motion.velocity[i]) if kind == "cosine" else 0.0
            expected = reference.step(x, v)
            state = simulation.step(x, v)
            got = np.array(
                [
                    *state.position,
                    *state.body_orientation,
                    state.pedestal_position,
                    state.pedestal_velocity,
                ]
            )
            assert got.tobytes() == expected.tobytes(), f"step {k}: {got - expected}"
            tilted = max(tilted, float(np.abs(state.angular_velocity).max()))
        assert tilted > 0.1, "the rock never moved: the comparison proves nothing"
    finally:
        reference.close()
