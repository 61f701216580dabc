"""The rock on its table in MuJoCo, as the benchmarks step it.

A table that moves along x without turning is a frame in which the rock feels the inertial force
-m a at its mass centre and nothing else is changed. So the table stands still here, as MuJoCo's
fixed plane, and the force is applied. This is exact, and it is the cheapest that MuJoCo has: six
degrees of freedom instead of seven, the collision of a mesh with a plane instead of a box, one
number written a step. Speed is favoured wherever there is a choice: contacts have MuJoCo's default
three dimensions, all options are its defaults, and the steps are run by `mujoco.rollout`, without
Python between them.

A table moved as a mocap body would not do: it has no velocity in MuJoCo and carries nothing by
friction. :meth:`MujocoRock.follow` shows that the rock is shaken, from contact forces alone.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.motion import Motion
from vsr2.scene import Box, Scene
from vsr2.simulation import native_scene

Array = NDArray[np.float64]
FALLEN = 0.35
"""Tilt from the start beyond which a rock counts as overturned, as `outcome.toppled_tilt` [rad]."""
FORCE = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS.value


class MujocoRock:
    """A scene of one convex rock on a flat top, settled.

    Attributes:
        model: MuJoCo's, with a free joint at the mass centre and a fixed plane.
        mass: [kg].
        rest: full physics state of the settled rock, shape (n,).
    """

    def __init__(self, scene: Scene) -> None:
        self.mass = scene.rock.mass.mass
        self.model = mujoco.MjModel.from_xml_string(model_text(scene))
        data = mujoco.MjData(self.model)
        _settle(self.model, data)
        self.rest = np.empty(mujoco.mj_stateSize(self.model, FULL))
        mujoco.mj_getState(self.model, data, self.rest, FULL)

    def forces(self, motion: Motion) -> Array:
        """Generalised forces of every step, shape (samples - 1, 6) [N], [N m].

        The table goes straight from sample to sample, as the drive `prescribed` moves it; a step's
        acceleration is the change of that velocity.
        """
        step = self.model.opt.timestep
        velocity = np.diff(motion.displacement, prepend=motion.displacement[0]) / step
        out = np.zeros((motion.displacement.size - 1, 6))
        out[:, 0] = -self.mass * np.diff(velocity) / step
        return out

    def follow(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Where table and rock go in the world, and how far the rock tilts.

        The rock's way is integrated from the contact forces alone, as they move it in a frame at
        rest: v' = F / m. A rock that is not shaken goes nowhere.

        Returns:
            Displacement of table [m] and mass centre [m] along x, tilt away from the start [rad],
            after every step, each of shape (samples - 1,).
        """
        data = self._started()
        step = self.model.opt.timestep
        start = data.qpos[3:].copy()
        forces = self.forces(motion)
        rock, tilts = np.empty(len(forces)), np.empty(len(forces))
        place = speed = 0.0
        for k, force in enumerate(forces):
            data.qfrc_applied[:] = force
            mujoco.mj_step(self.model, data)
            speed += step * data.qfrc_constraint[0] / self.mass
            place += step * speed
            rock[k], tilts[k] = place, tilt(data.qpos[3:], start)
        return motion.displacement[1:], rock, tilts

    def seconds(self, motion: Motion) -> float:
        """CPU time of a step, all steps run by `mujoco.rollout` on the calling thread [s]."""
        data, forces = self._started(), self.forces(motion)[None]
        state = np.zeros((1, forces.shape[1], self.rest.size))
        begin = time.process_time()
        mujoco.rollout.rollout(
            self.model, data, self.rest[None], forces, control_spec=FORCE, state=state
        )
        return (time.process_time() - begin) / int(forces.shape[1])

    def overturned(self, forces: Sequence[Array], threads: int, *, segment: int = 1000) -> int:
        """Run motions by `mujoco.rollout` and count the rocks that fall.

        Rollouts have one length. So they go on a segment at a time, and trials that have fallen or
        come to the end of their motion are dropped in between. Nothing is run after a motion.

        Args:
            forces: of each motion, as :meth:`forces` gives them, of any lengths.
            threads: of MuJoCo's own pool.
            segment: steps of a rollout; the last one of a motion is filled up by rest.
        """
        datas = [mujoco.MjData(self.model) for _ in range(threads)]
        waiting = list(forces)
        start = self.rest[4:8]
        fallen = 0
        with mujoco.rollout.Rollout(nthread=threads) as pool:
            states = np.tile(self.rest, (len(waiting), 1))
            taken = 0
            while waiting:
                length = min(segment, max(len(force) for force in waiting) - taken)
                control = np.zeros((len(waiting), length, 6))
                for row, force in zip(control, waiting, strict=True):
                    part = force[taken : taken + length]
                    row[: len(part)] = part
                ways, _ = pool.rollout(self.model, datas, states, control, control_spec=FORCE)
                states, taken = ways[:, -1], taken + length
                down = np.array([tilt(state[4:8], start) > FALLEN for state in states])
                ended = np.array([len(force) <= taken for force in waiting])
                fallen += int(down.sum())
                kept = ~(down | ended)
                waiting = [force for force, on in zip(waiting, kept, strict=True) if on]
                states = states[kept]
        return fallen

    def _started(self) -> Any:
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, data, self.rest, FULL)
        return data


def tilt(orientation: Array, start: Array) -> float:
    """Angle between the vertical of the start, carried along, and the vertical [rad].

    Args:
        orientation: quaternion w, x, y, z, shape (4,).
        start: the same, of the start.
    """
    w, x, y, z = start
    turned = np.empty(4)
    mujoco.mju_mulQuat(turned, orientation, np.array([w, -x, -y, -z]))
    return float(np.arccos(np.clip(1 - 2 * (turned[1] ** 2 + turned[2] ** 2), -1.0, 1.0)))


def model_text(scene: Scene) -> str:
    """MuJoCo's XML of the scene: a box is a box, any other rock the hull that VSR2 uses."""
    rock, pose = scene.rock, scene.body_pose(scene.rock.start)
    rock_values, pedestal_values = (
        _native.ContactValues(**one.model_dump())
        for one in (scene.contact.rock, scene.contact.pedestal)
    )
    friction = _native.combine(a=rock_values, b=pedestal_values).lateral_friction
    x, y, z, w = pose.orientation
    asset = ""
    if len(rock.parts) == 1 and isinstance(rock.parts[0], Box):
        # The body's axes are the principal ones: the box's own, and its centre the origin.
        shape = f'type="box" size="{_row(_half_size(scene))}"'
    else:
        vertices = native_scene(scene).rock_hull_vertices
        asset = f'<asset><mesh name="rock" vertex="{_row(vertices.ravel())}"/></asset>'
        shape = 'type="mesh" mesh="rock"'
    return f"""
    <mujoco>
      <option timestep="{scene.engine.time_step!r}" gravity="0 0 {-scene.engine.gravity!r}"/>
      {asset}
      <worldbody>
        <geom type="plane" size="5 5 1" pos="0 0 {scene.pedestal.top!r}" friction="{friction!r}"/>
        <body pos="{_row(pose.position)}" quat="{_row((w, x, y, z))}">
          <freejoint/>
          <inertial pos="0 0 0" mass="{rock.mass.mass!r}"
            diaginertia="{_row(rock.mass.principal_inertia)}"/>
          <geom {shape} friction="{friction!r}"/>
        </body>
      </worldbody>
    </mujoco>"""


def _half_size(scene: Scene) -> Array:
    """Of the box along the body's axes, shape (3,) [m]."""
    size = np.ptp(native_scene(scene).rock_hull_vertices, axis=0)
    return np.asarray(0.5 * size, dtype=np.float64)


def _row(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def _settle(model: Any, data: Any, duration: float = 1.0) -> None:
    """Let the rock come to rest; its velocity is taken away slowly, so that it does not rock on."""
    for _ in range(round(duration / model.opt.timestep)):
        mujoco.mj_step(model, data)
        data.qvel *= 0.95
    data.qvel[:] = 0
