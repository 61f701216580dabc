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
    UrdfRock,
)
from vsr2.motion import Motion, build_recorded_motion, cosine_motion, read_record
from vsr2.scene import Scene, build_pedestal, build_rock
from vsr2.simulation import Simulation, native_scene

pybullet = pytest.importorskip("pybullet", reason="the test extra installs PyBullet")

from pybullet_rock import PyBulletWorld  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
MESH = ROOT / "models" / "pbr_scan.obj"
URDF = ROOT / "models" / "pbr_scan.urdf"
MOTION = ROOT / "configs" / "motions" / "synthetic_12.csv"
HOLD = 300
"""Steps at rest before the motion."""


class Reference(PyBulletWorld):
    """The original's scene in PyBullet, driven as `Simulation` is."""

    def step(self, position: float, velocity: float) -> np.ndarray:
        pybullet.setJointMotorControl2(
            self.robot,
            0,
            pybullet.POSITION_CONTROL,
            targetPosition=position,
            targetVelocity=velocity,
            force=5e8,
            maxVelocity=200,
            **self.client,
        )
        pybullet.stepSimulation(**self.client)
        p, q = pybullet.getBasePositionAndOrientation(self.body, **self.client)
        x, v = pybullet.getJointState(self.robot, 0, **self.client)[:2]
        return np.array([*p, *q, x, v])

    def inertia(self) -> np.ndarray:
        return np.array(pybullet.getDynamicsInfo(self.body, -1, **self.client)[2])


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
    with Reference(scene, MESH if body == "mesh" else None) as reference:
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


class Loaded(Reference):
    """The same, with the rock that `loadURDF` makes."""

    def _body(self, scene: Scene, mesh: Path | None) -> int:
        assert mesh is not None
        file_s = pybullet.URDF_USE_INERTIA_FROM_FILE
        body = int(pybullet.loadURDF(str(mesh), flags=file_s, **self.client))
        inertia = scene.rock.mass.principal_inertia.tolist()
        pybullet.changeDynamics(body, -1, localInertiaDiagonal=inertia, **self.client)
        return body


def test_a_rock_of_load_urdf_parts_where_it_lands() -> None:
    pedestal = build_pedestal(PrismPedestal())
    rock = build_rock(UrdfRock(shape="urdf", file=URDF), pedestal, clearance=0.002)
    engine = Engine(mode="parity", **ORIGINAL["engine"])
    scene = Scene(rock, pedestal, engine, Contact(**ORIGINAL["contact"]))
    simulation = Simulation(scene, drive="motor_position")
    apart = []
    with Reference(scene, MESH) as created, Loaded(scene, URDF) as loaded:
        np.testing.assert_array_equal(loaded.inertia(), created.inertia())
        for k in range(100):
            ours = simulation.step(0.0)
            got = np.array([*ours.position, *ours.body_orientation])
            assert got.tobytes() == created.step(0.0, 0.0)[:7].tobytes(), f"step {k}"
            apart.append(np.abs(got - loaded.step(0.0, 0.0)[:7]).max())
    falling = int(np.flatnonzero(apart)[0])
    assert 0 < falling < 50
    assert 0 < max(apart) < 1e-9
