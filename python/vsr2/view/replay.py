"""A trial as a sequence of poses to draw."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.config.load import study_from_mapping
from vsr2.errors import ResultError, Vsr2Error
from vsr2.one_line import counted
from vsr2.results import (
    BatchResult,
    TrialLog,
    load_models,
    load_result,
    load_trial_log,
    logged_trials,
)
from vsr2.results.result_folder import MODEL_FOLDER
from vsr2.results.trial_log import CONTACT_NORMAL, CONTACT_TIME, NORMAL_IMPULSE, ROCK_POINT
from vsr2.scene import Triangles, build_scene
from vsr2.scene.rotation import rotate
from vsr2.scene.shapes import pedestal_surface

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """One trial, ready to be drawn.

    Attributes:
        title: what is shown.
        log: its log, cut where the state stops being finite.
        rock: surface in the model frame M [m].
        pedestal: surface in the world, the pedestal at its start [m].
        solver_step: over which logged impulses are [s]; None: unknown, and so are forces.
    """

    title: str
    log: TrialLog
    rock: Triangles
    pedestal: Triangles
    solver_step: float | None = None

    @property
    def time(self) -> Array:
        """Time of each row, shape (n,) [s]."""
        return self.log.time

    @cached_property
    def rock_orientation(self) -> Array:
        """q_WM of each row, x, y, z, w, unit length, shape (n, 4)."""
        q = self.log.orientation
        unit: Array = q / np.linalg.norm(q, axis=1, keepdims=True)
        return unit

    @cached_property
    def rock_position(self) -> Array:
        """Origin of M in the world at each row, p_WM = p_WB - R_WM p_MB, shape (n, 3) [m]."""
        arm = np.broadcast_to(self.log.mass_center, self.log.position.shape)
        return self.log.position - rotate(self.rock_orientation, arm)

    @cached_property
    def pedestal_orientation(self) -> Array:
        """Turn of the pedestal from its start at each row, x, y, z, w, shape (n, 4)."""
        half = 0.5 * self.log.pedestal_pitch
        zero = np.zeros_like(half)
        return np.stack([zero, np.sin(half), zero, np.cos(half)], axis=-1)

    @cached_property
    def pedestal_position(self) -> Array:
        """Where the pedestal's start frame, the world's at first, lies at each row, (n, 3) [m]."""
        moved = self.log.pedestal_travel
        if not len(self.log.excursions):
            return moved
        pivot = np.broadcast_to(self.log.pivot, moved.shape)
        return moved + pivot - rotate(self.pedestal_orientation, pivot)

    @cached_property
    def tilt(self) -> Array:
        """Tilt at each row, shape (n,) [rad]."""
        return self.log.tilt

    def row(self, time: float) -> int:
        """Index of the row nearest to `time` [s]."""
        return int(np.argmin(np.abs(self.time - time)))

    @cached_property
    def _contact_times(self) -> tuple[Array, float]:
        """Times at which contacts were found, and the time for which such a row stands [s]."""
        times = np.unique(self.log.contacts[:, CONTACT_TIME])
        between = np.diff(times)
        # Without a contact there is no row, so the shortest interval is the logging's own.
        return times, float(between.min()) if between.size else 0.0

    def _contact_rows(self, time: float) -> Array:
        """Rows of the contacts last logged at `time` [s]; none where the rock is in the air."""
        times, validity = self._contact_times
        last = int(np.searchsorted(times, time + 1e-9, side="right")) - 1
        if last < 0 or time - times[last] > max(validity, 1e-9) * (1 - 1e-6):
            return self.log.contacts[:0]
        found: Array = self.log.contacts[self.log.contacts[:, CONTACT_TIME] == times[last]]
        return found

    def contacts(self, time: float) -> Array:
        """Contact points on the rock last logged at `time` [s], in the world, shape (k, 3) [m]."""
        points: Array = self._contact_rows(time)[:, ROCK_POINT]
        return points

    def contact_forces(self, time: float) -> Array:
        """Normal forces on the rock at :meth:`contacts`, in the world, shape (k, 3) [N]."""
        rows = self._contact_rows(time)
        return self._forces(rows)

    def _forces(self, rows: Array) -> Array:
        if self.solver_step is None:
            return np.zeros((len(rows), 3))
        forces: Array = rows[:, CONTACT_NORMAL] * rows[:, NORMAL_IMPULSE, None] / self.solver_step
        return forces

    @cached_property
    def usual_force(self) -> float:
        """Median over logged times of the size of all contact forces together [N]; 0: none."""
        times, member = np.unique(self.log.contacts[:, CONTACT_TIME], return_inverse=True)
        sums = np.zeros((len(times), 3))
        np.add.at(sums, member.ravel(), self._forces(self.log.contacts))
        return float(np.median(np.linalg.norm(sums, axis=1))) if len(times) else 0.0


def load_replay(folder: str | os.PathLike[str], trial: int | None = None) -> Replay:
    """Make one trial of a result folder ready to be drawn.

    Args:
        folder: written by `vsr2 run` or `save_result`.
        trial: its index; default: the first that has a log.

    Raises:
        ResultError: the folder cannot be read, or the trial has no log.
        GeometryError, ConfigError: the folder holds no models and the study's cannot be read.
    """
    result = load_result(folder, logs=False)
    trial = choose_trial(folder, result, trial)
    log = _finite_part(load_trial_log(folder, trial), trial)
    rock, pedestal = _models(Path(folder), result.provenance)
    step = _solver_step(result.provenance)
    return Replay(trial_title(result, trial), log, rock, pedestal, step)


def _solver_step(provenance: Mapping[str, Any]) -> float | None:
    """Of the study that a result is of [s]; None: it is of none, as a batch made by hand."""
    study = provenance.get("study")
    if not isinstance(study, Mapping) or not isinstance(study.get("engine"), Mapping):
        return None
    engine = study["engine"]
    return float(engine["time_step"]) / int(engine["substeps"])


def choose_trial(folder: str | os.PathLike[str], result: BatchResult, trial: int | None) -> int:
    """The trial to show: as asked, or the first that has a log.

    Raises:
        ResultError: it has no log; names those that have.
    """
    logged = logged_trials(folder)
    if not logged:
        raise ResultError(
            f"{folder}: no trial has a log; set output.log_every to 1 or more and run again"
        )
    if trial is None:
        return logged[0]
    if trial not in logged:
        known = f"the result has {counted(len(result), 'trial')}, counted from 0"
        if 0 <= trial < len(result):
            known = f"it has no log; trials with one: {', '.join(map(str, logged[:20]))}"
        raise ResultError(f"{folder}: trial {trial} cannot be shown: {known}")
    return trial


def trial_title(result: BatchResult, trial: int) -> str:
    """Index, name and outcome of a trial, for a heading."""
    name = "".join(c if c.isprintable() else "?" for c in str(result["name"][trial]))
    return f"trial {trial}: {name}, {result['outcome'][trial]}"


def _finite_part(log: TrialLog, trial: int) -> TrialLog:
    bad = np.flatnonzero(~np.isfinite(log.state).all(axis=1))
    if not bad.size and len(log.state):
        return log
    rows = int(bad[0]) if bad.size else 0
    if rows == 0:
        raise ResultError(f"trial {trial}: the log has no finite state to show")
    return replace(
        log,
        state=log.state[:rows],
        contacts=log.contacts[log.contacts[:, CONTACT_TIME] <= log.time[rows - 1]],
        excursions=log.excursions[:rows],
    )


def _models(folder: Path, provenance: Mapping[str, Any]) -> tuple[Triangles, Triangles]:
    """Those kept with the result; where there are none, built from its study again."""
    if any((folder / MODEL_FOLDER).glob("*.npz")):
        return load_models(folder)
    settings = provenance.get("study")
    if not isinstance(settings, Mapping):
        raise ResultError(
            f"{folder / MODEL_FOLDER}: holds no models and the provenance names no study; keep "
            "them with save_models when a batch is made by hand"
        )
    try:
        scene = build_scene(study_from_mapping(settings, folder, label=f"study in {folder}"))
    except Vsr2Error as error:
        raise type(error)(
            f"{folder / MODEL_FOLDER}: holds no models, nor can the study's be read: {error}"
        ) from error
    if scene.rock.surface is None:
        raise ResultError(f"{folder}: the study's rock has no surface to draw")
    return scene.rock.surface, scene.pedestal_surface or pedestal_surface(scene.pedestal)
