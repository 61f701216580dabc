"""A finished result whose logs were lost since: a run again that makes these trials only."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vsr2.errors import ResultError
from vsr2.results.journal import Journal
from vsr2.results.result import RESULT_COLUMNS
from vsr2.results.result_folder import (
    NPY_FOLDER,
    finished_plan,
    load_result,
    load_trial_log,
    log_mark,
    logged_trials,
    original_rows,
)

_NO_LOG = {"bytes": 0, "sha256": ""}
"""The mark of no file: whoever goes on from the journal makes the trial again."""


def lost_logs(folder: str | os.PathLike[str], *, npy: bool = False) -> list[int]:
    """Trials of a finished result whose log is gone, or no longer what its checksums say.

    Every array of a log lies in its file with a length and a checksum (CRC-32), as it does in any
    zip archive. All logs are read.

    Args:
        folder: of the result.
        npy: also look at the original's rows, which must be those of the log.

    Raises:
        ResultError: as :func:`vsr2.results.load_result` without logs.
    """
    path = Path(folder)
    return [trial for trial in logged_trials(path) if not _is_sound(path, trial, npy)]


def _is_sound(folder: Path, trial: int, npy: bool) -> bool:
    try:
        log = load_trial_log(folder, trial)
        if not npy:
            return True
        rows = np.load(folder / NPY_FOLDER / f"{trial:06d}.npy", allow_pickle=False)
    except (ResultError, OSError, ValueError, EOFError):
        return False
    return bool(np.array_equal(rows, original_rows(log)))


def reopen_result(folder: str | os.PathLike[str], lost: Sequence[int]) -> None:
    """Make of a finished result one that lacks some trials, with a journal of the others.

    :func:`vsr2.simulation.run_batch` with this folder as its checkpoint then runs those trials.

    Args:
        folder: of the result.
        lost: trials to run again.

    Raises:
        ResultError: the table or a log cannot be read, or the journal cannot be written.
    """
    path = Path(folder)
    table = load_result(path, logs=False).trials
    columns = {name: table[name].tolist() for name in RESULT_COLUMNS}
    gone = frozenset(lost)
    with Journal(path, finished_plan(path), len(table["trial"])) as journal:
        journal.record_all(
            (
                trial,
                {name: column[trial] for name, column in columns.items()},
                _NO_LOG if trial in gone else log_mark(path, trial),
            )
            for trial in range(len(table["trial"]))
        )
