"""Many independent trials, in native threads or on a cluster: progress, checkpoint, results."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from numbers import Integral
from os import PathLike
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.argument_names import checked_names
from vsr2.config import Study, load_study
from vsr2.errors import SimulationError
from vsr2.one_line import counted
from vsr2.results import (
    FLOAT_COLUMNS,
    INTEGER_COLUMNS,
    RESULT_COLUMNS,
    STATE_COLUMNS,
    TEXT_COLUMNS,
    TRIAL_COLUMNS,
    BatchResult,
    HandOver,
    Journal,
    Outcome,
    Status,
    TrialLog,
    base_provenance,
    load_trial_log,
    log_mark,
    remove_temporaries,
    require_space,
    save_trial_log,
)
from vsr2.simulation.distributed import run_on_cluster
from vsr2.simulation.native_scenes import native_scene
from vsr2.simulation.native_trials import run_native
from vsr2.simulation.planning import ROW_BYTES, check_trials, log_bytes, plan_sha256, study_trials
from vsr2.simulation.run_constants import run_constants
from vsr2.trial import Observation, Trial

if TYPE_CHECKING:
    import distributed

_LOST, _COMPLETE = 1, 2
"""What a journal holds of a trial: a row whose log is lost, or all of it."""
OBSERVED_COLUMNS = tuple(field.name for field in fields(Observation))
"""Columns of what is written down of a trial, which effects on the outcome change."""

_logger = logging.getLogger(__name__)


@checked_names(SimulationError)
def run_batch(
    trials: Study | str | PathLike[str] | Sequence[Trial],
    *,
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
            (docs/how-to/cluster.md); collecting, `out`, `on_trial` and `checkpoint` stay here.

    Returns:
        One row a trial, in the order given.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: before any trial starts, where
            the input cannot be used (an empty batch, for example).
        ResultError: the checkpoint cannot be used, belongs to other trials, is in use by another
            process, or there is no room for the result.
    """
    started = time.time()
    study = load_study(trials) if isinstance(trials, (str, PathLike)) else trials
    trials = _checked(study_trials(study) if isinstance(study, Study) else study)
    _threads(threads, client)  # Refused before a checkpoint is opened.
    collection = _Collection(trials, out=out, keep_logs=keep_logs, on_trial=on_trial)
    with contextlib.ExitStack() as stack:
        if checkpoint is not None:
            journal = collection.journal(Path(checkpoint), plan_sha256(trials))
            collection.resume(stack.enter_context(journal))
        pending = collection.pending
        waiting = [trials[i] for i in pending.tolist()]
        bar = stack.enter_context(_bar(len(trials), len(pending), progress))

        def take(position: int, row: Mapping[str, Any], log: TrialLog | None) -> None:
            collection.take(int(pending[position]), row, log)
            bar.update()

        _log_begin(trials, len(pending))
        facts = run_trials(waiting, threads=threads, client=client, take=take)
    ends = ", ".join(f"{n} {end}" for end, n in Counter(collection.columns["status"]).items())
    _logger.info("batch ended after %.3g s: %s", time.time() - started, ends)
    provenance = base_provenance(_native.build_facts()) | {
        "study": study.model_dump(mode="json") if isinstance(study, Study) else None,
        "plan_sha256": plan_sha256(trials),
        **facts,
        "wall_time_s": time.time() - started,
        "models": _model_hashes(trials),
        "effects": _effects_given(trials),
        "constants": run_constants(),
    }
    return collection.result(provenance)


def run_trials(
    trials: Iterable[Trial],
    *,
    threads: int | None = None,
    client: distributed.Client | None = None,
    take: Callable[[int, Mapping[str, Any], TrialLog | None], None],
) -> dict[str, Any]:
    """Run trials as :func:`run_batch` does, and collect nothing.

    Args:
        trials: that passed :func:`check_trials`. Threads ask for them as they go on, so that they
            may be made then; for a cluster all are made first.
        threads: default: one per processor this process may use.
        client: of a cluster that runs the trials.
        take: called with index, row and log of each trial as it finishes.

    Returns:
        Where they ran, and whether Ctrl-C ended it.
    """
    with _InterruptFlag() as interrupt:

        def note(i: int, one: Trial, row: Mapping[str, Any], log: TrialLog | None) -> None:
            take(i, observed(one, row), log)

        facts: dict[str, Any] = {"threads": _threads(threads, client)}
        if client is None:
            run_native(trials, facts["threads"], take=note, stopped=interrupt.is_raised)
        else:
            made = [*trials]
            facts = run_on_cluster(
                made,
                client,
                take=lambda i, row, log: note(i, made[i], row, log),
                stopped=interrupt.is_raised,
            )
        return facts | {"interrupted": interrupt.is_raised()}


def _checked(trials: Sequence[Trial]) -> Sequence[Trial]:
    """The same trials, if they can be run."""
    if isinstance(trials, Mapping):
        raise SimulationError(
            "the batch is a mapping; `vsr2.Study.from_dict(mapping)` makes a study of it"
        )
    if not hasattr(trials, "__len__"):
        raise SimulationError(
            f"the batch is of type {type(trials).__name__}; give a Study, the path of one, or "
            "a list of trials"
        )
    if len(trials) == 0:
        raise SimulationError("the batch is empty: give at least one trial")
    check_trials(trials)
    return trials


def usable_threads(threads: int | None) -> int:
    """The number of threads that a batch runs in: as given, or one per usable processor.

    Raises:
        SimulationError: no whole number from 1 to 1024.
    """
    return _threads(threads, None)


def _threads(threads: int | None, client: distributed.Client | None) -> int:
    if threads is not None and client is not None:
        raise SimulationError(
            "threads does not apply with a client: the workers' own threads run the trials"
        )
    count = len(os.sched_getaffinity(0)) if threads is None else threads
    integral = isinstance(count, Integral) and not isinstance(count, bool)
    if not integral or not 1 <= count <= 1024:
        raise SimulationError(f"threads must be a whole number from 1 to 1024, got {threads!r}")
    return int(count)


def _log_begin(trials: Sequence[Trial], pending: int) -> None:
    if _logger.isEnabledFor(logging.INFO):
        engines = " and ".join(sorted({native_scene(one.scene).engine.name for one in trials}))
        done = len(trials) - pending
        batch = counted(len(trials), "trial")
        _logger.info("%s, engine %s; %d of them in the journal", batch, engines, done)


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
        self.pending = np.arange(len(trials))
        self._trials = trials
        self._out = out or {}
        self._keep_logs = keep_logs
        _check_out(self._out, len(trials))
        self._on_trial = on_trial
        self._journal: Journal | None = None
        self._folder = Path()
        self._noted = np.zeros(len(trials), np.int8)
        for array in self._out.values():
            array.fill(np.nan)

    def journal(self, folder: Path, plan: str) -> Journal:
        """The journal of these trials; the rows that it holds are taken over as they are read."""
        self._folder = folder
        return Journal(folder, plan, len(self._trials), self._note)

    def _note(self, i: int, row: Mapping[str, Any]) -> None:
        # A log that was lost or cut short since is made again, with its trial.
        self._noted[i] = _LOST if log_mark(self._folder, i) != row["log"] else _COMPLETE
        if self._noted[i] == _COMPLETE:
            self._fill(i, row)

    def resume(self, journal: Journal) -> None:
        """Go on from what the journal held, and keep it from now on."""
        self._journal, folder = journal, self._folder
        lost = int((self._noted == _LOST).sum())
        if lost:
            _logger.warning("%s: run again, log lost: %s", folder, counted(lost, "finished trial"))
        for i in np.flatnonzero(self._noted == _COMPLETE).tolist() if self._out else ():
            logged = "state" in self._out and self._trials[i].output.log_every > 0
            _copy_out(self._out, i, self.columns, load_trial_log(folder, i) if logged else None)
        self.pending = np.flatnonzero(self._noted != _COMPLETE)
        remove_temporaries(folder)
        require_space(
            folder,
            sum(
                2 * ROW_BYTES + log_bytes(self._trials[i], least=True)
                for i in self.pending.tolist()
            ),
        )

    def _fill(self, i: int, row: Mapping[str, Any]) -> None:
        for name in RESULT_COLUMNS:
            self.columns[name][i] = _kept(row[name])

    def take(self, i: int, row: Mapping[str, Any], log: TrialLog | None) -> None:
        """Take in a finished trial."""
        self._fill(i, row)
        _copy_out(self._out, i, self.columns, log)
        if self._journal is None:
            if self._keep_logs:
                self.logs[i] = log
        elif self.columns["status"][i] != Status.cancelled:
            if log is not None:
                save_trial_log(self._folder, i, log, npy=self._trials[i].output.npy)
            row = {name: _plain(self.columns[name][i]) for name in RESULT_COLUMNS}
            mark = None if log is None else log_mark(self._folder, i)
            self._journal.record(i, row, mark)
        if self._on_trial is not None:
            self._on_trial(i, log)

    def result(self, provenance: Mapping[str, Any]) -> BatchResult:
        """All of it; nothing can be taken in afterwards."""
        for column in self.columns.values():
            column.setflags(write=False)  # So that the result needs no copy.
        return BatchResult(self.columns, tuple(self.logs), provenance)


def _kept(value: Any) -> Any:
    """A word is kept once, not once a trial."""
    return sys.intern(str(value)) if isinstance(value, str) else value


def observed(trial: Trial, row: Mapping[str, Any]) -> Mapping[str, Any]:
    """The row of a trial as it is written down: with the effects on its outcome."""
    rules = [applied for applied in trial.effects if applied.effect.stage == "outcome"]
    if not rules or row["outcome"] == Outcome.failed:
        return row
    observation = Observation(**{key: row[key] for key in OBSERVED_COLUMNS})
    for rule in rules:
        observation = rule.effect.observe(observation, dict(rule.values))
    return {**row, **asdict(observation)}


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
    columns["status"][:] = Status.not_run
    columns["hand_over"][:] = HandOver.none
    columns["outcome"][:] = Outcome.failed
    for i, trial in enumerate(trials):
        columns["trial"][i] = i
        columns["name"][i] = trial.label
        columns["motion"][i] = trial.motion.name
        columns["motion_sha256"][i] = trial.motion.sha256
        columns["seed"][i] = trial.seed
        columns["pga_g"][i] = trial.motion.pga_g
        columns["pgv_m_s"][i] = trial.motion.pgv_m_s
        columns["pgv_pga_s"][i] = trial.motion.pgv_pga_s
    return columns


def _check_out(out: Mapping[str, NDArray[Any]], count: int) -> None:
    for name, array in out.items():
        if name == "state":
            good = array.ndim == 3 and array.shape[::2] == (count, len(STATE_COLUMNS))
            shape = f"({count}, steps, {len(STATE_COLUMNS)})"
        elif name in FLOAT_COLUMNS:
            good, shape = array.shape == (count,), f"({count},)"
        else:
            raise SimulationError(
                f"out: unknown array {name!r}; known: state, {', '.join(FLOAT_COLUMNS)}"
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


class _InterruptFlag:
    """Turns the first Ctrl-C into a flag, so that no finished trial is lost between two lines.

    A second Ctrl-C raises KeyboardInterrupt as usual. Outside the main thread, where Python
    handles no signals, it does nothing.
    """

    def __init__(self) -> None:
        self._raised = False
        self._previous: Any = None

    def is_raised(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self._raised

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._raised:
            raise KeyboardInterrupt
        self._raised = True

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
