"""Results made by formula, for tests of what comes after the simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vsr2.results import CONTACT_COLUMNS, STATE_COLUMNS, TRIAL_COLUMNS, BatchResult, TrialLog
from vsr2.scene import Pose

Array = NDArray[np.float64]

CENTER_HEIGHT = 3.0
"""Height of the mass centre over the world's ground in `make_log` [m]."""


def about(axis: str, angles: Array | Sequence[float]) -> Rotation:
    """Rotations about a world axis by `angles` [rad]."""
    return Rotation.from_rotvec(np.outer(angles, np.eye(3)["xyz".index(axis)]))


def body_frame(
    axes: Rotation | None = None, mass_center: Sequence[float] = (0.0, 0.0, 0.0)
) -> Pose:
    """X_MB of principal axes (default: M's) and a mass centre [m]."""
    turn = Rotation.identity() if axes is None else axes
    return Pose(tuple(mass_center), tuple(turn.as_quat().tolist()))


def make_log(
    time: Array,
    *,
    command: Array | None = None,
    achieved: Array | None = None,
    rotations: Rotation | None = None,
    position: Array | None = None,
    settled: Rotation | None = None,
    frame: Pose | None = None,
    contacts: Array | None = None,
) -> TrialLog:
    """A log whose rock is at rest on a pedestal at rest, but for what is given.

    `rotations` are of the body frame B in the world, `position` is of the mass centre; `frame` is
    B in the model frame M (default: M).
    """
    count = len(time)
    zero = np.zeros(count)
    settled = Rotation.identity() if settled is None else settled
    frame = body_frame() if frame is None else frame
    state = np.zeros((count, len(STATE_COLUMNS)))
    state[:, 0] = time
    state[:, 1] = zero if command is None else command
    state[:, 2] = np.gradient(state[:, 1], time)
    state[:, 3] = state[:, 1] if achieved is None else achieved
    state[:, 4] = np.gradient(state[:, 3], time)
    if position is None:
        position = np.column_stack([state[:, 3], zero, zero + CENTER_HEIGHT])
    state[:, 5:8] = position
    state[:, 8:12] = settled.as_quat() if rotations is None else rotations.as_quat()
    return TrialLog(
        state=state,
        contacts=np.empty((0, len(CONTACT_COLUMNS))) if contacts is None else contacts,
        settled_position=np.array([0.0, 0.0, CENTER_HEIGHT]),
        settled_orientation=settled.as_quat(),
        foot=np.array([0.0, 0.0, -0.5]),
        mass_center=np.asarray(frame.position),
        principal_axes=np.asarray(frame.orientation),
    )


def falling_log(
    duration: float = 2.0, rows: int = 201, end: float = 1.5, seed: int | None = None
) -> TrialLog:
    """A rock that tilts about y to `end` [rad] while the pedestal makes one cosine."""
    time = np.linspace(0.0, duration, rows)
    command = 0.1 * (1 - np.cos(2 * np.pi * time / duration))
    rotations = about("y", end * np.sin(0.5 * np.pi * time / duration) ** 2)
    contacts = None
    if seed is not None:
        contacts = np.random.default_rng(seed).normal(size=(3 * rows, len(CONTACT_COLUMNS)))
        contacts[:, 0] = np.repeat(time, 3)
        contacts[:, 1:3] = 0.3 * contacts[:, 1:3]
        contacts[:, 3] = CENTER_HEIGHT - 0.5
        contacts[:, 4:7] = contacts[:, 1:4]
        contacts[:, 7:10] = (0.0, 0.0, 1.0)
        contacts[:, 11] = np.abs(contacts[:, 11])
    return make_log(time, command=command, rotations=rotations, contacts=contacts)


def make_trials(count: int, **columns: object) -> dict[str, NDArray[np.generic]]:
    """Columns of `BatchResult.trials` for `count` stable trials, but for what is given."""
    defaults: dict[str, object] = {
        "trial": np.arange(count, dtype=np.int64),
        "name": np.array([f"trial {i}" for i in range(count)], dtype=object),
        "motion": np.array([f"motion_{i}" for i in range(count)], dtype=object),
        "motion_sha256": np.array(["0" * 64] * count, dtype=object),
        "seed": np.arange(count, dtype=np.int64),
        "status": np.array(["ok"] * count, dtype=object),
        "outcome": np.array(["stable"] * count, dtype=object),
        "engine": np.array(["parity"] * count, dtype=object),
        "hand_over": np.array(["none"] * count, dtype=object),
        "message": np.array([""] * count, dtype=object),
        "steps": np.full(count, 1000, dtype=np.int64),
        "overturning_time": np.full(count, np.nan),
    }
    defaults |= columns
    return {
        name: np.asarray(defaults.get(name, np.linspace(0.1, 1.0, count))) for name in TRIAL_COLUMNS
    }


def make_result(
    logs: Sequence[TrialLog | None],
    *,
    provenance: dict[str, object] | None = None,
    **columns: object,
) -> BatchResult:
    """A result with these logs."""
    return BatchResult(make_trials(len(logs), **columns), tuple(logs), provenance or {})
