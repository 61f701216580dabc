"""One interactive world that a Python control loop can step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2._native import EngineKind, HandOver
from vsr2.argument_names import checked_names
from vsr2.config import Study, load_study
from vsr2.config.motion_source import DriveMode
from vsr2.config.study import Settling
from vsr2.errors import SimulationError
from vsr2.one_line import OneLine
from vsr2.read_only import real_array
from vsr2.scene import Pose, Scene, build_scene
from vsr2.simulation.native_drive import native_drive
from vsr2.simulation.native_scenes import native_scene, refusals

Array = NDArray[np.float64]
MAX_SET_POINT = 1e6
"""Greatest set-point of the pedestal [m], [m/s]."""
DRIVES: tuple[str, ...] = tuple(_native.Drive.__members__)
"""Names of the drives."""


@dataclass(frozen=True, eq=False)
class State:
    """State of the world after a step.

    Attributes:
        time: since the world was built [s].
        commanded_position, commanded_velocity: last set-points [m], [m/s].
        pedestal_position, pedestal_velocity: achieved [m], [m/s].
        position: mass centre p_WB, shape (3,) [m].
        body_orientation: q_WB, quaternion x, y, z, w, shape (4,).
        velocity: of the mass centre, shape (3,) [m/s].
        angular_velocity: in the world, shape (3,) [rad/s].
    """

    time: float
    commanded_position: float
    commanded_velocity: float
    pedestal_position: float
    pedestal_velocity: float
    position: Array
    body_orientation: Array
    velocity: Array
    angular_velocity: Array


@dataclass(frozen=True, eq=False)
class SimulationState:
    """What :meth:`Simulation.save_state` gave; it pickles.

    Attributes:
        scene_sha256: of the scene, whose simulations take the state.
        world: the core's part, opaque.
        start: pose that `reset` puts the rock at.
        steps: time steps since the world was built.
        command: last set-points of position [m] and velocity [m/s].
    """

    scene_sha256: str
    world: _native.WorldState
    start: Pose
    steps: int
    command: tuple[float, float]


@checked_names(SimulationError)
class Simulation(OneLine):
    """A pedestal with or without a rock, stepped from Python; the core is that of `run_batch`.

    `spawn`, `reset` and `delete` are the original's service `manage_model` (supplement S1.1). As a
    context manager it lets go of its world at the end, and refuses what needs one from then on.

    Args:
        study: a study, or the path of one; or a scene built before.
        drive: how the pedestal follows the set-points given to `step`; the default comes from the
            study's motion (`motor` follows the velocity too for cosine modes, S1.3).
            `prescribed_spatial` takes set-points along y and z and in pitch too; a pedestal that
            pitches on a spring needs it, and takes none in pitch.
        spawn: put the rock in place at once.

    Raises:
        ConfigError, GeometryError, SimulationError: the study cannot be used, has effects, or is
            none.
    """

    def __init__(
        self,
        study: Study | Scene | str | PathLike[str],
        *,
        drive: str | None = None,
        spawn: bool = True,
    ) -> None:
        if isinstance(study, Scene):
            self.scene, self._settling = study, Settling()
            source: DriveMode = "prescribed"
            cosine = False
        elif isinstance(study, Study | str | PathLike):
            loaded = study if isinstance(study, Study) else load_study(study)
            if loaded.effects:
                raise SimulationError(
                    f"study {loaded.name!r}: has {', '.join(loaded.effects)}, but a Simulation "
                    "that is stepped by hand applies no effects; leave them out, or give the scene "
                    "of a trial of `study_trials`, in which those on the scene act",
                    key="effects",
                )
            self.scene, self._settling = build_scene(loaded), loaded.settling
            source = loaded.motion.drive
            cosine = loaded.motion.mode in ("single_cosine", "grid_cosine")
        else:
            raise SimulationError(
                f"simulation: got {study!r}, a {type(study).__name__}; give a Study, the path of "
                "one, or a Scene"
            )
        default = native_drive(source, beside_x=self.scene.pitches, cosine=cosine)
        self.drive = drive or default.name
        if self.drive not in DRIVES:
            raise SimulationError(
                f"drive {self.drive!r} is not known; choose one of {', '.join(DRIVES)}"
            )
        self._drive = getattr(_native.Drive, self.drive)
        self._start = self.scene.rock.start
        self._begin(self._start if spawn else None)

    def _begin(self, start: Pose | None) -> None:
        """A fresh world at time 0, with the rock at a pose or without one."""
        with refusals(f"drive {self.drive!r}"):
            self._held: _native.World | None = _native.World(
                scene=native_scene(self.scene), drive=self._drive
            )
        self._steps = 0
        self._command = (0.0, 0.0)
        if start is not None:
            self.spawn(start)

    @property
    def _world(self) -> _native.World:
        if self._held is None:
            raise SimulationError(
                "simulation: its `with` block is over and its world is gone; build a new Simulation"
            )
        return self._held

    @property
    def facts(self) -> Mapping[str, object]:
        """The scene, whether the rock is in it, the drive and the time [s]."""
        return {
            "scene": self.scene,
            "has_rock": self._held is not None and self.has_rock,
            "drive": self.drive,
            "time": self.time,
        }

    @property
    def time_step(self) -> float:
        """Interval of one `step` [s]."""
        return self.scene.engine.time_step

    @property
    def time(self) -> float:
        """Time since the world was built [s]."""
        return self._steps * self.time_step

    @property
    def engine(self) -> EngineKind:
        """Engine that the world began with: parity, exact or fast; equal to its name as text."""
        return self._world.engine

    @property
    def hand_over(self) -> HandOver:
        """Why `fast` went on with `exact` since the rock was spawned; `none`: it did not."""
        return self._world.hand_over

    @property
    def has_rock(self) -> bool:
        """Whether a rock is on the scene."""
        return bool(self._world.has_rock)

    def spawn(self, start: Pose | None = None) -> None:
        """Put the rock at a pose of its model frame (default: the study's start), at rest.

        Raises:
            SimulationError: there is a rock already, or the pose is not usable.
        """
        pose = start or self.scene.rock.start
        body = self.scene.body_pose(pose)
        with refusals("spawn"):
            self._world.spawn_rock(
                position=np.asarray(body.position), orientation=np.asarray(body.orientation)
            )
        self._start = pose

    def delete(self) -> None:
        """Take the rock away.

        Raises:
            SimulationError: there is none.
        """
        with refusals("delete"):
            self._world.delete_rock()

    def reset(self) -> None:
        """Back to the start, bit for bit: a fresh world at time 0, the rock where it began."""
        _ = self._world  # refused once there is none
        self._begin(self._start)

    def save_state(self) -> SimulationState:
        """The present state, to go on from later with :meth:`restore_state`.

        It holds what was done since the world was built: about 72 bytes for each change of the
        set-point.

        Raises:
            SimulationError: more than 10 million time steps were made.
        """
        with refusals("save_state"):
            world = self._world.save_state()
        return SimulationState(self.scene.sha256, world, self._start, self._steps, self._command)

    def restore_state(self, state: SimulationState) -> None:
        """Go on from a saved state with the bits of a simulation that was not interrupted.

        The world is built again and repeats what led to the state, so this takes as long as
        simulating that did.

        Raises:
            SimulationError: not a state, or one of another scene or drive.
        """
        if not isinstance(state, SimulationState):
            raise SimulationError(
                f"restore_state: got a {type(state).__name__}; give what save_state returned"
            )
        if state.scene_sha256 != self.scene.sha256:
            raise SimulationError(
                f"restore_state: the state is of scene {state.scene_sha256[:12]}, this is scene "
                f"{self.scene.sha256[:12]}; restore it in a simulation of its own study"
            )
        with refusals("restore_state"):
            self._world.restore_state(state.world)
        self._start, self._steps, self._command = state.start, state.steps, state.command

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._held = None

    @checked_names(SimulationError)
    def step(
        self,
        position: float,
        velocity: float = 0.0,
        *,
        transverse: float = 0.0,
        vertical: float = 0.0,
        pitch: float = 0.0,
        steps: int = 1,
    ) -> State | None:
        """Advance towards a set-point of the pedestal and return the state (None without a rock).

        Args:
            position: where the pedestal should be at the end of each step [m].
            velocity: its speed there [m/s]; used by the drive `motor_position_velocity` only.
            transverse: displacement along y; `prescribed_spatial` only, as those that follow [m].
            vertical: displacement along z [m].
            pitch: turn about y on the pedestal's pitch axis [rad].
            steps: number of time steps.

        Raises:
            SimulationError: an unknown argument, a set-point that is not a finite number, one that
                the drive does not follow, or fewer than 1 step.
        """
        world, given = self._world, (position, velocity, transverse, vertical, pitch)
        if not all(
            isinstance(value, Real) and not isinstance(value, bool) and abs(value) <= MAX_SET_POINT
            for value in given
        ):
            raise SimulationError(
                f"step: the set-point {given} is not of finite numbers, or beyond "
                f"{MAX_SET_POINT:g} m or m/s; give numbers in m, m/s and rad"
            )
        position, velocity, transverse, vertical, pitch = map(float, given)
        if (transverse or vertical or pitch) and self.drive != "prescribed_spatial":
            raise SimulationError(
                f"step: the drive {self.drive} moves the pedestal along x only; use "
                "prescribed_spatial"
            )
        if pitch and self.scene.pitches:
            raise SimulationError(
                "step: the pedestal pitches on a spring and takes no set-points of pitch"
            )
        if not isinstance(steps, Integral) or isinstance(steps, bool) or steps < 1:
            raise SimulationError(f"step: steps must be a whole number of 1 or more, got {steps!r}")
        for _ in range(steps):
            world.step(
                position=position,
                velocity=velocity,
                transverse=transverse,
                vertical=vertical,
                pitch=pitch,
            )
        self._steps += int(steps)
        self._command = (position, velocity)
        if not self.has_rock:
            return None
        state = self.state
        if not np.isfinite(state.position).all() or not np.isfinite(state.velocity).all():
            raise SimulationError(
                "step: the rock's state became infinite or NaN; check contact stiffness, damping "
                "and the time step, then reset"
            )
        return state

    def settle(self, settling: Settling | None = None) -> float:
        """Hold the pedestal until the rock rests, as a trial does; returns the time it took [s].

        Args:
            settling: when it rests; None: as the study says, for a scene the defaults.

        Raises:
            SimulationError: no rock, or not at rest within `settling.timeout`.
        """
        rule = settling or self._settling
        if not self.has_rock:
            raise SimulationError("settle: there is no rock; spawn one first")
        steps, rests = self._world.settle(**rule.model_dump())
        self._steps += steps
        if rests:
            return steps * self.time_step
        raise SimulationError(
            f"settle: the rock did not come to rest within {rule.timeout:g} s; raise "
            "settling.timeout or the rest speeds, or start it nearer to equilibrium"
        )

    def set_rock_velocity(self, linear: Any, angular: Any = (0.0, 0.0, 0.0)) -> None:
        """Set the rock's velocities in the world, shapes (3,) [m/s] and (3,) [rad/s].

        Raises:
            SimulationError: there is no rock, or the values are not three finite real numbers each.
        """
        try:
            velocities = {
                name: real_array(values)
                for name, values in (("linear", linear), ("angular", angular))
            }
        except TypeError as error:
            raise SimulationError(f"set_rock_velocity: a velocity {error}") from None
        if any(v.shape != (3,) or not np.isfinite(v).all() for v in velocities.values()):
            raise SimulationError(
                f"set_rock_velocity: needs three finite numbers each, got {linear} and {angular}"
            )
        with refusals("set_rock_velocity"):
            self._world.set_rock_velocity(**velocities)

    @property
    def pedestal(self) -> tuple[float, float]:
        """Achieved position [m] and velocity [m/s] of the pedestal."""
        return self._world.pedestal

    @property
    def excursion(self) -> tuple[float, float, float]:
        """Of the pedestal beside x: along y and z [m], pitch about y [rad]."""
        return self._world.excursion

    @property
    def state(self) -> State:
        """The present state.

        Raises:
            SimulationError: there is no rock.
        """
        with refusals("state"):
            return State(self.time, *self._command, *self.pedestal, *self._world.rock)

    def contacts(self) -> list[dict[str, Any]]:
        """Contacts of the rock as the last solver step used them, one mapping each.

        Keys, as in the contact log (`vsr2.results.CONTACT_COLUMNS`), vectors in the world as arrays
        (3,): `rock_point`, `pedestal_point` [m], `normal` (from pedestal to rock), `distance`
        (negative: penetration) [m], `normal_impulse`, `lateral_impulse_1`, `lateral_impulse_2`
        over one solver step [N s], `lateral_direction_1`, `lateral_direction_2`; and the pair
        values in force.
        """
        return list(self._world.contacts())
