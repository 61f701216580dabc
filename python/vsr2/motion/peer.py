"""PEER NGA time series: AT2 (acceleration), VT2 (velocity), DT2 (displacement).

Three lines of title, the third telling quantity and unit (``ACCELERATION TIME SERIES IN UNITS OF
G``); a fourth with the number of samples and the sampling interval, as ``NPTS=  3930, DT= .00500
SEC`` or as ``4094    0.0100    NPTS, DT``; then the samples in rows of any length. Columns may run
together where a number is negative (``-.1234E-03-.5678E-03``).
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.record import Record, file_record
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.text_table import MAX_LINE, text_lines
from vsr2.motion.units import UNITS, Quantity, require_units, unit_in
from vsr2.one_line import counted

_HEADER_LINES = 20
"""Among which the line with NPTS and DT is sought."""
_REAL = r"(?:\d{1,20}\.?\d{0,20}|\.\d{1,20})(?:[EeDd][+-]?\d{1,3})?"
_COUNT_FIRST = re.compile(rf"^\s*(\d{{1,9}})\s+({_REAL})\s+NPTS\s*,\s*DT\b", re.IGNORECASE)
_NAMED = re.compile(rf"NPTS\s*=\s*(\d{{1,9}})\s*,?\s*DT\s*=\s*({_REAL})", re.IGNORECASE)
_UNITS = re.compile(r"\b(ACC\w*|VEL\w*|DIS\w*)\b.{0,60}?\bUNITS\s+OF\s+(\S{1,20})", re.IGNORECASE)
# a number ends at a blank, at the end, or at the sign of the next
_SAMPLE = re.compile(rf"\s*([+-]?{_REAL})(?=[\s+-]|$)")
_QUANTITIES: dict[str, Quantity] = {"a": "acceleration", "v": "velocity", "d": "displacement"}


def is_peer(start: str) -> bool:
    """Whether a file that starts so has a PEER header."""
    return any(_samples_and_interval(line) for line in start.splitlines()[:_HEADER_LINES])


def read_peer(path: Path, content: bytes, units: RecordUnits | None) -> Record:
    """Read an AT2, VT2 or DT2 file; the header tells the units, `units` where it does not.

    Raises:
        MotionError: as :func:`vsr2.motion.recording.read_record`.
    """
    lines = text_lines(path, content)
    row = next(
        (i for i, line in enumerate(lines[:_HEADER_LINES]) if _samples_and_interval(line)), None
    )
    if row is None:
        raise MotionError(
            f"{path}: no line `NPTS=..., DT=... SEC` or `... NPTS, DT` among the first "
            f"{_HEADER_LINES}; save other text as two columns (format `columns`)"
        )
    found = _samples_and_interval(lines[row])
    assert found is not None
    count, interval = found
    if not 0 < count <= MAX_SAMPLES:
        raise MotionError(
            f"{path}: row {row + 1}: NPTS is {count}, outside 1 to {MAX_SAMPLES}; correct it, or "
            "cut or decimate the record"
        )
    quantity, size = _quantity(path, lines[:row], units)
    values = size * _samples(path, lines, row + 1, count)
    return file_record(path, content, interval, {quantity: values})


def _samples_and_interval(line: str) -> tuple[int, float] | None:
    for style in (_NAMED, _COUNT_FIRST):
        match = style.search(line[:300])
        if match:
            return int(match[1]), _real(match[2])
    return None


def _quantity(path: Path, header: list[str], units: RecordUnits | None) -> tuple[Quantity, float]:
    suffix = path.suffix.lower()
    promised = _QUANTITIES.get(suffix[1:2]) if suffix.endswith("t2") else None
    for row, line in enumerate(header):
        match = _UNITS.search(line[:300])
        if match is None:
            continue
        unit = unit_in(match[2])
        stated = _QUANTITIES[match[1][0].lower()]
        if unit is None or UNITS[unit][0] != stated or (promised or stated) != stated:
            raise MotionError(
                f"{path}: row {row + 1}: {line.strip()[:80]!r} does not fit a {promised or stated} "
                f"in a unit we know ({', '.join(UNITS)}); correct the header or the suffix"
            )
        if units is not None and units != unit:
            raise MotionError(
                f"{path}: row {row + 1}: the header says {unit}, units={units!r} was given; remove "
                "it, or correct the header"
            )
        return UNITS[unit]
    quantity, size = require_units(path, "a PEER file whose header names no units", units)
    if (promised or quantity) != quantity:
        raise MotionError(
            f"{path}: a {suffix} file holds {promised}, units={units!r} is {quantity}; give the "
            "unit of the file"
        )
    return quantity, size


def _samples(path: Path, lines: list[str], start: int, count: int) -> Array:
    values: list[float] = []
    for row, line in enumerate(lines[start:], start + 1):
        if len(line) > MAX_LINE:
            raise MotionError(
                f"{path}: row {row}: {counted(len(line), 'character')}; at most {MAX_LINE}"
            )
        text = line.rstrip()
        at = 0
        while at < len(text):
            match = _SAMPLE.match(text, at)
            value = math.nan if match is None else _real(match[1])
            if match is None or not math.isfinite(value):
                raise MotionError(
                    f"{path}: row {row}: {text[at:].strip()[:40]!r} is no finite number; repair "
                    "the row"
                )
            values.append(value)
            at = match.end()
        if len(values) > count:
            break
    if len(values) != count:
        more = "more than" if len(values) > count else f"{len(values)} of"
        raise MotionError(
            f"{path}: holds {more} the {count} samples that NPTS promises; copy the file again, or "
            "correct NPTS"
        )
    return np.array(values)


def _real(text: str) -> float:
    return float(text.upper().replace("D", "E"))
