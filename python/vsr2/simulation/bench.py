"""The bench on which effects are checked: two rocks, motions, trials with their series."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import (
    BoxRock,
    Contact,
    Engine,
    EngineMode,
    MeshRock,
    Output,
    PrismPedestal,
    YawStart,
)
from vsr2.effects import Bench, Effect, Response, with_effects
from vsr2.errors import SimulationError
from vsr2.motion import Motion, cosine_motion
from vsr2.results import JUDGED, Outcome, TrialLog
from vsr2.results.trial_log import ANGULAR_VELOCITY, EXCURSION_COLUMNS, VELOCITY
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
from vsr2.simulation.batch import OBSERVED_COLUMNS, run_batch
from vsr2.simulation.simulation import Simulation
from vsr2.trial import Observation, Trial

Array = NDArray[np.float64]
Rock = Literal["block", "scan"]


@dataclass(frozen=True)
class BenchConstants:
    """What the bench is made of; chosen by hand.

    Attributes:
        block: edge lengths of the block [m].
        density: of both rocks [kg/m^3].
        ramp: time over which a push comes and goes [s].
        push: time for which a push is held [s].
        touch: gap at which a body is released [m].
        stand: edge lengths of the pedestal [m].
        scan_points: of the made scan.
        scan_seed: of its radii.
        scan_half_axes: of the ellipsoid that it is cut from [m].
        scan_scatter: of its radii, relative.
        scan_cut: height of its base under the ellipsoid's centre [m].
        scan_unevenness: of its base, to either side [m].
        scan_yaw: at which it stands [degree].
    """

    block: tuple[float, float, float] = (0.4, 0.6, 1.2)
    density: float = 2700.0
    ramp: float = 0.1
    push: float = 0.6
    touch: float = 1e-6
    stand: tuple[float, float, float] = (20.0, 20.0, 0.5)
    scan_points: int = 700
    scan_seed: int = 20231
    scan_half_axes: tuple[float, float, float] = (0.27, 0.33, 0.75)
    scan_scatter: float = 0.02
    scan_cut: float = 0.52
    scan_unevenness: float = 0.001
    scan_yaw: float = 20.0


BENCH = BenchConstants()


def with_tail(trial: Trial, tail: float) -> Trial:
    """The trial with another longest time after its motion, at least a step [s]."""
    tail = max(tail, trial.scene.engine.time_step)
    return replace(trial, outcome=trial.outcome.model_copy(update={"tail": tail}))


def _stand() -> PedestalBody:
    return build_pedestal(PrismPedestal(size=BENCH.stand))


class EffectBench(Bench):
    """The bench of :class:`vsr2.effects.Bench`.

    Args:
        mode: of the engine.
        mesh: file of the rock that stands for a scan; by default a made one, :func:`boulder`.
    """

    def __init__(self, mode: EngineMode = "exact", mesh: Path | None = None) -> None:
        self._engine = Engine(mode=mode)
        self._mesh = mesh
        self._built: dict[Rock, Trial] = {}

    def block(self) -> Trial:
        """The block."""
        return self.standing("block")

    def scan(self) -> Trial:
        """The rock that stands for a scan."""
        return self.standing("scan")

    def standing(self, rock: Rock) -> Trial:
        """The block or the scan, built once."""
        if rock not in self._built:
            body, pedestal = self._body(rock), _stand()
            trial = Trial(
                scene=Scene(body, pedestal, self._engine, Contact()),
                motion=self.pulse(2.0, 2.0),
                output=Output(log_every=1),
            )
            self._built[rock] = with_tail(trial, 0.0)
        return self._built[rock]

    def _body(self, rock: Rock) -> RockBody:
        clearance = 2.0 * self._engine.collision_margin
        wanted: BoxRock | MeshRock = BoxRock(shape="box", size=BENCH.block, density=BENCH.density)
        if rock == "scan":
            if self._mesh is None:
                return boulder(_stand(), clearance)
            wanted = MeshRock(shape="mesh", file=self._mesh, density=BENCH.density)
        return build_rock(wanted, _stand(), clearance=clearance)

    def push(self, acceleration: float, *, duration: float = BENCH.push) -> Motion:
        """A smooth rise to a constant acceleration [m/s^2], held so long [s]."""
        # In the end it comes back as smoothly, and the pedestal stops at once: look before that.
        step = self._engine.time_step
        time = np.arange(round((duration + 2 * BENCH.ramp) / step) + 1) * step
        s = np.clip(np.minimum(time, time[-1] - time) / BENCH.ramp, 0.0, 1.0)
        a = acceleration * s**2 * (3 - 2 * s)
        v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * step)])
        x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * step)])
        return Motion(f"push_{acceleration:g}", step, x, v, a, "recording")

    def pulse(self, peak_acceleration: float, frequency: float) -> Motion:
        """A cosine pulse; peak acceleration [m/s^2], frequency [Hz]."""
        amplitude = peak_acceleration / (2 * math.pi * frequency) ** 2
        return cosine_motion(amplitude, frequency, self._engine.time_step)

    def run(
        self,
        trial: Trial,
        effect: Effect | None = None,
        values: Mapping[str, float] | None = None,
        *,
        tail: float = 0.0,
    ) -> Response:
        """One trial, settled first, `tail` [s] beyond its motion."""
        trial = with_tail(trial, tail)
        if effect is not None:
            trial = with_effects([trial], [(effect, effect.complete(values or {}))])[0]
        result = run_batch([trial], threads=1)
        if str(result["status"][0]) not in JUDGED:
            why = f"{result['status'][0]} {result['message'][0]}".rstrip()
            raise SimulationError(f"bench: the trial ended with status {why}")
        log = result.logs[0]
        assert log is not None
        return _response(log, Observation(**{key: result[key][0] for key in OBSERVED_COLUMNS}))

    def release(self, trial: Trial, tilt: float, duration: float, *, spin: float = 0.0) -> Response:
        """Free motion from a tilt [rad] for a time [s], with a spin [rad/s]."""
        scene, start = trial.scene, trial.start_pose
        margin = 0.0 if isinstance(scene.rock.parts[0], Box) else scene.engine.collision_margin
        turn = (0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt))
        pose = Pose(start.position, multiply(turn, start.orientation))
        gap = height_above(scene.rock.parts, pose, scene.pedestal)
        assert gap is not None
        x, y, z = pose.position
        simulation = Simulation(scene, spawn=False)
        simulation.spawn(Pose((x, y, z - gap + margin + BENCH.touch), pose.orientation))
        if spin:
            simulation.set_rock_velocity((0.0, 0.0, 0.0), (0.0, 0.0, spin))
        upright = scene.body_pose(start).orientation
        rows, pitch = [], []
        for _ in range(round(duration / simulation.time_step)):
            state = simulation.step(0.0)
            assert state is not None
            rows.append(state)
            pitch.append(simulation.excursion[EXCURSION_COLUMNS.index("pitch")])
        tilts = np.array([_tilt(upright, state.body_orientation) for state in rows])
        names = ("time", "position", "velocity", "angular_velocity")
        series = {name: np.array([getattr(state, name) for state in rows]) for name in names}
        return Response(
            **series,
            tilt=tilts,
            pedestal=np.zeros(len(rows)),
            pitch=np.array(pitch),
            observation=Observation(Outcome.rocked, float(tilts.max()), float(tilts[-1]), 0.0, 0.0),
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
        velocity=log.state[shaken, VELOCITY],
        angular_velocity=log.state[shaken, ANGULAR_VELOCITY],
        pedestal=log.column("pedestal_position")[shaken],
        pitch=log.pedestal_pitch[shaken],
        observation=observation,
    )


def boulder(pedestal: PedestalBody, clearance: float) -> RockBody:
    """A made rock with the irregular hull of a scan: 0.5 m wide, 1.2 m high, some 340 kg.

    Points of an ellipsoid at golden-section angles, their radii varied by a fixed random draw, cut
    off to a base. The hull is the solid.
    """
    import trimesh

    rng, count = np.random.default_rng(BENCH.scan_seed), BENCH.scan_points
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    around = np.pi * (3 - math.sqrt(5)) * np.arange(count)
    level = np.sqrt(1 - height**2)
    unit = np.column_stack([level * np.cos(around), level * np.sin(around), height])
    scatter = 1 + BENCH.scan_scatter * rng.standard_normal((count, 1))
    points = unit * np.array(BENCH.scan_half_axes) * scatter
    # Points below the cut become the base.
    low = points[:, 2] < -BENCH.scan_cut
    uneven = BENCH.scan_unevenness * rng.uniform(-1, 1, int(low.sum()))
    points[low, 2] = -BENCH.scan_cut + uneven
    hull = hull_surface(points)
    mesh = trimesh.Trimesh(hull.vertices, hull.faces, process=False)
    mass: MassProperties = mesh_mass_properties(mesh, density=BENCH.density, source="boulder")
    parts = (Hull(hull.vertices),)
    start = start_pose(YawStart(yaw=BENCH.scan_yaw), parts, mass, pedestal, clearance=clearance)
    return RockBody(parts=parts, mass=mass, start=start, surface=hull, source="boulder")
