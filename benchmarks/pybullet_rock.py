"""The original system's scene in PyBullet, as the benchmarks and the parity tests step it.

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
from vsr2.scene import Box, Scene

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
        with PyBulletWorld(self._scene, self._mesh, self._drive) as world:
            world.settle()
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
        with PyBulletWorld(self._scene, self._mesh, self._drive) as world:
            world.settle()
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


class PyBulletWorld:
    """One connection, with the rock at its start.

    Args:
        scene: with default prism and base.
        mesh: the rock's file; None: the box of the scene.
        drive: motor or prescribed.
    """

    def __init__(self, scene: Scene, mesh: Path | None, drive: str = "motor") -> None:
        self._drive = drive
        self.client: dict[str, int] = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        c, engine = self.client, scene.engine
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
        pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), **c)
        pybullet.loadURDF("plane.urdf", **c)
        self.robot = self._table(scene.pedestal.mass)
        self.body = self._body(scene, mesh)
        for body, index, material in (
            (self.robot, 0, scene.contact.pedestal),
            (self.body, -1, scene.contact.rock),
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
        if engine.linear_damping == 0:  # else PyBullet's own, which nobody sets
            for body in (self.robot, self.body):
                pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, **c)
        start = scene.body_pose(scene.rock.start)
        pybullet.resetBasePositionAndOrientation(self.body, start.position, start.orientation, **c)
        pybullet.resetBaseVelocity(self.body, [0, 0, 0], [0, 0, 0], **c)

    def settle(self) -> None:
        """Let the rock come to rest."""
        for _ in range(SETTLING):
            pybullet.stepSimulation(**self.client)

    def _table(self, mass: float) -> int:
        c = self.client
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
        for index in (-1, 0):
            pybullet.setCollisionFilterGroupMask(robot, index, 1, 1, **c)
        if self._drive == "prescribed":
            # PyBullet puts a motor on every joint.
            pybullet.setJointMotorControl2(robot, 0, pybullet.VELOCITY_CONTROL, force=0, **c)
            pybullet.changeDynamics(robot, -1, linearDamping=0, angularDamping=0, **c)
        return int(robot)

    def _body(self, scene: Scene, mesh: Path | None) -> int:
        c, frame = self.client, scene.body_frame
        if mesh is None:
            [box] = scene.rock.parts
            assert isinstance(box, Box)
            half = [0.5 * size for size in box.size]
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **c)
        else:
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(mesh), **c)
        body = pybullet.createMultiBody(
            baseMass=scene.rock.mass.mass,
            baseCollisionShapeIndex=shape,
            baseInertialFramePosition=frame.position,
            baseInertialFrameOrientation=frame.orientation,
            **c,
        )
        if not scene.rock.inertia_from_aabb:
            inertia = scene.rock.mass.principal_inertia.tolist()
            pybullet.changeDynamics(body, -1, localInertiaDiagonal=inertia, **c)
        return int(body)

    def stepper(self, motion: Motion) -> Callable[[int], None]:
        """Does step k, from sample k to the next."""
        c, robot, positions = self.client, self.robot, motion.displacement.tolist()

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
        position, orientation = pybullet.getBasePositionAndOrientation(self.body, **self.client)
        return position, orientation

    def table(self) -> float:
        """Displacement along x [m]."""
        return float(pybullet.getJointState(self.robot, 0, **self.client)[0])

    def __enter__(self) -> PyBulletWorld:
        return self

    def __exit__(self, *exception: object) -> None:
        pybullet.disconnect(self.client["physicsClientId"])
