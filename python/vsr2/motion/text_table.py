"""Tables of numbers in text: rows, columns, and a uniform time column.

Time columns must increase and be uniform.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.record import MAX_INTERVAL, MIN_INTERVAL
from vsr2.motion.resample import MIN_RECORD_SAMPLES
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.one_line import counted

MAX_LINE = 10_000
"""Longest line [characters]."""
MAX_TIME = 1e7
"""Greatest time [s]; more is a date, or another unit."""


@dataclass(frozen=True)
class TimeColumnConstants:
    """How far a sample may be off its place in a uniform time column; chosen by hand.

    Attributes:
        off: of the sampling interval.
        printed: significant digits with which times are printed at least.
        rounding: times the rounding of these digits, which is added.
        lost: of the sampling interval, never to be reached, so that a lost sample is always found.
    """

    off: float = 0.01
    printed: int = 6
    rounding: float = 1.05
    lost: float = 0.45


TIME_COLUMN = TimeColumnConstants()


def text_lines(path: Path, content: bytes) -> list[str]:
    """The lines of a text file, without empty ones at its end."""
    rows = content.count(b"\n")
    if rows > MAX_SAMPLES + 1000:
        raise MotionError(
            f"{path}: {rows} rows; at most {MAX_SAMPLES} samples: cut or decimate the record"
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MotionError(
            f"{path}: byte {error.start} is not UTF-8 text; export the record as plain text"
        ) from None
    found = text.replace("\r\n", "\n").split("\n")
    while found and not found[-1].strip():
        found.pop()
    if not found:
        raise MotionError(f"{path}: the file is empty; export the record again")
    return found


def number_columns(
    path: Path, rows: Sequence[str], start: int, separator: str | None, count: int
) -> list[Array]:
    """The numbers of `rows[start:]`, one array a column; no separator: blanks."""
    if len(rows) - start > MAX_SAMPLES:
        raise MotionError(
            f"{path}: {len(rows) - start} rows; at most {MAX_SAMPLES} samples: cut or decimate "
            "the record"
        )
    table = np.empty((max(len(rows) - start, 0), count))
    for index, line in enumerate(rows[start:]):
        row = start + index + 1
        if len(line) > MAX_LINE:
            raise MotionError(
                f"{path}: row {row}: {counted(len(line), 'character')}; one row a sample"
            )
        cells = line.rstrip().split(separator)
        if len(cells) != count:
            raise MotionError(
                f"{path}: row {row}: {counted(len(cells), 'column')}, expected {count}; repair or "
                "remove the row"
            )
        for column, cell in enumerate(cells):
            table[index, column] = cell_number(path, row, column, cell)
    if len(table) < MIN_RECORD_SAMPLES:
        raise MotionError(
            f"{path}: {counted(len(table), 'sample')}; a record needs at least {MIN_RECORD_SAMPLES}"
        )
    return [np.ascontiguousarray(column) for column in table.T]


def cell_number(path: Path, row: int, column: int, cell: str) -> float:
    """The finite number in `cell`; `column` counts from 0, `row` from 1."""
    try:
        # Python reads 1_0 as 10; in a table it is a damaged cell
        value = float("" if "_" in cell else cell)
    except ValueError:
        raise MotionError(
            f"{path}: row {row}, column {column + 1}: {cell.strip()[:40]!r} is not a number; "
            "repair or remove the row"
        ) from None
    if not math.isfinite(value):
        raise MotionError(
            f"{path}: row {row}, column {column + 1}: {cell.strip()[:40]!r} is not finite; repair "
            "the sample or cut the record"
        )
    return value


def uniform_interval(path: Path, time: Array, first_row: int) -> float:
    """The interval of a uniform time column [s]."""
    absurd = np.flatnonzero(np.abs(time) > MAX_TIME)
    if absurd.size:
        row = int(absurd[0])
        raise MotionError(
            f"{path}: row {row + first_row}: time {time[row]:g} s; start the time at 0 s"
        )
    backwards = np.flatnonzero(np.diff(time) <= 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        raise MotionError(
            f"{path}: row {row + first_row}: time {time[row]:.12g} s does not come after "
            f"{time[row - 1]:.12g} s; time must increase: sort the rows or remove the doubled ones"
        )
    intervals = time.size - 1
    interval = float(time[-1] - time[0]) / intervals
    rounding = _printed_rounding(time)
    if MIN_INTERVAL <= interval <= MAX_INTERVAL:
        # The printed digits may not carry 800 Hz; the nearest whole rate within them is meant
        rate = round(1 / interval)
        possible = (rounding[0] + rounding[-1]) / intervals + 1e-12
        if rate > 0 and abs(1 / rate - interval) <= possible:
            interval = 1 / rate
    off = np.abs(time - time[0] - np.arange(time.size) * interval)
    rounded = rounding + rounding[0] + rounding[-1]
    allowed = np.minimum(
        TIME_COLUMN.off * interval + TIME_COLUMN.rounding * rounded, TIME_COLUMN.lost * interval
    )
    wrong = np.flatnonzero(off > allowed)
    if wrong.size:
        row = int(wrong[0])
        raise MotionError(
            f"{path}: row {row + first_row}: time {time[row]:.12g} s, expected "
            f"{time[0] + row * interval:.12g} s at a uniform {interval:.6g} s; "
            f"{counted(wrong.size, 'such row')}: fill the gaps or interpolate to uniform sampling"
        )
    return interval


def _printed_rounding(time: Array) -> Array:
    """Half a unit in the last significant digit of each time that is surely printed [s]."""
    magnitude = np.floor(np.log10(np.maximum(np.abs(time), 1e-6)))
    half_unit: Array = 0.5 * 10.0 ** (magnitude + 1 - TIME_COLUMN.printed)
    return half_unit
