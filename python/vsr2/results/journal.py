"""The journal of a running batch: one record a finished trial, so that nothing finished is lost.

A trial is recorded after its log is on disk. Floats read back to the last bit.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsr2.errors import ResultError
from vsr2.results.result import COLUMNS
from vsr2.results.store import Store, StoreKind, Take, read_store

JOURNAL_FILE = "journal.jsonl"
_COLUMNS = hashlib.sha256(json.dumps(COLUMNS).encode()).hexdigest()[:8]
_KIND = StoreKind(
    format="vsr2 journal",
    version=f"3 with columns {_COLUMNS}",
    foreign="belongs to an unfinished run with other trials or settings; finish that one with its "
    "own study, or start again with overwrite",
)


class Journal(Store):
    """Finished trials of one plan, on disk.

    Args:
        folder: of the result; made ready by :func:`vsr2.results.prepare_folder`.
        plan: hash of everything the trials depend on; a journal of another plan is refused.
        trials: number of trials of the plan.

    Attributes:
        finished: rows by trial index that were there at the start.

    Raises:
        ResultError: as of :class:`vsr2.results.store.Store`.
    """

    def __init__(self, folder: str | os.PathLike[str], plan: str, trials: int) -> None:
        self.finished: dict[int, dict[str, Any]] = {}
        identity = {"plan": plan, "trials": trials}
        super().__init__(
            Path(folder) / JOURNAL_FILE, _KIND, identity, _taker(self.finished, trials)
        )

    def record(self, trial: int, row: Mapping[str, Any]) -> None:
        """Append a finished trial; its log must be on disk already.

        Raises:
            ResultError: it cannot be written.
        """
        self.add({**row, "trial": trial})


def _taker(finished: dict[int, dict[str, Any]], trials: int) -> Take:
    def take(row: dict[str, Any]) -> None:
        trial = row["trial"]
        if not (isinstance(trial, int) and 0 <= trial < trials):
            raise ValueError(f"trial {trial!r}")
        finished[trial] = row

    return take


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
    read_store(path, _KIND, {"plan": plan, "trials": trials}, _taker(finished, trials))
    return finished


def has_journal(folder: str | os.PathLike[str]) -> bool:
    """Whether an unfinished run left its journal in the folder."""
    return (Path(folder) / JOURNAL_FILE).is_file()


def remove_journal(folder: str | os.PathLike[str]) -> None:
    """Remove the journal, once the whole result is written."""
    (Path(folder) / JOURNAL_FILE).unlink(missing_ok=True)
