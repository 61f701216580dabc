"""Mechanics that MuJoCo does not have, added between its steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco.driven_table import Channel
from vsr2.blind.mujoco.rigid_body import GRAVITY
from vsr2.blind.mujoco.situation import Situation

Array = NDArray[np.float64]
Action = Callable[[int], None]


@dataclass(frozen=True)
class MechanismConstants:
    """How mechanics act between steps; chosen by hand.

    Attributes:
        apart: time without contact after which a touch is an impact [s].
        impact: time that an impact takes, over the contact's time constant.
        resting: energy per mass below which a touch is no impact [J/kg]: slower than 3 mm/s a body
            is at rest as far as anybody can see.
        full: share of Housner's loss from which an impact is a full one.
        uplifted: tilt from which a body rocks [rad].
        catch_stiffness: of the tether, in m g R per radian: it holds a body within 1/40 rad.
    """

    apart: float = 0.005
    impact: float = 1.5
    resting: float = 0.5e-5
    full: float = 0.7
    uplifted: float = 1e-3
    catch_stiffness: float = 40.0


MECHANISMS = MechanismConstants()


def step_actions(
    situation: Situation, model: Any, data: Any, moving: RelativeMotion
) -> list[Action]:
    """What acts around each step of a situation; called with its number before, -1 after."""
    out: list[Action] = []
    if situation.impact_energy_ratio != 1:
        out.append(_Impacts(situation, data, moving))
    if situation.rocking_damping > 0:
        out.append(rocking_damping(situation, moving))
    if situation.catch_slack is not None:
        out.append(catch(situation, data, moving, situation.catch_slack))
    if situation.friction_ratio != 1:
        out.append(friction(situation, model, moving))
    return out


class RelativeMotion:
    """The body's velocity relative to the table, as a rigid body that moves on with it."""

    def __init__(self, data: Any, used: list[Channel], pivot: float) -> None:
        joints = len(used)
        self.pose = data.qpos[joints:]
        self.speed = data.qvel[joints:]
        self._table_q, self._table_v = data.qpos[:joints], data.qvel[:joints]
        self._slides = [
            (i, "xyz".index(channel)) for i, channel in enumerate(used) if channel != "pitch"
        ]
        self._pitch = joints - 1 if "pitch" in used else None
        self._pivot = pivot

    def table(self) -> Array:
        """Velocity of the table's rigid motion at the mass centre; turning in body axes."""
        out = np.zeros(6)
        for i, axis in self._slides:
            out[axis] = self._table_v[i]
        if self._pitch is not None:
            rate = float(self._table_v[self._pitch])
            out[0] += rate * (self.pose[2] + self._pivot)
            out[2] -= rate * (self.pose[0] - self._table_q[0])
            out[3:] = rate * _rotation(self.pose)[1]  # the world's y axis in body axes
        return out

    def tilt(self) -> float:
        """Of the body from the vertical [rad]."""
        return 2 * math.asin(min(1.0, math.hypot(self.pose[4], self.pose[5])))


def _rotation(pose: Array) -> Array:
    """Of a pose (x, y, z, then quaternion w, x, y, z) from body axes to the world's, (3, 3)."""
    w, x, y, z = pose[3:]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class _Impacts:
    """Scales the body's velocity after each impact.

    An impact begins when a point touches that was off the table, and lasts milliseconds. Where the
    body lost the share L of its kinetic energy and a full impact takes L_H (Housner's), the energy
    is then multiplied by ratio^min(1, L / (0.7 L_H)): all of the ratio for a full impact, of which
    a part may come after them, next to nothing for the touch of one corner after the other.
    """

    def __init__(self, situation: Situation, data: Any, motion: RelativeMotion) -> None:
        self._data = data
        self._motion = motion
        self._ratio = situation.impact_energy_ratio
        body = situation.body
        self._full = 1 - body.housner_ratio
        self._mass, self._inertia = body.mass, body.inertia
        contact = situation.contact
        self._apart = round(MECHANISMS.apart / contact.step)
        self._lasting = round(MECHANISMS.impact * contact.time_constant / contact.step)
        self._left: dict[int, int] = {}
        self._touching: frozenset[int] = frozenset()
        self._before = np.zeros(6)
        self._step = 0
        self._due: tuple[int, float] | None = None

    def _energy(self, speed: Array) -> float:
        v, w = speed[:3], speed[3:]
        return 0.5 * float(self._mass * v @ v + w @ self._inertia @ w)

    def __call__(self, step: int) -> None:
        if step >= 0:
            self._step = step
            self._before[:] = self._motion.speed
            return
        now = self._step
        count = self._data.ncon
        if count != len(self._touching) or count < 4:
            touching = frozenset(self._data.contact.geom.max(axis=1).tolist())
            if touching != self._touching:
                for geom in self._touching - touching:
                    self._left[geom] = now
                fresh = touching - self._touching
                self._touching = touching
                if self._due is None and any(
                    now - self._left.get(geom, now) > self._apart for geom in fresh
                ):
                    energy = self._energy(self._before - self._motion.table())
                    if energy > MECHANISMS.resting * self._mass:
                        self._due = (now + self._lasting, energy)
        if self._due is not None and now >= self._due[0]:
            carried = self._motion.table()
            relative = self._motion.speed - carried
            lost = 1 - self._energy(relative) / self._due[1]
            share = min(1.0, max(0.0, lost / (MECHANISMS.full * self._full)))
            self._motion.speed[:] = carried + self._ratio ** (0.5 * share) * relative
            self._due = None


def rocking_damping(situation: Situation, moving: RelativeMotion) -> Action:
    """Takes 2 zeta p of the relative velocity a second while the body rocks; p^2 = m g R / I_O."""
    body = situation.body
    frequency = math.sqrt(body.mass * GRAVITY * body.radius / body.pivot_inertia)
    factor = math.exp(-2 * situation.rocking_damping * frequency * situation.contact.step)

    def act(number: int) -> None:
        if number < 0 and moving.tilt() > MECHANISMS.uplifted:
            carried = moving.table()
            moving.speed[:] = carried + factor * (moving.speed - carried)

    return act


def catch(situation: Situation, data: Any, moving: RelativeMotion, slack: float) -> Action:
    """A tether that turns the body back beyond its slack, sprung and critically damped."""
    body = situation.body
    stiffness = MECHANISMS.catch_stiffness * body.mass * GRAVITY * body.radius
    damping = 2 * math.sqrt(stiffness * body.pivot_inertia)
    torque = data.xfrc_applied[2, 3:]

    def act(number: int) -> None:
        if number < 0:
            return
        tilt = moving.tilt()
        if tilt <= slack:
            torque[:] = 0
            return
        turn = _rotation(moving.pose)
        # the axis about which the body's vertical leans: world z cross body z
        axis = np.array([-turn[1, 2], turn[0, 2], 0.0])
        axis /= np.linalg.norm(axis)
        rate = float(axis @ turn @ moving.speed[3:])
        torque[:] = -(stiffness * (tilt - slack) + damping * max(rate, 0.0)) * axis

    return act


def friction(situation: Situation, model: Any, moving: RelativeMotion) -> Action:
    """Friction that falls from static to kinetic with the slip of the lowest point."""
    slide = model.geom_friction[:, 0]
    excess = situation.friction * (situation.friction_ratio - 1)
    points = situation.body.points - situation.body.center

    def act(number: int) -> None:
        if number < 0:
            return
        relative = moving.speed - moving.table()
        turn = _rotation(moving.pose)
        arms = points @ turn.T
        arm = arms[arms[:, 2].argmin()]
        slip = relative[:3] + np.cross(turn @ relative[3:], arm)
        speed = math.hypot(slip[0], slip[1])
        slide[:] = situation.friction + excess * math.exp(-speed / situation.friction_speed)

    return act
