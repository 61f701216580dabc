"""One trial: the body settles, the table moves, the body stands or overturns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco.driven_table import drive
from vsr2.blind.mujoco.model import MODEL, build_model
from vsr2.blind.mujoco.rigid_body import GRAVITY
from vsr2.blind.mujoco.situation import Situation
from vsr2.blind.mujoco.step_actions import RelativeMotion, step_actions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrialConstants:
    """When a trial begins and ends; chosen by hand.

    Attributes:
        fallen: tilt from which nothing comes back [rad].
        stop: tilt from the vertical at which a trial ends [rad], so that `fallen` is seen to be
            passed.
        tail: longest time after the motion [s].
        settling: for which the body settles before the motion [s].
        kept_speed: while it settles, share of its speed that is left after `kept_after`.
        kept_after: see there [s].
        leaning: tilt at the end, over the slenderness angle, from which it has overturned.
        look: between two looks whether a trial has ended [s].
        calm: looks in a row that find the body at rest, as it may pause for one where it turns
            back.
        slow: speed below which it is at rest [m/s], [rad/s].
        series_interval: of the series, where none is asked for [s].
    """

    fallen: float = 1.2
    stop: float = 1.3
    tail: float = 5.0
    settling: float = 0.3
    kept_speed: float = 0.95
    kept_after: float = 1e-3
    leaning: float = 0.5
    look: float = 0.05
    calm: int = 5
    slow: float = 3e-3
    series_interval: float = 0.02


TRIAL = TrialConstants()


@dataclass(frozen=True, eq=False)
class Response:
    """What a trial gave.

    Attributes:
        overturned: it fell, or leant beyond half its slenderness angle at the end.
        peak_tilt: [rad]; of a trial that fell, more than `TRIAL.fallen`.
        time: of the series, shape (n,) [s]; 0 is the motion's first sample.
        tilt: between the body's vertical at rest and the vertical, shape (n,) [rad].
        position: travel of the mass centre, shape (n, 3) [m].
        orientation: away from the rest, quaternions x, y, z, w, shape (n, 4).
    """

    overturned: bool
    peak_tilt: float
    time: Array
    tilt: Array
    position: Array
    orientation: Array


def run_trial(situation: Situation, *, series_interval: float = TRIAL.series_interval) -> Response:
    """Simulate one trial.

    Args:
        situation: the body and the table's motion.
        series_interval: of the series [s], a multiple of the contact model's step.
    """
    import mujoco

    model, step = build_model(situation), situation.contact.step
    data = mujoco.MjData(model)
    channels, used = situation.table.channels, list(situation.table.channels)
    driven = [drive(samples, situation.table.interval, step) for samples in channels.values()]
    positions, velocities, accelerations = (
        np.ascontiguousarray(np.stack(kind, axis=1)) for kind in zip(*driven, strict=True)
    )
    tail = round(TRIAL.tail / step)
    moving = len(positions)
    joints = len(used)
    relative = RelativeMotion(data, used, situation.table.pivot)
    _settle(model, data, situation, positions[0])
    rest = data.qpos[joints:].copy()
    first = _release(situation, used, positions, accelerations)
    rows = np.empty((moving + tail, 7))
    rows[:first] = _carried(situation, used, rest, positions[:first])
    if first:
        last_held = min(first, moving - 1)
        data.qpos[:joints], data.qvel[:joints] = positions[last_held], velocities[last_held]
        data.qpos[joints:] = _carried(situation, used, rest, positions[[last_held]])[0]
        data.qvel[joints:] = relative.table()
    path = (positions, velocities, accelerations * MODEL.table_mass)
    actions = step_actions(situation, model, data, relative)
    last = _shake(model, data, path, rows, first, actions, round(TRIAL.look / step))
    return _judged(rows[:last], rest, situation, round(series_interval / step), step)


def _settle(model: Any, data: Any, situation: Situation, table: Array) -> None:
    import mujoco

    joints = len(table)
    lift = max((height for _, _, height in situation.bumps), default=0.0)
    data.qpos[:joints] = table
    half = situation.yaw / 2
    x, y = situation.offset
    height = float(situation.body.center[2]) + lift
    data.qpos[joints:] = [x, y, height, math.cos(half), 0, 0, math.sin(half)]
    for _ in range(round(TRIAL.settling / situation.contact.step)):
        mujoco.mj_step(model, data)
        data.qpos[:joints] = table
        data.qvel[:joints] = 0
        data.qvel *= TRIAL.kept_speed ** (situation.contact.step / TRIAL.kept_after)
    data.qvel[:] = 0


def _release(situation: Situation, used: list[Any], positions: Array, accelerations: Array) -> int:
    """Step at which the bond under the base breaks; 0: there is none.

    The bond holds until the base lifts about its edge: at the moment
    (N + strength A) b, b from the mass centre to the edge, A the base's area, N the weight. On a
    table that pitches by theta about y the mass centre, R above its pivot, is accelerated along the
    table by x'' + R theta'' against g theta, and the body turned by theta''; a slope leans the
    weight to +x. Asperities, which move the edge, are left out.
    """
    if situation.adhesion <= 0:
        return 0
    body = situation.body
    slope = situation.slope[0]
    along = accelerations[:, used.index("x")] - GRAVITY * math.sin(slope)
    normal = np.full(len(accelerations), GRAVITY * math.cos(slope))
    turning = np.zeros(len(accelerations))
    if "z" in used:
        normal += accelerations[:, used.index("z")]
    if "pitch" in used:
        pitch = used.index("pitch")
        height = situation.table.pivot + float(body.center[2])
        along += height * accelerations[:, pitch] - GRAVITY * np.sin(positions[:, pitch])
        turning = float(body.inertia[1, 1]) * accelerations[:, pitch]
    held = body.mass * normal + situation.adhesion * body.base_area
    moment = body.mass * along * body.center[2] + turning
    back, front = (lever - situation.rounding for lever in body.levers)
    over = np.flatnonzero((moment > held * back) | (-moment > held * front))
    return int(over[0]) if over.size else len(accelerations)


def _carried(situation: Situation, used: list[Any], rest: Array, positions: Array) -> Array:
    """Poses of the body that moves with the table, shape (n, 7).

    Args:
        situation: with the height of the pivot of pitch.
        used: channels of the table.
        rest: pose at the table's rest.
        positions: of the table, shape (n, channels).
    """
    out = np.tile(rest, (len(positions), 1))
    if "pitch" in used:
        angle = positions[:, used.index("pitch")]
        height = rest[2] + situation.table.pivot
        out[:, 0] = rest[0] * np.cos(angle) + height * np.sin(angle)
        out[:, 2] = height * np.cos(angle) - rest[0] * np.sin(angle) - situation.table.pivot
        c, s = np.cos(angle / 2), np.sin(angle / 2)
        w, x, y, z = rest[3:]
        # the turn about y, (c, 0, s, 0), times the rest's
        out[:, 3:] = np.stack([c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x], axis=1)
    for i, channel in enumerate(used):
        if channel != "pitch":
            out[:, "xyz".index(channel)] += positions[:, i]
    return out


def _shake(
    model: Any,
    data: Any,
    path: tuple[Array, Array, Array],
    rows: Array,
    first: int,
    actions: list[Callable[[int], None]],
    look: int,
) -> int:
    """Fill `rows` with the body's poses; returns how many."""
    import mujoco

    positions, velocities, forces = path
    moving, joints = positions.shape
    table_q, table_v = data.qpos[:joints], data.qvel[:joints]
    table_f = data.qfrc_applied[:joints]
    pose, speed = data.qpos[joints:], data.qvel[joints:]
    hold = positions[-1].copy()
    calm = 0
    for i in range(first, len(rows)):
        if i < moving:
            table_q[:] = positions[i]
            table_v[:] = velocities[i]
            table_f[:] = forces[i]
        else:
            table_q[:] = hold
            table_v[:] = 0.0
            table_f[:] = 0.0
        rows[i] = pose
        for action in actions:
            action(i)
        mujoco.mj_step(model, data)
        for action in actions:
            action(-1)
        if i % look == 0:
            # z component of the body's own vertical
            if 1 - 2 * (pose[4] ** 2 + pose[5] ** 2) < math.cos(TRIAL.stop):
                return i + 1
            calm = calm + 1 if i > moving and np.abs(speed).max() < TRIAL.slow else 0
            if calm == TRIAL.calm:
                return i + 1
    return len(rows)


def _judged(rows: Array, rest: Array, situation: Situation, every: int, step: float) -> Response:
    orientation = _away(rows[:, 3:], rest[3:])
    tilt: Array = np.arccos(
        np.clip(1 - 2 * (orientation[:, 0] ** 2 + orientation[:, 1] ** 2), -1.0, 1.0)
    )
    peak = float(tilt.max())
    leaning = TRIAL.leaning * situation.body.slenderness_angle
    fallen = peak >= TRIAL.fallen or tilt[-1] > leaning
    kept = slice(None, None, every)
    return Response(
        overturned=bool(fallen),
        peak_tilt=peak,
        time=np.arange(len(rows), dtype=np.float64)[kept] * step,
        tilt=tilt[kept],
        position=(rows[:, :3] - rest[:3])[kept],
        orientation=orientation[kept],
    )


def _away(turned: Array, rest: Array) -> Array:
    """Turn away from the rest, q q0* of MuJoCo's w, x, y, z, as x, y, z, w."""
    from scipy.spatial.transform import Rotation

    order = [1, 2, 3, 0]
    away = Rotation.from_quat(turned[:, order]) * Rotation.from_quat(rest[order]).inv()
    quaternions: Array = away.as_quat()
    return quaternions
