"""The table of a result, `trials.csv`: one row a trial, full precision; an empty number: NaN."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.results.result import INTEGER_COLUMNS, OUTCOMES, STATUSES, TEXT_COLUMNS, TRIAL_COLUMNS

_MAX_TEXT_FILE = 2**31
"""Greatest table that is read [byte]."""
_BLOCK = 4096
"""Rows that are made into text at once: as text a row takes ten times its memory."""


def table_text(trials: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """The table of a result, columns TRIAL_COLUMNS, as CSV, in parts of some rows each."""
    yield ",".join(TRIAL_COLUMNS) + "\n"
    for start in range(0, len(trials["trial"]), _BLOCK):
        rows = slice(start, start + _BLOCK)
        columns = [_column_text(name, trials[name][rows]) for name in TRIAL_COLUMNS]
        yield "".join(",".join(row) + "\n" for row in zip(*columns, strict=True))


def _column_text(name: str, column: NDArray[Any]) -> list[str]:
    if name in TEXT_COLUMNS:
        # Always quoted: a name may hold commas and line breaks.
        return ['"' + str(value).replace('"', '""') + '"' for value in column]
    if name in INTEGER_COLUMNS:
        return [str(int(value)) for value in column]
    # `repr` is the shortest text that reads back to the same bits.
    return ["" if np.isnan(value) else repr(float(value)) for value in column]


def read_text(path: Path) -> str:
    """A text file, undecodable bytes kept as surrogates.

    Raises:
        ResultError: it cannot be read, or is too large.
    """
    try:
        if path.stat().st_size > _MAX_TEXT_FILE:
            raise ResultError(f"{path}: larger than {_MAX_TEXT_FILE} bytes; not a file of VSR2")
        return path.read_bytes().decode("utf-8", "surrogateescape")
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror})") from error


def read_table(path: Path, count: int) -> dict[str, NDArray[Any]]:
    """The table that :func:`table_text` wrote, bit for bit.

    Args:
        path: of the file.
        count: of trials that it must hold.

    Raises:
        ResultError: it is damaged or truncated; names trial and column.
    """
    text = read_text(path)
    remedy = "restore the file or run the study again"
    if not text.endswith("\n"):
        raise ResultError(f"{path}: truncated (no line end after the last row); {remedy}")
    try:
        header, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    except (csv.Error, ValueError) as error:
        raise ResultError(f"{path}: damaged ({error}); {remedy}") from error
    if tuple(header) != tuple(TRIAL_COLUMNS):
        raise ResultError(
            f"{path}: the first line must name the columns {','.join(TRIAL_COLUMNS)}; {remedy}"
        )
    if len(rows) != count:
        raise ResultError(
            f"{path}: has {counted(len(rows), 'row')} where provenance.json says {count}; {remedy}"
        )
    for i, row in enumerate(rows):
        if len(row) != len(header):
            raise ResultError(
                f"{path}: trial {i} has {counted(len(row), 'value')} for "
                f"{counted(len(header), 'column')}; {remedy}"
            )
    return {
        name: _parse_column(path, name, [row[j] for row in rows])
        for j, name in enumerate(TRIAL_COLUMNS)
    }


def _parse_column(path: Path, name: str, texts: list[str]) -> NDArray[Any]:
    column: NDArray[Any]
    if name in TEXT_COLUMNS:
        known = {"status": STATUSES, "outcome": OUTCOMES}.get(name)
        column = np.empty(len(texts), dtype=object)
        column[:] = texts
    else:
        known = None
        column = np.empty(len(texts), dtype=np.int64 if name in INTEGER_COLUMNS else np.float64)
    for i, text in enumerate(texts):
        try:
            if known is not None and text not in known:
                raise ValueError(f"known are {', '.join(known)}")
            if column.dtype == np.int64:
                column[i] = int(text)
            elif column.dtype == np.float64:
                column[i] = float(text) if text else np.nan
        except (ValueError, OverflowError) as error:
            raise ResultError(
                f"{path}: trial {i}, column {name}: {text!r} cannot be read ({error})"
            ) from error
    return column
