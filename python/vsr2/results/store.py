"""The store of finished work: one file that one process appends to, and that survives `kill -9`.

JSON lines: a header that says what the file is and to what it belongs, then one record a line. A
record is appended by a single write. However the process ends, the file holds whole lines and at
most one torn last line, which the next writer drops. Each record ends with a checksum of what
stands before it, so that a line that was changed by hand, or by a disk, is not taken. While a
process has a store open it holds a lock on the file, where the file system has locks. Others may
read it at the same time.
"""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from vsr2.config.problems import shown
from vsr2.errors import ResultError

MAX_BYTES = 2**32
"""Largest store that is read."""
CHECKSUM = "crc32"
"""Key of a record's checksum: CRC-32 of the record's text without it, eight hexadecimal digits."""

Take = Callable[[dict[str, Any]], None]
"""Takes a record; ValueError, KeyError, TypeError, OverflowError: it is damaged."""


@dataclass(frozen=True)
class StoreKind:
    """A sort of store.

    Attributes:
        format: its name.
        version: of its records; another is refused.
        foreign: what a file of another identity is, and what to do about it.
        damaged: what to do about a damaged file.
        unsummed: whether a record without checksum is taken: older VSR2 wrote none.
    """

    format: str
    version: int | str
    foreign: str
    damaged: str = "start again with `--overwrite`"
    unsummed: bool = False


class Store:
    """A store open for writing.

    Args:
        path: of the file, made where it is not; its folder exists.
        kind: what it holds.
        identity: of what its records belong to (JSON values).
        take: called with every record that the file holds already.

    Raises:
        ResultError: the file belongs to something else, is damaged before its last line, is
            written by another process, or cannot be written to.
    """

    def __init__(
        self, path: Path, kind: StoreKind, identity: Mapping[str, Any], take: Take
    ) -> None:
        self._path = path
        try:
            _check_regular(path)
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
            try:
                _lock(self._file, path)
                end = read_store(path, kind, identity, take)
                os.ftruncate(self._file, end)
                os.lseek(self._file, 0, os.SEEK_END)
                if end == 0:
                    self._write(_text(_header(kind, identity)))
            except BaseException:
                os.close(self._file)
                raise
        except OSError as error:
            remedy = "free space or choose another folder"
            if isinstance(error, FileNotFoundError):
                remedy = f"make {path.parent} first, in Python with vsr2.results.prepare_folder"
            raise ResultError(f"{path}: cannot be used ({error.strerror}); {remedy}") from error

    def add(self, *records: dict[str, Any]) -> None:
        """Append records, by one write.

        Raises:
            ResultError: they cannot be written.
        """
        try:
            self._write(*(_summed(_text(one)) for one in records))
        except OSError as error:
            raise ResultError(
                f"{self._path}: cannot be written ({error.strerror}); free space and resume"
            ) from error

    def _write(self, *texts: str) -> None:
        lines = "".join(f"{text}\n" for text in texts).encode()
        start = os.lseek(self._file, 0, os.SEEK_CUR)
        if os.write(self._file, lines) != len(lines):
            # A full disk takes part of it; take it back, so that later lines stay readable.
            os.ftruncate(self._file, start)
            os.lseek(self._file, start, os.SEEK_SET)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None:
        """Close the file; it stays."""
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def read_store(path: Path, kind: StoreKind, identity: Mapping[str, Any], take: Take) -> int:
    """Read a store and leave it as it is: another process may write it.

    Args:
        path: of the file.
        kind: what it holds.
        identity: of what its records belong to.
        take: called with every record.

    Returns:
        Where the last whole line ends [byte].

    Raises:
        ResultError: it cannot be read, belongs to something else, or is damaged before its last
            line.
    """
    _check_regular(path)
    header = _header(kind, identity)
    end = 0
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ResultError(f"{path}: over {MAX_BYTES} bytes; not a file of VSR2")
        with path.open("rb") as file:
            for number, line in enumerate(file):
                changed = False
                if not line.endswith(b"\n"):
                    break
                try:
                    entry = _record(line)
                    if number == 0:
                        _check_header(path, kind, entry, header)
                    else:
                        # First what a value is: that says more than that some value changed.
                        take(entry)
                        changed = _is_changed(line, entry, kind)
                except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
                    raise ResultError(
                        f"{path}:{number + 1}: damaged ({_reason(error)}); {kind.damaged}"
                    ) from None
                if changed:
                    raise ResultError(
                        f"{path}:{number + 1}: was changed after it was written (its checksum "
                        "differs); remove this line, and what it holds is done again"
                    )
                end += len(line)
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror})") from error
    return end


def odd_value(key: str, value: object, wanted: str) -> ValueError:
    """That a value of a record is none that VSR2 wrote, for a store's `take`."""
    return ValueError(f"{key} is {shown(value)}, not {wanted}")


def is_number(value: object, *, whole: bool = False) -> bool:
    """Whether a value of a record is a finite number with a point or an exponent.

    Args:
        value: as JSON gives it; true and false are no numbers.
        whole: whole numbers below 2^63 in size count, too.
    """
    if whole and type(value) is int:
        return abs(value) < 2**63
    return isinstance(value, float) and math.isfinite(value)


def _text(record: Mapping[str, Any]) -> str:
    return json.dumps(record, separators=(",", ":"))


def _summed(text: str) -> str:
    """The text of a record, which has a key, with its checksum as the last one."""
    return f'{text[:-1]},"{CHECKSUM}":"{zlib.crc32(text.encode()):08x}"}}'


def _is_changed(line: bytes, entry: Mapping[str, Any], kind: StoreKind) -> bool:
    """Whether a line of the file is another than was written.

    Raises:
        KeyError: it has no checksum, and records of this kind have one.
    """
    if CHECKSUM not in entry:
        if kind.unsummed:
            return False
        raise KeyError(CHECKSUM)
    before = line.rpartition(f',"{CHECKSUM}":'.encode())[0].decode()
    return _summed(f"{before}}}").encode() != line[:-1]


def _record(line: bytes) -> dict[str, Any]:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("is no JSON of VSR2") from None
    if not isinstance(entry, dict):
        raise ValueError("is no record")
    return entry


def _reason(error: Exception) -> str:
    """What is wrong with a record, without the words of the language."""
    match error:
        case KeyError():
            return f"{error.args[0]} is missing"
        case TypeError() | OverflowError() | RecursionError():
            return "a value has another type or size"
    return str(error)


def refuse_written(path: Path) -> None:
    """Refuse a store that another process has open.

    Raises:
        ResultError: it is locked.
    """
    try:
        file = os.open(path, os.O_WRONLY)
    except OSError:
        return  # There is none, or whoever uses it next tells why it cannot.
    try:
        _lock(file, path)
    finally:
        os.close(file)


def _lock(file: int, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno == errno.EWOULDBLOCK:
            raise ResultError(
                f"{path}: another process is writing it; let that one finish, or end it"
            ) from error
        # A file system without locks, as some networks have: nothing to hold on to.


def _header(kind: StoreKind, identity: Mapping[str, Any]) -> dict[str, Any]:
    return {"format": kind.format, "version": kind.version, **identity}


def _check_header(path: Path, kind: StoreKind, entry: Any, header: Mapping[str, Any]) -> None:
    if not isinstance(entry, dict) or entry.get("format") != kind.format:
        raise ValueError(f"no {kind.format}")
    if entry.get("version") != kind.version:
        raise ResultError(
            f"{path}: is a {kind.format} of version {entry.get('version')!r}, this VSR2 has "
            f"{kind.version!r}; use the VSR2 that wrote it, or {kind.damaged}"
        )
    if entry != header:
        raise ResultError(f"{path}: {kind.foreign}")


def _check_regular(path: Path) -> None:
    if path.exists() and not path.is_file():
        raise ResultError(f"{path}: is no regular file; choose another folder")
