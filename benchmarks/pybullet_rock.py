"""The original system's scene in PyBullet, as the benchmarks step it.

The table follows its motion in either of two ways. `motor`: Bullet's joint motor, as in the
original system. `prescribed`: the joint is put at the sample and given the velocity that leads to
the next one, and the table has the mass that VSR2 gives a prescribed one, so that no rock slows it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pybullet_data
from numpy.typing import NDArray

from vsr2.motion import Motion
from vsr2.scene import Scene

Array = NDArray[np.float64]
PRESCRIBED_MASS = 1e30
"""Of a table that nothing slows [kg]."""
SETTLING = 600
"""Steps at rest before the motion."""


class PyBulletRock:
    """A scene of one mesh on the default prism.

    Args:
        scene: with the contact values of the original.
        mesh: the rock's file.
        drive: motor or prescribed.
    """

    def __init__(self, scene: Scene, mesh: Path, drive: str) -> None:
        self._scene, self._mesh, self._drive = scene, mesh, drive

    def seconds(self, motion: Motion) -> float:
        """CPU time of a step, stepped from Python without reading the state [s]."""
        with _World(self._scene, self._mesh, self._drive) as world:
            step, samples = world.stepper(motion), motion.displacement.size - 1
            begin = time.process_time()
            for k in range(samples):
                step(k)
            return (time.process_time() - begin) / samples

    def follow(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Where table and rock go in the world, and how far the rock tilts.

        Returns:
            Displacement of table [m] and mass centre [m] along x, tilt away from the start [rad],
            after every step, each of shape (samples - 1,).
        """
        with _World(self._scene, self._mesh, self._drive) as world:
            step = world.stepper(motion)
            place, start = world.rock()
            rows = []
            for k in range(motion.displacement.size - 1):
                step(k)
                position, orientation = world.rock()
                turned = pybullet.getDifferenceQuaternion(start, orientation)
                cosine = 1 - 2 * (turned[0] ** 2 + turned[1] ** 2)
                rows.append((world.table(), position[0] - place[0], np.arccos(min(cosine, 1.0))))
        table, rock, tilt = np.array(rows).T
        return table, rock, tilt


class _World:
    """One connection, with the rock settled."""

    def __init__(self, scene: Scene, mesh: Path, drive: str) -> None:
        self._drive = drive
        self._client: dict[str, int] = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        c, engine = self._client, scene.engine
        pybullet.setGravity(0, 0, -engine.gravity, **c)
        pybullet.setTimeStep(engine.time_step, **c)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=engine.solver_iterations,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
            solverResidualThreshold=0,
            **c,
        )
        pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), **c)
        pybullet.loadURDF("plane.urdf", **c)
        self._robot = self._table(scene.pedestal.mass)
        self._rock = self._body(scene, mesh)
        for body, index, material in (
            (self._robot, 0, scene.contact.pedestal),
            (self._rock, -1, scene.contact.rock),
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
        for _ in range(SETTLING):
            pybullet.stepSimulation(**c)

    def _table(self, mass: float) -> int:
        c = self._client
        base = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[25, 7, 1], **c)
        link = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[5, 5, 0.25], **c)
        robot = pybullet.createMultiBody(
            baseMass=0,
            baseCollisionShapeIndex=base,
            basePosition=[0, 0, 1],
            linkMasses=[PRESCRIBED_MASS if self._drive == "prescribed" else mass],
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
        if self._drive == "prescribed":
            # PyBullet puts a motor on every joint.
            pybullet.setJointMotorControl2(robot, 0, pybullet.VELOCITY_CONTROL, force=0, **c)
            pybullet.changeDynamics(robot, -1, linearDamping=0, angularDamping=0, **c)
        return int(robot)

    def _body(self, scene: Scene, mesh: Path) -> int:
        c, frame = self._client, scene.body_frame
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(mesh), **c)
        body = pybullet.createMultiBody(
            baseMass=scene.rock.mass.mass,
            baseCollisionShapeIndex=shape,
            baseInertialFramePosition=frame.position,
            baseInertialFrameOrientation=frame.orientation,
            **c,
        )
        inertia = scene.rock.mass.principal_inertia.tolist()
        pybullet.changeDynamics(body, -1, localInertiaDiagonal=inertia, **c)
        start = scene.body_pose(scene.rock.start)
        pybullet.resetBasePositionAndOrientation(body, start.position, start.orientation, **c)
        return int(body)

    def stepper(self, motion: Motion) -> Callable[[int], None]:
        """Does step k, from sample k to the next."""
        c, robot, positions = self._client, self._robot, motion.displacement.tolist()

        def motor(k: int) -> None:
            pybullet.setJointMotorControl2(
                robot, 0, pybullet.POSITION_CONTROL, targetPosition=positions[k + 1], force=5e8, **c
            )
            pybullet.stepSimulation(**c)

        def prescribed(k: int) -> None:
            speed = (positions[k + 1] - positions[k]) / motion.time_step
            pybullet.resetJointState(robot, 0, positions[k], speed, **c)
            pybullet.stepSimulation(**c)

        return {"motor": motor, "prescribed": prescribed}[self._drive]

    def rock(self) -> tuple[Any, Any]:
        """Mass centre [m] and orientation x, y, z, w."""
        return pybullet.getBasePositionAndOrientation(self._rock, **self._client)

    def table(self) -> float:
        """Displacement along x [m]."""
        return float(pybullet.getJointState(self._robot, 0, **self._client)[0])

    def __enter__(self) -> _World:
        return self

    def __exit__(self, *exception: object) -> None:
        pybullet.disconnect(self._client["physicsClientId"])
