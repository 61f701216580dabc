"""Files that are either whole or absent."""

from __future__ import annotations

import csv
import io
import math
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from vsr2.errors import ResultError

_REMEDY = "free space or choose another folder"


def write_atomic(path: Path, write: Callable[[BinaryIO], object], *, private: bool = False) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    Whatever stops the writing, `path` holds its old content or all of the new one.

    Args:
        path: the final name; its folder exists.
        write: writes the content to the open file.
        private: the file can be read by its owner alone, from its creation on.

    Raises:
        ResultError: naming `path` and why: no space, no permission, folder gone.
    """
    temporary = _temporary(path)
    try:
        try:
            # O_EXCL, so that two writers cannot share a temporary file.
            mode = 0o600 if private else 0o666
            descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with open(descriptor, "wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _sync_folder(path.parent)
    except OSError as error:
        raise ResultError(
            f"{path}: cannot be written ({error.strerror or error}); {_REMEDY}"
        ) from error


def write_text(path: Path, text: str, errors: str = "replace") -> None:
    """Write text as UTF-8, as :func:`write_atomic` does; `errors` as of `str.encode`."""
    content = text.encode("utf-8", errors)
    write_atomic(path, lambda file: file.write(content))


def csv_text(rows: Sequence[Mapping[str, Any]], number: str = "") -> str:
    """Rows of one form as CSV; None and numbers that are not finite are blank.

    Args:
        rows: none: the text is empty.
        number: format of numbers; empty: the shortest text that reads back to the same bits.
    """

    def cell(value: Any) -> Any:
        if isinstance(value, float):
            return format(float(value), number) if math.isfinite(value) else ""
        return value

    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: cell(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def make_folder(path: Path) -> None:
    """Make a folder where it is not there; its parent is.

    Raises:
        ResultError: it cannot be created.
    """
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise ResultError(f"{path}: cannot be created ({error.strerror or error})") from error


def link_atomic(origin: Path, path: Path) -> None:
    """Give a file that never changes a second name, or copy it where that cannot be.

    Raises:
        ResultError: naming `path` and why: no space, no permission, `origin` gone.
    """
    temporary = _temporary(path)
    try:
        os.link(origin, temporary)
    except OSError:
        try:
            content = origin.read_bytes()
        except OSError as error:
            raise ResultError(f"{origin}: cannot be read ({error.strerror or error})") from error
        write_atomic(path, lambda file: file.write(content))
        return
    try:
        os.replace(temporary, path)
    except OSError as error:
        raise ResultError(
            f"{path}: cannot be written ({error.strerror or error}); {_REMEDY}"
        ) from error
    finally:
        # Renaming onto a name of the same file does nothing, so that the temporary one stays.
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(6)}.tmp")


def _sync_folder(folder: Path) -> None:
    # Without this a crash of the machine may forget the rename.
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
