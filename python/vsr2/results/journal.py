"""The journal of a running batch: one line a finished trial, so that nothing finished is lost.

A line is appended by a single write after the trial's log is on disk. However the process ends, the
file holds whole lines and at most one torn last line, which a resumed run drops and does again.
Floats are written so that they read back to the last bit. While a process writes the journal it
holds a lock on it, where the file system has locks, so that no second one writes into it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from vsr2.errors import ResultError
from vsr2.results.lines import append_line, lock_file

JOURNAL_FILE = "journal.jsonl"
_FORMAT = "vsr2 journal"
_VERSION = 2
_MAX_BYTES = 2**32


class Journal:
    """Finished trials of one plan, on disk.

    Args:
        folder: of the result; made ready by :func:`vsr2.results.prepare_folder`.
        plan: hash of everything the trials depend on; a journal of another plan is refused.
        trials: number of trials of the plan.

    Attributes:
        finished: rows by trial index that were there at the start.

    Raises:
        ResultError: the journal there is of another plan, is damaged before its last line, is
            written by another process, or the folder cannot be written to.
    """

    def __init__(self, folder: str | os.PathLike[str], plan: str, trials: int) -> None:
        self._path = Path(folder) / JOURNAL_FILE
        self._header = _header(plan, trials)
        try:
            _check_regular(self._path)
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o666)
            try:
                lock_file(self._file, self._path)
                self.finished, end = _read(self._path, self._header)
                os.ftruncate(self._file, end)
                os.lseek(self._file, 0, os.SEEK_END)
                if end == 0:
                    append_line(self._file, self._header)
            except BaseException:
                os.close(self._file)
                raise
        except OSError as error:
            raise ResultError(
                f"{self._path}: cannot be used ({error.strerror}); free space or choose another "
                "folder"
            ) from error

    def record(self, trial: int, row: Mapping[str, Any]) -> None:
        """Append a finished trial; its log must be on disk already.

        Raises:
            ResultError: it cannot be written.
        """
        entry = {**row, "trial": trial}
        try:
            append_line(self._file, entry)
        except OSError as error:
            raise ResultError(
                f"{self._path}: cannot be written ({error.strerror}); free space and resume"
            ) from error

    def close(self) -> None:
        """Close the file; the journal stays."""
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _header(plan: str, trials: int) -> dict[str, Any]:
    return {"format": _FORMAT, "version": _VERSION, "plan": plan, "trials": trials}


def _read(path: Path, header: Mapping[str, Any]) -> tuple[dict[int, dict[str, Any]], int]:
    """Rows of all whole lines by trial index, and where the last whole line ends."""
    finished: dict[int, dict[str, Any]] = {}
    _check_regular(path)
    if not path.exists():
        return finished, 0
    if path.stat().st_size > _MAX_BYTES:
        raise ResultError(f"{path}: over {_MAX_BYTES} bytes; not a journal of ours")
    content = path.read_bytes()
    end = content.rfind(b"\n") + 1
    for number, line in enumerate(content[:end].splitlines()):
        try:
            entry = json.loads(line)
            if number == 0:
                _check_header(path, entry, header)
                continue
            index = entry["trial"]
            if not (isinstance(index, int) and 0 <= index < header["trials"]):
                raise ValueError(f"trial {index!r}")
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise ResultError(
                f"{path}:{number + 1}: damaged ({error}); start anew with overwrite"
            ) from None
        finished[index] = entry
    return finished, end


def _check_regular(path: Path) -> None:
    if path.exists() and not path.is_file():
        raise ResultError(f"{path}: is no regular file; choose another folder")


def _check_header(path: Path, entry: Any, header: Mapping[str, Any]) -> None:
    if entry == header:
        return
    if not isinstance(entry, dict) or entry.get("format") != _FORMAT:
        raise ValueError("not a journal of ours")
    raise ResultError(
        f"{path}: belongs to an unfinished run with other trials or settings; finish "
        "that one with its own study, or start anew with overwrite"
    )


def read_journal(
    folder: str | os.PathLike[str], plan: str, trials: int
) -> dict[int, dict[str, Any]]:
    """Rows of the finished trials by index, the journal left as it is: another may write it.

    Args:
        folder: of the result.
        plan: as of :class:`Journal`.
        trials: as of :class:`Journal`.

    Raises:
        ResultError: there is no journal, or as of :class:`Journal`.
    """
    path = Path(folder) / JOURNAL_FILE
    if not path.exists():
        raise ResultError(f"{path}: does not exist; no run was started in this folder")
    try:
        return _read(path, _header(plan, trials))[0]
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror})") from error


def has_journal(folder: str | os.PathLike[str]) -> bool:
    """Whether an unfinished run left its journal in the folder."""
    return (Path(folder) / JOURNAL_FILE).is_file()


def refuse_running(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder that another process is writing a result into.

    Raises:
        ResultError: its journal is locked.
    """
    path = Path(folder) / JOURNAL_FILE
    try:
        file = os.open(path, os.O_WRONLY)
    except OSError:
        return  # There is none, or whoever uses it next tells why it cannot.
    try:
        lock_file(file, path)
    finally:
        os.close(file)


def remove_journal(folder: str | os.PathLike[str]) -> None:
    """Remove the journal, once the whole result is written."""
    (Path(folder) / JOURNAL_FILE).unlink(missing_ok=True)
