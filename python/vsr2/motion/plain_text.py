"""Records in plain text without units: two columns, and the original system's ``.tab``.

Two columns are time [s] and a value, in blanks, tabs, commas or semicolons. Lines that start with
``#``, ``%`` or ``!`` and one line of column names may come first.

The original (VSR2 on PyBullet and ROS 2) keeps its recordings as ``.tab``, in three forms: a title
and ``18000,0.005`` (number of samples, interval [s]); ``# number of velocity points: 754, dt:
0.005``; both with one value a line after it; or a table ``ground_motion_id``, ``time``,
``velocity`` with tabs. No form names a unit; by the PGV that the names of its files promise, its
own are velocities in m/s.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError
from vsr2.motion.record import Record, file_record
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.text_table import cell_number, number_columns, text_lines, uniform_interval
from vsr2.motion.units import require_units

_COMMENTS = ("#", "%", "!")
_POINTS = re.compile(
    r"^#\s*number of (displacement|velocity|acceleration) points:\s*(\d{1,9}),\s*dt:\s*(\S{1,30})$",
    re.IGNORECASE,
)
_COUNT = re.compile(r"^\s*(\d{1,9})\s*,\s*([0-9.eE+-]{1,30})\s*$")
_TABLE = re.compile(
    r"^ground_motion_id\ttime\t(displacement|velocity|acceleration)$", re.IGNORECASE
)


def read_columns(path: Path, content: bytes, units: RecordUnits | None) -> Record:
    """Read two columns, time [s] and a value in `units`.

    Raises:
        MotionError: as :func:`vsr2.motion.recording.read_record`.
    """
    lines = text_lines(path, content)
    kind = "two columns of text"
    if path.suffix.lower() == ".txt":
        kind = f"row 1, {lines[0][:40]!r}, is not the laboratory's header, so {kind}"
    quantity, size = require_units(path, kind, units)
    start = 0
    while start < len(lines) and lines[start].startswith(_COMMENTS):
        start += 1
    if start < len(lines) and not re.match(r"\s*[+-]?[.\d]", lines[start]):
        start += 1
    first = lines[start] if start < len(lines) else ""
    separator = next((mark for mark in ("\t", ",", ";") if mark in first), None)
    time, values = number_columns(path, lines, start, separator, 2)
    interval = uniform_interval(path, time, start + 1)
    return file_record(path, content, interval, {quantity: size * values})


def read_original_tab(path: Path, content: bytes, units: RecordUnits | None) -> Record:
    """Read a ``.tab`` of the original, values in `units`; its header is held to.

    Raises:
        MotionError: as :func:`vsr2.motion.recording.read_record`.
    """
    lines = text_lines(path, content)
    quantity, size = require_units(
        path, "a .tab of the original (its own files are velocities in m/s)", units
    )
    points, table = _POINTS.match(lines[0].strip()), _TABLE.match(lines[0].strip())
    named = points or table
    if named is not None and named[1].lower() != quantity:
        raise MotionError(
            f"{path}: row 1: holds {named[1].lower()}, units={units!r} is {quantity}; give the "
            "unit of the file"
        )
    if table is not None:
        ids, time, values = number_columns(path, lines, 1, "\t", 3)
        other = np.flatnonzero(ids != ids[0])
        if other.size:
            raise MotionError(
                f"{path}: row {int(other[0]) + 2}: a second ground motion, id {ids[other[0]]:g}, "
                f"after id {ids[0]:g}; write each to a file of its own"
            )
        interval = uniform_interval(path, time, 2)
        return file_record(path, content, interval, {quantity: size * values})
    if points is not None:
        start, count, interval = 1, int(points[2]), cell_number(path, 1, 0, points[3])
    else:
        plain = _COUNT.match(lines[1]) if len(lines) > 1 else None
        if plain is None:
            raise MotionError(
                f"{path}: rows 1 and 2: no header of the original: a title and then `18000,0.005`, "
                "`# number of velocity points: 754, dt: 0.005`, or `ground_motion_id`, `time`, "
                "`velocity`; read two plain columns with `--format columns`, in Python "
                "format='columns'"
            )
        start, count, interval = 2, int(plain[1]), cell_number(path, 2, 1, plain[2])
    if count > MAX_SAMPLES:
        raise MotionError(f"{path}: row {start}: {count} samples; at most {MAX_SAMPLES}")
    (values,) = number_columns(path, lines, start, None, 1)
    if values.size != count:
        raise MotionError(
            f"{path}: row {start}: promises {count} samples, the file holds {values.size}; copy it "
            "again, or correct the header"
        )
    return file_record(path, content, interval, {quantity: size * values})
