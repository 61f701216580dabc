"""The bench on which effects are checked: two rocks, motions, trials with their series."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import (
    BoxRock,
    Contact,
    Engine,
    MeshRock,
    Output,
    PrismPedestal,
    YawStart,
)
from vsr2.effects import Effect, Response, with_effects
from vsr2.errors import SimulationError
from vsr2.motion import Motion, cosine_motion
from vsr2.results import JUDGED, TrialLog
from vsr2.scene import (
    Box,
    Hull,
    MassProperties,
    PedestalBody,
    Pose,
    RockBody,
    Scene,
    build_pedestal,
    build_rock,
    height_above,
    mesh_mass_properties,
    start_pose,
)
from vsr2.scene.rotation import multiply
from vsr2.scene.shapes import hull_surface
from vsr2.simulation.batch import OBSERVED, run_batch
from vsr2.simulation.simulation import Simulation
from vsr2.trial import Observation, Trial

Array = NDArray[np.float64]

BLOCK = (0.4, 0.6, 1.2)
"""Edge lengths of the block [m]."""
DENSITY = 2700.0
RAMP = 0.1
"""Time over which a push comes and goes [s]."""
TOUCH = 1e-6
"""Gap at which a body is released [m]."""


def with_tail(trial: Trial, tail: float) -> Trial:
    """The trial with another longest time after its motion, at least a step [s]."""
    tail = max(tail, trial.scene.engine.time_step)
    return replace(trial, outcome=trial.outcome.model_copy(update={"tail": tail}))


def _stand() -> PedestalBody:
    return build_pedestal(PrismPedestal(size=(20.0, 20.0, 0.5)))


class EffectBench:
    """The bench of :class:`vsr2.effects.Bench`.

    The engine is without Bullet's damping of velocities, so that laws of conservation hold.

    Args:
        mode: of the engine.
        mesh: file of the rock that stands for a scan; by default a made one, :func:`boulder`.
    """

    def __init__(
        self, mode: Literal["parity", "exact", "fast", "auto"] = "exact", mesh: Path | None = None
    ) -> None:
        self._engine = Engine(mode=mode, linear_damping=0.0, angular_damping=0.0)
        self._mesh = mesh

    def block(self) -> Trial:
        """A homogeneous block, 0.4 m x 0.6 m x 1.2 m, on an even pedestal, at rest."""
        return self._block

    @cached_property
    def _block(self) -> Trial:
        return self._standing(BoxRock(shape="box", size=BLOCK, density=DENSITY))

    def scan(self) -> Trial:
        """A rock with the irregular hull of a scan."""
        return self._scan

    @cached_property
    def _scan(self) -> Trial:
        if self._mesh is None:
            return self._trial(boulder(_stand(), 2.0 * self._engine.collision_margin))
        return self._standing(MeshRock(shape="mesh", file=self._mesh, density=DENSITY))

    def _standing(self, rock: BoxRock | MeshRock) -> Trial:
        clearance = 2.0 * self._engine.collision_margin
        return self._trial(build_rock(rock, _stand(), clearance=clearance))

    def _trial(self, rock: RockBody) -> Trial:
        trial = Trial(
            scene=Scene(rock, _stand(), self._engine, Contact()),
            motion=self.pulse(2.0, 2.0),
            output=Output(log_every=1),
        )
        return with_tail(trial, 0.0)

    def push(self, acceleration: float, *, duration: float = 0.6) -> Motion:
        """A motion that reaches a constant acceleration [m/s^2] smoothly and holds it [s].

        Then it ends as smoothly, and the pedestal stops at once: look before that.
        """
        step = self._engine.time_step
        time = np.arange(round((duration + 2 * RAMP) / step) + 1) * step
        s = np.clip(np.minimum(time, time[-1] - time) / RAMP, 0.0, 1.0)
        a = acceleration * s**2 * (3 - 2 * s)
        v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * step)])
        x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * step)])
        return Motion(f"push_{acceleration:g}", step, x, v, a, "recording")

    def pulse(self, pga: float, frequency: float) -> Motion:
        """A cosine pulse, x = A (1 - cos 2 pi F t); PGA [m/s^2], F [Hz]."""
        amplitude = pga / (2 * math.pi * frequency) ** 2
        return cosine_motion(amplitude, frequency, self._engine.time_step)

    def run(
        self,
        trial: Trial,
        effect: Effect | None = None,
        values: Mapping[str, float] | None = None,
        *,
        tail: float = 0.0,
    ) -> Response:
        """One trial of `trial` with the effect, settled first; `tail` [s] after the motion."""
        trial = with_tail(trial, tail)
        if effect is not None:
            trial = with_effects([trial], [(effect, effect.complete(values or {}))])[0]
        result = run_batch([trial], threads=1)
        if str(result["status"][0]) not in JUDGED:
            raise SimulationError(f"bench: {result['status'][0]}: {result['message'][0]}")
        log = result.logs[0]
        assert log is not None
        return _response(log, Observation(**{key: result[key][0] for key in OBSERVED}))

    def release(self, trial: Trial, tilt: float, duration: float, *, spin: float = 0.0) -> Response:
        """Free motion for a time [s]: let go tilted about its edge towards +x [rad] and spinning.

        The spin is about the vertical [rad/s]; tilts count from upright.
        """
        scene, start = trial.scene, trial.start_pose
        margin = 0.0 if isinstance(scene.rock.parts[0], Box) else scene.engine.collision_margin
        turn = (0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt))
        pose = Pose(start.position, multiply(turn, start.orientation))
        gap = height_above(scene.rock.parts, pose, scene.pedestal)
        assert gap is not None
        x, y, z = pose.position
        simulation = Simulation(scene, spawn=False)
        simulation.spawn(Pose((x, y, z - gap + margin + TOUCH), pose.orientation))
        if spin:
            simulation.set_rock_velocity((0.0, 0.0, 0.0), (0.0, 0.0, spin))
        upright = scene.body_pose(start).orientation
        rows, pitch = [], []
        for _ in range(round(duration / simulation.time_step)):
            state = simulation.step(0.0)
            assert state is not None
            rows.append(state)
            pitch.append(simulation.excursion[2])
        orientation = np.array([state.body_orientation for state in rows])
        tilts = np.array([_tilt(upright, q) for q in orientation])
        return Response(
            time=np.array([state.time for state in rows]),
            tilt=tilts,
            position=np.array([state.position for state in rows]),
            velocity=np.array([state.velocity for state in rows]),
            angular_velocity=np.array([state.angular_velocity for state in rows]),
            pedestal=np.zeros(len(rows)),
            pitch=np.array(pitch),
            observation=Observation("rocked", float(tilts.max()), float(tilts[-1]), 0.0, 0.0),
        )


def _tilt(rest: Sequence[float], q: Array) -> float:
    conjugate = (-rest[0], -rest[1], -rest[2], rest[3])
    x, y, _, _ = multiply((q[0], q[1], q[2], q[3]), conjugate)
    return 2.0 * math.asin(min(1.0, math.hypot(x, y)))


def _response(log: TrialLog, observation: Observation) -> Response:
    shaken = log.time >= 0
    return Response(
        time=log.time[shaken],
        tilt=log.tilt[shaken],
        position=log.position[shaken],
        velocity=_columns(log, "rock_v", shaken),
        angular_velocity=_columns(log, "rock_w", shaken),
        pedestal=log.column("pedestal_position")[shaken],
        pitch=log.excursions[shaken, 2] if len(log.excursions) else np.zeros(int(shaken.sum())),
        observation=observation,
    )


def _columns(log: TrialLog, prefix: str, rows: NDArray[np.bool_]) -> Array:
    return np.column_stack([log.column(f"{prefix}{axis}")[rows] for axis in "xyz"])


def boulder(pedestal: PedestalBody, clearance: float) -> RockBody:
    """A made rock with the irregular hull of a scan: 0.5 m wide, 1.2 m high, some 340 kg.

    Points of an ellipsoid at golden-section angles, their radii varied by a fixed random draw, cut
    off to a base. The hull is the solid.
    """
    import trimesh

    rng = np.random.default_rng(20231)
    count = 700
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    around = np.pi * (3 - math.sqrt(5)) * np.arange(count)
    level = np.sqrt(1 - height**2)
    unit = np.column_stack([level * np.cos(around), level * np.sin(around), height])
    points = unit * np.array([0.27, 0.33, 0.75]) * (1 + 0.02 * rng.standard_normal((count, 1)))
    # Points below the cut become the base, uneven by a millimetre.
    low = points[:, 2] < -0.52
    points[low, 2] = -0.52 + 0.001 * rng.uniform(-1, 1, int(low.sum()))
    hull = hull_surface(points)
    mesh = trimesh.Trimesh(hull.vertices, hull.faces, process=False)
    mass: MassProperties = mesh_mass_properties(mesh, density=DENSITY, source="boulder")
    parts = (Hull(hull.vertices),)
    start = start_pose(YawStart(yaw=20.0), parts, mass, pedestal, clearance=clearance)
    return RockBody(parts=parts, mass=mass, start=start, surface=hull, source="boulder")
