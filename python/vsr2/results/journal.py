"""The journal of a running batch: one record a finished trial, so that nothing finished is lost.

A trial is recorded after its log is on disk, with length and hash of the log. Floats read back to
the last bit. A row that was changed since it was written is refused: its checksum differs.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from vsr2._native import HandOver
from vsr2.errors import ResultError
from vsr2.results.result import (
    COLUMNS,
    ENGINES,
    FLOAT_COLUMNS,
    INTEGER_COLUMNS,
    JUDGED,
    OPEN_COLUMNS,
    OUTCOMES,
    RESULT_COLUMNS,
    STATUSES,
)
from vsr2.results.store import Store, StoreKind, Take, is_number, odd_value, read_store

JOURNAL_FILE = "journal.jsonl"
_WORDS = {
    "status": STATUSES,
    "outcome": OUTCOMES,
    "engine": ("", *ENGINES),
    "hand_over": tuple(HandOver.__members__),
}
"""What columns of text may hold."""
_COLUMNS = hashlib.sha256(json.dumps(COLUMNS).encode()).hexdigest()[:8]
_KIND = StoreKind(
    format="vsr2 journal",
    version=f"5 with columns {_COLUMNS}",
    foreign="belongs to an unfinished run with other trials or settings; finish that one with its "
    "own study, or start again with `--overwrite`",
)


Note = Callable[[int, dict[str, Any]], None]
"""Takes index and row of a finished trial."""


class Journal(Store):
    """Finished trials of one plan, on disk.

    Args:
        folder: of the result; made ready by :func:`vsr2.results.prepare_folder`.
        plan: hash of everything the trials depend on; a journal of another plan is refused.
        trials: number of trials of the plan.
        note: called with each row that is there at the start, of which the last one of a trial
            counts; None: they are kept in `finished`, at about 2 kB a row.

    Attributes:
        finished: rows by trial index that were there at the start, unless `note` took them.

    Raises:
        ResultError: as of :class:`vsr2.results.store.Store`.
    """

    def __init__(
        self, folder: str | os.PathLike[str], plan: str, trials: int, note: Note | None = None
    ) -> None:
        self.finished: dict[int, dict[str, Any]] = {}
        identity = {"plan": plan, "trials": trials}
        take = _taker(note or self.finished.__setitem__, trials)
        super().__init__(Path(folder) / JOURNAL_FILE, _KIND, identity, take)

    def record(
        self, trial: int, row: Mapping[str, Any], log: Mapping[str, Any] | None = None
    ) -> None:
        """Append a finished trial; its log must be on disk already.

        Args:
            trial: index.
            row: its columns RESULT_COLUMNS.
            log: mark of its log (:func:`vsr2.results.result_folder.log_mark`); None: it has none.

        Raises:
            ResultError: it cannot be written.
        """
        self.record_all([(trial, row, log)])

    def record_all(
        self, trials: Iterable[tuple[int, Mapping[str, Any], Mapping[str, Any] | None]]
    ) -> None:
        """Append finished trials by one write: index, row and mark of each, as for `record`.

        Raises:
            ResultError: they cannot be written.
        """
        self.add(
            *(
                {**{name: row[name] for name in RESULT_COLUMNS}, "trial": trial, "log": log}
                for trial, row, log in trials
            )
        )


def _taker(note: Note, trials: int) -> Take:
    def take(row: dict[str, Any]) -> None:
        trial = row["trial"]
        if type(trial) is not int or not 0 <= trial < trials:
            raise odd_value("trial", trial, f"an index from 0 to {trials - 1}")
        _check_row(row)
        note(trial, row)

    return take


def _check_row(row: dict[str, Any]) -> None:
    """Refuse a row that no trial wrote.

    Raises:
        ValueError: a value of another type or size, or an unknown word.
        KeyError: a column is missing.
    """
    judged = row["status"] in JUDGED
    for name in RESULT_COLUMNS:
        value = row[name]
        if name in FLOAT_COLUMNS:
            good, wanted = _is_measured(name, value, judged), "a number of a trial that ended so"
        elif name in INTEGER_COLUMNS:
            good, wanted = type(value) is int and 0 <= value < 2**63, "a count"
        else:
            words = _WORDS.get(name)
            good = type(value) is str and (words is None or value in words)
            wanted = "text" if words is None else f"one of {', '.join(filter(None, words))}"
        if not good:
            raise odd_value(name, value, wanted)
    log = row["log"]
    if log is not None and not (
        isinstance(log, dict) and type(log.get("bytes")) is int and type(log.get("sha256")) is str
    ):
        raise odd_value("log", log, "length and hash of a log")


def _is_measured(name: str, value: object, judged: bool) -> bool:
    """Whether a trial may have this number: NaN stands for what it did not come to."""
    if is_number(value):
        return True
    may_lack = name in OPEN_COLUMNS or not judged
    return may_lack and type(value) is float and math.isnan(value)


def read_journal(
    folder: str | os.PathLike[str], plan: str, trials: int
) -> dict[int, dict[str, Any]]:
    """Rows of the finished trials by index, the journal left as it is: another may write it.

    Args:
        folder: of the result.
        plan: as of :class:`Journal`.
        trials: as of :class:`Journal`.

    Raises:
        ResultError: there is no journal, or as of :func:`vsr2.results.store.read_store`.
    """
    path = Path(folder) / JOURNAL_FILE
    if not path.exists():
        raise ResultError(f"{path}: does not exist; no run was started in this folder")
    finished: dict[int, dict[str, Any]] = {}
    read_store(path, _KIND, {"plan": plan, "trials": trials}, _taker(finished.__setitem__, trials))
    return finished


def has_journal(folder: str | os.PathLike[str]) -> bool:
    """Whether an unfinished run left its journal in the folder."""
    return (Path(folder) / JOURNAL_FILE).is_file()


def remove_journal(folder: str | os.PathLike[str]) -> None:
    """Remove the journal, once the whole result is written."""
    (Path(folder) / JOURNAL_FILE).unlink(missing_ok=True)
