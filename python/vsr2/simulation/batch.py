"""Many independent trials in native threads."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import signal
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.config import Study, load_study
from vsr2.config.study import Outcome, Output, Settling
from vsr2.effects import Applied, Observation, chosen
from vsr2.errors import SimulationError
from vsr2.motion import Motion, build_motions
from vsr2.results import (
    CONTACT_COLUMNS,
    INTEGER_COLUMNS,
    STATE_COLUMNS,
    TEXT_COLUMNS,
    TRIAL_COLUMNS,
    BatchResult,
    Journal,
    TrialLog,
    base_provenance,
    load_trial_log,
    remove_temporaries,
    require_space,
    save_trial_log,
)
from vsr2.scene import Pose
from vsr2.simulation.scene import Scene, build_scene

if TYPE_CHECKING:
    import distributed

Array = NDArray[np.float64]

MAX_LOG_BYTES = 2e9
"""Greatest state log of one trial that is accepted."""
POLL = 0.1
"""How often finished trials are collected and Ctrl-C is noticed [s]."""
MAX_AHEAD = 1024
"""Most trials that the core holds, waiting, running or not yet taken."""
MAX_AHEAD_BYTES = 2**28
"""Most that their logs can take, unless two trials a thread take more [byte]."""

_KEPT_SAMPLES_BYTES = 2**28
_KEPT_STARTS = 4096
_CONTACTS_A_ROW = 4
_ROW_BYTES = 256
"""Least size of a trial's row, in the journal and in the table."""

_FLOAT_COLUMNS = (
    "settling_time",
    "simulated_time",
    "overturning_time",
    "peak_tilt",
    "final_tilt",
    "final_slip",
    "final_yaw",
    "peak_tracking_error",
)
_RESULT_COLUMNS = (*_FLOAT_COLUMNS, "status", "outcome", "message", "engine", "steps")


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of one scene under one motion.

    Attributes:
        scene: what is shaken.
        motion: how; its time step must be the scene's. One that goes beside x needs the drive
            "prescribed".
        drive: "prescribed", or "motor" (S1.3: position and velocity reference for cosine motions,
            position only for recordings).
        start: pose X_WM of the rock's model frame; None: the scene's.
        name: default: the motion's.
        seed: of whatever was drawn for this trial before dispatch; kept with the result.
        settling, outcome, output: as in a study.
        effects: that are in it, as `apply_effects` notes them; those on the outcome are applied to
            the result.
    """

    scene: Scene
    motion: Motion
    drive: Literal["prescribed", "motor"] = "prescribed"
    start: Pose | None = None
    name: str = ""
    seed: int = 0
    settling: Settling = field(default_factory=Settling)
    outcome: Outcome = field(default_factory=Outcome)
    output: Output = field(default_factory=Output)
    effects: tuple[Applied, ...] = ()


def plan_sha256(trials: Sequence[Trial]) -> str:
    """Hash of all that the results of these trials depend on."""
    digest = hashlib.sha256(str(_native.build_facts()["version"]).encode())
    for trial in trials:
        start = trial.start or trial.scene.rock.start
        for text in (
            trial.name,
            trial.scene.sha256,
            trial.motion.sha256,
            trial.motion.kind,
            trial.drive,
            repr(start),
            str(trial.seed),
            trial.settling.model_dump_json(),
            trial.outcome.model_dump_json(),
            trial.output.model_dump_json(),
            *(applied.key for applied in trial.effects),
        ):
            digest.update(text.encode() + b"\0")
    return digest.hexdigest()


def study_trials(study: Study, *, motions: Sequence[Motion] | None = None) -> list[Trial]:
    """The trials of a study: one per motion.

    Args:
        study: its paths resolved. Its effects are applied; order in the campaign is the order of
            the motions, all of one session.
        motions: to drive instead of the study's own; their time step must be the engine's.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: something of the study cannot be
            used.
    """
    from vsr2.simulation.effects import apply_effects

    chosen(study.effects)  # refused before any mesh is read
    if motions is None:
        motions = build_motions(study.motion, study.engine.time_step)
    scene = build_scene(study)
    contact_trials = study.output.contact_trials
    if contact_trials is not None:
        beyond = [i for i in contact_trials if i >= len(motions)]
        if beyond:
            raise SimulationError(
                f"output.contact_trials names trial {beyond[0]}, but there are only "
                f"{len(motions)} trials, counted from 0"
            )
    silent = study.output.model_copy(update={"contacts_every": 0})
    seeds = np.random.SeedSequence(study.seed).generate_state(max(1, len(motions)), np.uint32)
    trials = [
        Trial(
            scene=scene,
            motion=motion,
            drive=study.motion.drive,
            name=motion.name,
            seed=int(seeds[i]),
            settling=study.settling,
            outcome=study.outcome,
            output=study.output if contact_trials is None or i in contact_trials else silent,
        )
        for i, motion in enumerate(motions)
    ]
    return apply_effects(trials, study.effects, seed=study.seed)


class _Specifications:
    """Native specifications of trials; motions are copied once, equal starts settle once.

    What was not used for a while is let go of, so that memory does not grow with the batch.
    """

    def __init__(self) -> None:
        # With what the key's `id` is of, so that no other object gets it.
        self._samples: OrderedDict[int, tuple[Motion, dict[str, Any]]] = OrderedDict()
        self._starts: OrderedDict[tuple[Any, ...], tuple[Scene, _native.SettledStart]] = (
            OrderedDict()
        )
        self._bytes = 0

    def of(self, trial: Trial) -> _native.TrialSpec:
        outcome, output = trial.outcome, trial.output
        return _native.TrialSpec(
            start=self._start(trial),
            **self._motion(trial.motion),
            log_every=output.log_every,
            contacts_every=output.contacts_every,
            **outcome.model_dump(),
        )

    def _motion(self, motion: Motion) -> dict[str, Any]:
        key = id(motion)
        if key in self._samples:
            self._samples.move_to_end(key)
            return self._samples[key][1]
        samples = {
            "motion_position": _native.Samples(motion.displacement),
            "motion_velocity": _native.Samples(motion.velocity),
        } | {
            name: None if side is None else _native.Samples(side.displacement)
            for name, side in motion.sides.items()
        }
        self._samples[key] = motion, samples
        self._bytes += _sample_bytes(motion)
        while self._bytes > _KEPT_SAMPLES_BYTES and len(self._samples) > 1:
            _, (oldest, _) = self._samples.popitem(last=False)
            self._bytes -= _sample_bytes(oldest)
        return samples

    def _start(self, trial: Trial) -> _native.SettledStart:
        if _goes_beside_x(trial):
            drive = _native.Drive.prescribed_spatial
        elif trial.drive == "prescribed":
            drive = _native.Drive.prescribed
        elif trial.motion.kind == "cosine":
            drive = _native.Drive.motor_position_velocity
        else:
            drive = _native.Drive.motor_position
        body = trial.scene.body_pose(trial.start or trial.scene.rock.start)
        log_every = trial.output.log_every if trial.output.log_settling else 0
        key = (id(trial.scene), drive, body, trial.settling, log_every)
        if key in self._starts:
            self._starts.move_to_end(key)
            return self._starts[key][1]
        start = _native.SettledStart(
            scene=trial.scene.native,
            drive=drive,
            position=body.position,
            orientation=body.orientation,
            log_every=log_every,
            **trial.settling.model_dump(),
        )
        self._starts[key] = trial.scene, start
        while len(self._starts) > _KEPT_STARTS:
            self._starts.popitem(last=False)
        return start


def run_native(
    trials: Sequence[Trial],
    threads: int,
    *,
    take: Callable[[int, dict[str, Any], TrialLog | None], None],
    stopped: Callable[[], bool],
) -> None:
    """Run trials in native threads of this process.

    Trials are handed to the core a little ahead of those that are finished and taken, so that
    neither what waits nor what `take` has not caught up with grows with the batch.

    Args:
        trials: what to run; they passed :func:`check_trials`.
        threads: how many at a time.
        take: called with index, row and log of each trial as it finishes.
        stopped: asked every `POLL`; once true, trials that run end with status `cancelled` and no
            others begin.
    """
    specifications = _Specifications()
    native = _native.Batch(threads)
    sizes: dict[int, float] = {}
    ahead = 0.0
    added = 0
    try:
        while not native.exhausted():
            while added < len(trials):
                size = _log_bytes(trials[added])
                full = len(sizes) >= MAX_AHEAD or ahead + size > MAX_AHEAD_BYTES
                if full and len(sizes) >= 2 * threads:
                    break
                sizes[native.add(specifications.of(trials[added]))] = size
                ahead += size
                added += 1
            else:
                native.close()
            for i in native.wait(POLL):
                result = native.take(i)
                ahead -= sizes.pop(i)
                take(i, _row(result), _log(trials[i], result))
            if stopped():
                native.cancel()
                added = len(trials)
    finally:
        native.cancel()
        native.join()


def check_trials(trials: Sequence[Trial]) -> None:
    """Refuse what cannot be run, before any trial runs.

    Raises:
        SimulationError: a motion of another time step than its scene's, a motor asked to drive a
            motion beside x or a pedestal that pitches on a spring, a motion that pitches such a
            pedestal, or a log that could outgrow memory.
    """
    for trial in trials:
        scene, motion = trial.scene, trial.motion
        if abs(motion.time_step - scene.engine.time_step) > 1e-12 * scene.engine.time_step:
            raise SimulationError(
                f"motion {motion.name!r} is sampled at {motion.time_step:g} s but the engine steps "
                f"at {scene.engine.time_step:g} s; resample the motion in time"
            )
        if motion.is_spatial and trial.drive != "prescribed":
            raise SimulationError(
                f"motion {motion.name!r} goes beside x; only drive: prescribed follows it"
            )
        if scene.pitches and trial.drive != "prescribed":
            raise SimulationError(
                f"trial {trial.name or motion.name!r}: the pedestal pitches on a spring; only "
                "drive: prescribed lets it"
            )
        if scene.pitches and motion.pitch is not None:
            raise SimulationError(
                f"motion {motion.name!r} pitches, and the pedestal pitches on a spring; leave one "
                "of them out"
            )
        size, every = _state_bytes(trial), trial.output.log_every * scene.engine.time_step
        if size > MAX_LOG_BYTES:
            raise SimulationError(
                f"trial {trial.name or motion.name!r}: its log could take {size / 1e9:.3g} GB "
                f"({_longest(trial):g} s, a row every {every:g} s); raise output.log_every or "
                "shorten outcome.tail"
            )


def _goes_beside_x(trial: Trial) -> bool:
    """Whether the pedestal moves along y or z or pitches."""
    return trial.motion.is_spatial or trial.scene.pitches


def _longest(trial: Trial) -> float:
    """The longest time that a trial can log [s]."""
    seconds = trial.motion.duration + trial.outcome.tail
    return seconds + (2 * trial.settling.timeout if trial.output.log_settling else 0.0)


def _state_bytes(trial: Trial) -> float:
    """Size that a trial's state log cannot exceed [byte]."""
    if trial.output.log_every == 0:
        return 0.0
    rows = _longest(trial) / (trial.scene.engine.time_step * trial.output.log_every)
    return float(rows * _state_columns(trial) * 8)


def _state_columns(trial: Trial) -> int:
    """Columns of a trial's state log."""
    return len(STATE_COLUMNS) + (3 if _goes_beside_x(trial) else 0)


def _sample_bytes(motion: Motion) -> int:
    """Size of a motion's set-points in the core [byte]."""
    sides = sum(side is not None for side in motion.sides.values())
    return (2 + sides) * motion.displacement.nbytes


def _log_bytes(trial: Trial) -> float:
    """About the size of the longest log that a trial can give [byte]."""
    if trial.output.contacts_every == 0:
        return _state_bytes(trial)
    seconds = trial.motion.duration + trial.outcome.tail
    rows = seconds / (trial.scene.engine.time_step * trial.output.contacts_every)
    return _state_bytes(trial) + rows * _CONTACTS_A_ROW * len(CONTACT_COLUMNS) * 8


def _least_bytes(trial: Trial) -> float:
    """What a trial takes on disk at least [byte]."""
    size, output = 2.0 * _ROW_BYTES, trial.output
    if output.log_every and not trial.outcome.stop_early:
        size += trial.motion.displacement.size // output.log_every * _state_columns(trial) * 8
    return size


def _empty_columns(trials: Sequence[Trial]) -> dict[str, NDArray[Any]]:
    count = len(trials)
    columns: dict[str, NDArray[Any]] = {}
    for name in TRIAL_COLUMNS:
        if name in TEXT_COLUMNS:
            columns[name] = np.full(count, "", dtype=object)
        elif name in INTEGER_COLUMNS:
            columns[name] = np.zeros(count, dtype=np.int64)
        else:
            columns[name] = np.full(count, np.nan)
    columns["status"][:] = "not_run"
    columns["outcome"][:] = "failed"
    for i, trial in enumerate(trials):
        columns["trial"][i] = i
        columns["name"][i] = trial.name or trial.motion.name
        columns["motion"][i] = trial.motion.name
        columns["motion_sha256"][i] = trial.motion.sha256
        columns["seed"][i] = trial.seed
        columns["pga"][i] = trial.motion.pga
        columns["pgv"][i] = trial.motion.pgv
        columns["pgv_pga"][i] = trial.motion.pgv_pga
    return columns


def _row(result: _native.TrialResult) -> dict[str, Any]:
    row = {name: getattr(result, name) for name in (*_FLOAT_COLUMNS, "message", "engine", "steps")}
    return row | {"status": result.status.name, "outcome": result.outcome.name}


def failed_row(trial: Trial, message: str) -> dict[str, Any]:
    """The row of a trial that could not be run to an end of its own, with status `error`."""
    facts = {"message": message, "engine": trial.scene.engine_name, "steps": 0}
    return dict.fromkeys(_FLOAT_COLUMNS, np.nan) | facts | {"status": "error", "outcome": "failed"}


def observed(trial: Trial, row: Mapping[str, Any]) -> Mapping[str, Any]:
    """The row of a trial as it is written down: with the effects on its outcome."""
    rules = [applied for applied in trial.effects if applied.effect.stage == "outcome"]
    if not rules or row["outcome"] == "failed":
        return row
    keys = ("outcome", "peak_tilt", "final_tilt", "final_slip", "final_yaw")
    observation = Observation(**{key: row[key] for key in keys})
    for rule in rules:
        observation = rule.observe(observation)
    return {**row, **{key: getattr(observation, key) for key in keys}}


def _log(trial: Trial, result: _native.TrialResult) -> TrialLog | None:
    state = result.take_log()
    if len(state) == 0:
        return None
    frame = trial.scene.body_frame
    return TrialLog(
        state=state,
        contacts=result.take_contacts(),
        excursions=result.take_excursions(),
        pivot=np.array([*trial.scene.pedestal.origin[:2], trial.scene.pitch_pivot]),
        settled_position=np.asarray(result.settled_position),
        settled_orientation=np.asarray(result.settled_orientation),
        foot=np.asarray(result.foot),
        mass_center=np.asarray(frame.position),
        principal_axes=np.asarray(frame.orientation),
    )


def _check_out(out: Mapping[str, NDArray[Any]], count: int) -> None:
    for name, array in out.items():
        if name == "state":
            good = array.ndim == 3 and array.shape[::2] == (count, len(STATE_COLUMNS))
            shape = f"({count}, steps, {len(STATE_COLUMNS)})"
        elif name in _FLOAT_COLUMNS:
            good, shape = array.shape == (count,), f"({count},)"
        else:
            raise SimulationError(
                f"out: unknown array {name!r}; known: state, {', '.join(_FLOAT_COLUMNS)}"
            )
        if not good or array.dtype != np.float64 or not array.flags.writeable:
            raise SimulationError(
                f"out[{name!r}] must be a writeable float64 array of shape {shape}; it is "
                f"{array.dtype} of shape {array.shape}"
            )


def _copy_out(
    out: Mapping[str, NDArray[Any]], i: int, columns: Mapping[str, Any], log: TrialLog | None
) -> None:
    for name, array in out.items():
        if name != "state":
            array[i] = columns[name][i]
        elif log is not None:
            rows = min(len(log.state), array.shape[1])
            array[i, :rows] = log.state[:rows]


def run_batch(
    trials: Study | str | PathLike[str] | Sequence[Trial],
    *,
    motions: Sequence[Motion] | None = None,
    threads: int | None = None,
    progress: bool = False,
    out: Mapping[str, NDArray[Any]] | None = None,
    keep_logs: bool = True,
    on_trial: Callable[[int, TrialLog | None], None] | None = None,
    checkpoint: str | PathLike[str] | None = None,
    client: distributed.Client | None = None,
) -> BatchResult:
    """Run independent trials in native threads, or on a cluster.

    The result does not depend on the number of threads, workers or the order of the trials, to the
    last bit. What goes wrong in one trial is that trial's status and message, and loses no other.
    Ctrl-C stops within a second and returns what is finished; `provenance["interrupted"]` says so.

    Args:
        trials: a study, the path of one, or trials made before.
        motions: with a study: drive these instead of its own.
        threads: default: one per processor this process may use.
        progress: show a progress bar on standard error, where that is a terminal.
        out: arrays to fill: "state" of shape (trials, steps, 18), rows after a trial's end
            left NaN and rows that do not fit left out, and any of the float columns of
            `BatchResult.trials`, shape (trials,).
        keep_logs: keep logs in the result; False bounds memory when `on_trial` takes them.
        on_trial: called with index and log as each trial finishes, in the order of finishing.
        checkpoint: a folder made ready by `vsr2.results.prepare_folder`, in which logs and a
            journal are kept as trials finish. Where it holds the journal of the same trials, those
            that finished are not run again; the result is the same to the last bit. Logs are then
            on disk only.
        client: of a Dask distributed cluster that runs the trials, one a thread of its workers
            (docs/parallel.md); collecting, `out`, `on_trial` and `checkpoint` stay here.

    Returns:
        One row a trial, in the order given.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: before any trial starts, where
            the input cannot be used (an empty batch, for example).
        ResultError: the checkpoint cannot be used, belongs to other trials, is in use by another
            process, or there is no room for the result.
    """
    started = time.time()
    study: Study | None = None
    if isinstance(trials, (str, PathLike)):
        trials = load_study(trials)
    if isinstance(trials, Study):
        study = trials
        trials = study_trials(study, motions=motions)
    elif motions is not None:
        raise SimulationError("motions can be given only together with a study")
    if len(trials) == 0:
        raise SimulationError("the batch is empty: give at least one trial")
    check_trials(trials)
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    elif client is not None:
        raise SimulationError(
            "threads does not apply with a client: the workers' own threads run the trials"
        )
    if not 1 <= threads <= 1024:
        raise SimulationError(f"threads must lie in 1 to 1024, got {threads}")
    if out is not None:
        _check_out(out, len(trials))
    collection = _Collection(trials, out=out, keep_logs=keep_logs, on_trial=on_trial)
    with contextlib.ExitStack() as stack:
        if checkpoint is not None:
            collection.resume(
                stack.enter_context(Journal(checkpoint, plan_sha256(trials), len(trials))),
                Path(checkpoint),
            )
        pending = collection.pending
        interrupt = stack.enter_context(_InterruptFlag())
        bar = stack.enter_context(_bar(len(trials), len(pending), progress))

        def take(position: int, row: Mapping[str, Any], log: TrialLog | None) -> None:
            collection.take(pending[position], row, log)
            bar.update()

        waiting = [trials[i] for i in pending]
        if client is None:
            run_native(waiting, threads, take=take, stopped=lambda: interrupt.raised)
            place: dict[str, Any] = {"threads": threads}
        else:
            from vsr2.simulation.distributed import run_on_cluster

            place = run_on_cluster(waiting, client, take=take, stopped=lambda: interrupt.raised)
    provenance = base_provenance(_native.build_facts()) | {
        "study": None if study is None else study.model_dump(mode="json"),
        **place,
        "interrupted": interrupt.raised,
        "wall_time_s": time.time() - started,
        "models": _model_hashes(trials),
        "effects": _effects_given(trials),
    }
    return BatchResult(
        trials=collection.columns, logs=tuple(collection.logs), provenance=provenance
    )


class _Collection:
    """What has come back from the core so far, and where it goes."""

    def __init__(
        self,
        trials: Sequence[Trial],
        *,
        out: Mapping[str, NDArray[Any]] | None,
        keep_logs: bool,
        on_trial: Callable[[int, TrialLog | None], None] | None,
    ) -> None:
        self.columns = _empty_columns(trials)
        self.logs: list[TrialLog | None] = [None] * len(trials)
        self.pending = list(range(len(trials)))
        self._trials = trials
        self._out = out or {}
        self._keep_logs = keep_logs
        self._on_trial = on_trial
        self._journal: Journal | None = None
        self._folder = Path()
        for array in self._out.values():
            array.fill(np.nan)

    def resume(self, journal: Journal, folder: Path) -> None:
        """Take over what the journal holds, and keep it from now on."""
        self._journal, self._folder = journal, folder
        for i, row in journal.finished.items():
            for name in _RESULT_COLUMNS:
                self.columns[name][i] = row[name]
            if self._out:
                logged = "state" in self._out and self._trials[i].output.log_every > 0
                _copy_out(self._out, i, self.columns, load_trial_log(folder, i) if logged else None)
        self.pending = [i for i in self.pending if i not in journal.finished]
        remove_temporaries(folder)
        require_space(folder, sum(_least_bytes(self._trials[i]) for i in self.pending))

    def take(self, i: int, row: Mapping[str, Any], log: TrialLog | None) -> None:
        """Take in a finished trial."""
        row = observed(self._trials[i], row)
        for name in _RESULT_COLUMNS:
            self.columns[name][i] = row[name]
        _copy_out(self._out, i, self.columns, log)
        if self._journal is None:
            if self._keep_logs:
                self.logs[i] = log
        elif self.columns["status"][i] != "cancelled":
            if log is not None:
                save_trial_log(self._folder, i, log, npy=self._trials[i].output.npy)
            self._journal.record(
                i, {name: _plain(self.columns[name][i]) for name in _RESULT_COLUMNS}
            )
        if self._on_trial is not None:
            self._on_trial(i, log)


class _InterruptFlag:
    """Turns the first Ctrl-C into a flag, so that no finished trial is lost between two lines.

    A second Ctrl-C raises KeyboardInterrupt as usual. Outside the main thread, where Python
    handles no signals, it does nothing.
    """

    def __init__(self) -> None:
        self.raised = False
        self._previous: Any = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.raised:
            raise KeyboardInterrupt
        self.raised = True

    def __exit__(self, *exception: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)


def _model_hashes(trials: Sequence[Trial]) -> dict[str, str]:
    scenes = {id(trial.scene): trial.scene for trial in trials}.values()
    bodies = [body for scene in scenes for body in (scene.rock, scene.pedestal)]
    return {body.source: body.sha256 for body in bodies if body.sha256}


def _effects_given(trials: Sequence[Trial]) -> dict[str, list[dict[str, float | None]]]:
    """Effects of the trials by name: all values that were asked for; None where none was.

    A null value may be infinite or NaN, which JSON does not hold.
    """
    given: dict[str, list[dict[str, float | None]]] = {}
    for applied in dict.fromkeys(one for trial in trials for one in trial.effects):
        values = {name: value if math.isfinite(value) else None for name, value in applied.given}
        if values not in given.setdefault(applied.effect.name, []):
            given[applied.effect.name].append(values)
    return given


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _bar(total: int, pending: int, show: bool) -> Any:
    from tqdm import tqdm

    # None: only on a terminal.
    return tqdm(
        total=total,
        initial=total - pending,
        unit="trial",
        disable=None if show else True,
        dynamic_ncols=True,
    )
