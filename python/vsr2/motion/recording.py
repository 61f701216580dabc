"""Reading and writing recordings; the table tells the kinds of file.

====================  ==============================================================================
format                content
====================  ==============================================================================
``csv``               neutral. Lines starting with ``#`` may come first; then the header line: two
                      to four of ``time_s``, ``displacement_m``, ``velocity_m_s`` and
                      ``acceleration_m_s2``, ``time_s`` among them; then one row a sample.
``npz``               neutral: ``sample_interval_s`` (a number) and ``displacement_m``,
                      ``velocity_m_s``, ``acceleration_m_s2`` or several of them (n,). The
                      laboratory's: ``sample_interval_s`` and ``displacement_volt``,
                      ``acceleration_g`` or both (n,).
``laboratory``        ``.txt``: a header line, then eight tab-separated columns: time [s],
                      acceleration [g], time, transverse acceleration, time, displacement [V], time,
                      transverse displacement.
``peer``              PEER NGA ``.AT2``, ``.VT2``, ``.DT2`` (:mod:`vsr2.motion.peer`); the header
                      tells the units.
``columns``           ``.txt``, ``.dat``, ``.asc``: time [s] and one value, in blanks, tabs, commas
                      or semicolons (:mod:`vsr2.motion.plain_text`); `units` must be given.
``tab``               ``.tab`` of the original system (:mod:`vsr2.motion.plain_text`); `units` must
                      be given.
``mseed``, ``sac``    through obspy (:mod:`vsr2.motion.seismology`); `units` must be given.
``knet``              K-NET and KiK-net ASCII (``.EW``, ``.NS``, ``.UD``), through obspy.
====================  ==============================================================================

The laboratory's displacement transducer gives inches = volts x 5.9797e-4. Its accelerometer points
against the transducer, so the accelerometer's sign is turned on reading: in a `Record` both
channels point along the displacement channel. Offsets at rest stay in a `Record`
(:mod:`vsr2.motion.processing` removes them).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from vsr2.config.bounded import UnreadableError, read_bounded
from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError
from vsr2.motion.motion import Array, Motion
from vsr2.motion.npz import NpzError, npz_arrays
from vsr2.motion.peer import is_peer, read_peer
from vsr2.motion.plain_text import read_columns, read_original_tab
from vsr2.motion.record import Record, file_record
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.seismology import read_obspy
from vsr2.motion.text_table import number_columns, text_lines, uniform_interval
from vsr2.motion.units import STANDARD_GRAVITY, UNITS
from vsr2.near_words import nearest

METRES_PER_VOLT = 5.9797e-4 * 0.0254
"""Scale of the laboratory's displacement transducer: inches per volt times metres per inch."""
MAX_FILE_BYTES = 256 * 1024**2
"""Greater files are refused unread."""

RecordFormat = Literal["csv", "npz", "laboratory", "peer", "columns", "tab", "mseed", "sac", "knet"]

_NEUTRAL = {
    "displacement_m": ("displacement", 1.0),
    "velocity_m_s": ("velocity", 1.0),
    "acceleration_m_s2": ("acceleration", 1.0),
}
"""Channel of each name in a file, and the factor to SI units."""
_LABORATORY = {
    "displacement_volt": ("displacement", METRES_PER_VOLT),
    "acceleration_g": ("acceleration", -STANDARD_GRAVITY),
}
_LABORATORY_COLUMNS = 8
"""Of a row in the laboratory's files."""
_LABORATORY_START = "Time [s]"
_SUFFIXES: dict[str, RecordFormat] = {
    ".csv": "csv",
    ".npz": "npz",
    ".at2": "peer",
    ".vt2": "peer",
    ".dt2": "peer",
    ".tab": "tab",
    ".mseed": "mseed",
    ".miniseed": "mseed",
    ".sac": "sac",
}
_TEXT_SUFFIXES = (".txt", ".dat", ".asc")
_KNET_SUFFIXES = (".ew", ".ns", ".ud")
_KNET_SUFFIX = re.compile(r"\.(ew|ns|ud)[12]?$")


def read_record(
    path: Path | str,
    *,
    format: RecordFormat | None = None,
    units: RecordUnits | None = None,
) -> Record:
    """Read a recording.

    Args:
        path: the file.
        format: of the table in this module's description; None: known by suffix and header.
        units: of the values, for a format that carries none; for others it must be None.

    Raises:
        MotionError: the file cannot be read, is not one of the kinds in this module's
            description, lacks `units` or carries its own; the message names file, row or array,
            value and remedy. No other exception leaves this function, whatever the file's bytes.
    """
    path = Path(path)
    if format is not None and format not in get_args(RecordFormat):
        near = nearest(str(format), get_args(RecordFormat))
        meant = f"did you mean {near!r}? " if near else ""
        known = ", ".join(get_args(RecordFormat))
        raise MotionError(f"{path}: format {format!r} is unknown; {meant}known: {known}")
    if units is not None and units not in UNITS:
        raise MotionError(f"{path}: units {units!r} are unknown; known: {', '.join(UNITS)}")
    try:
        content = read_bounded(path, MAX_FILE_BYTES, remedy="cut or decimate the record")
    except UnreadableError as error:
        raise MotionError(f"{path}: {error}") from None
    if not content:
        raise MotionError(f"{path}: the file is empty; export the record again")
    kind = format or _recognised(path, content)
    if kind in _WITHOUT_UNITS:
        return _WITHOUT_UNITS[kind](path, content, units)
    if units is not None:
        raise MotionError(
            f"{path}: its format carries its own units, so units={units!r} would have no effect; "
            "remove it"
        )
    return _CARRYING_UNITS[kind](path, content)


def write_record(record: Record | Motion, path: Path | str, *, note: str = "") -> None:
    """Write a record or a motion as neutral ``.csv``; reading it gives the same numbers.

    Args:
        record: every channel it has is written.
        path: ends in ``.csv``; an existing file is replaced.
        note: one line of comment at the top.

    Raises:
        MotionError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise MotionError(f"{path}: records are written as .csv; change the suffix")
    interval = record.time_step if isinstance(record, Motion) else record.sample_interval
    channels = {
        "displacement_m": record.displacement,
        "velocity_m_s": record.velocity,
        "acceleration_m_s2": record.acceleration,
    }
    named = {name: channel for name, channel in channels.items() if channel is not None}
    rows = [f"# {line}" for line in note.splitlines()]
    rows.append(",".join(["time_s", *named]))
    for index, values in enumerate(zip(*named.values(), strict=True)):
        # 12 digits tell the interval again; repr brings every number back to the last bit
        cells = [f"{index * interval:.12g}", *(repr(float(value)) for value in values)]
        rows.append(",".join(cells))
    try:
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    except (OSError, ValueError) as error:
        raise MotionError(f"{path}: cannot be written ({error})") from None


def _recognised(path: Path, content: bytes) -> RecordFormat:
    suffix = path.suffix.lower()
    if suffix in _SUFFIXES:
        return _SUFFIXES[suffix]
    if _KNET_SUFFIX.match(suffix):
        return "knet"
    start = content[:2000].decode("utf-8-sig", errors="replace")
    if start.startswith(_LABORATORY_START) and suffix == ".txt":
        return "laboratory"
    if is_peer(start):
        return "peer"
    if suffix in _TEXT_SUFFIXES:
        return "columns"
    raise MotionError(
        f"{path}: unknown kind of recording {path.suffix!r}; supported: "
        f"{', '.join((*_SUFFIXES, *_TEXT_SUFFIXES, *_KNET_SUFFIXES))}; give `format` where the "
        "suffix misleads (for a folder with other files set motion.pattern, for example '*.csv')"
    )


# --- text ---------------------------------------------------------------------------------------


def _read_csv(path: Path, content: bytes) -> Record:
    lines = text_lines(path, content)
    start = 0
    while start < len(lines) and lines[start].startswith("#"):
        start += 1
    header = [name.strip() for name in lines[start].split(",")] if start < len(lines) else []
    _check_csv_header(path, header, start + 1)
    columns = number_columns(path, lines, start + 1, ",", len(header))
    named = dict(zip(header, columns, strict=True))
    interval = uniform_interval(path, named["time_s"], start + 2)
    return file_record(path, content, interval, _in_si(named))


def _check_csv_header(path: Path, header: Sequence[str], row: int) -> None:
    known = set(header) <= {"time_s", *_NEUTRAL} and len(set(header)) == len(header)
    if not (known and "time_s" in header and len(header) > 1):
        shown = ",".join(header)[:100]
        raise MotionError(
            f"{path}: row {row}: header {shown!r}; expected `time_s` and one or more of "
            "displacement_m, velocity_m_s, acceleration_m_s2 (convert other units; read two plain "
            "columns by the format `columns`)"
        )


def _read_laboratory_text(path: Path, content: bytes) -> Record:
    lines = text_lines(path, content)
    if not lines[0].startswith(_LABORATORY_START):
        raise MotionError(
            f"{path}: row 1: {lines[0][:60]!r} is not the laboratory's header, which starts with "
            "'Time [s]'; save other records as .csv with the header `time_s,displacement_m`"
        )
    columns = number_columns(path, lines, 1, "\t", _LABORATORY_COLUMNS)
    time = columns[0]
    for number in (2, 4, 6):
        differs = np.flatnonzero(columns[number] != time)
        if differs.size:
            row = int(differs[0])
            raise MotionError(
                f"{path}: row {row + 2}: the time in column {number + 1} is "
                f"{columns[number][row]:g} s, in column 1 {time[row]:g} s; the channels must be "
                "sampled together: export them again"
            )
    channels = _in_si({"displacement_volt": columns[5], "acceleration_g": columns[1]})
    return file_record(path, content, uniform_interval(path, time, 2), channels)


def _in_si(named: Mapping[str, Array]) -> dict[str, Array]:
    """Channels in SI units out of arrays by their names in a file."""
    with np.errstate(over="ignore"):  # Record refuses an infinity and names the sample
        return {
            channel: named[name] * factor
            for name, (channel, factor) in (_NEUTRAL | _LABORATORY).items()
            if name in named
        }


# --- npz ----------------------------------------------------------------------------------------


def _read_npz(path: Path, content: bytes) -> Record:
    try:
        arrays = npz_arrays(content, _check_npz_names, max_dimensions=1, max_numbers=MAX_SAMPLES)
    except NpzError as error:
        raise MotionError(f"{path}: {error}") from None
    interval = arrays["sample_interval_s"]
    if interval.size != 1:
        raise MotionError(
            f"{path}: sample_interval_s has shape {interval.shape}; it is one number [s]"
        )
    seconds = float(interval.reshape(-1)[0])
    return file_record(path, content, seconds, _in_si(arrays))


def _check_npz_names(names: Collection[str]) -> None:
    channels = set(names) - {"sample_interval_s"}
    known = channels <= _NEUTRAL.keys() or channels <= _LABORATORY.keys()
    if not (channels and known and "sample_interval_s" in names):
        shown = ", ".join(sorted(names))[:200]
        raise NpzError(
            "",
            f"arrays {shown or 'none'}; expected sample_interval_s with one or more of "
            "displacement_m, velocity_m_s, acceleration_m_s2, or with displacement_volt or "
            "acceleration_g (or both)",
        )


_CARRYING_UNITS: dict[RecordFormat, Callable[[Path, bytes], Record]] = {
    "csv": _read_csv,
    "npz": _read_npz,
    "laboratory": _read_laboratory_text,
    "knet": partial(read_obspy, units="m/s^2", format="KNET"),
}
_WITHOUT_UNITS: dict[RecordFormat, Callable[[Path, bytes, RecordUnits | None], Record]] = {
    "peer": read_peer,
    "columns": read_columns,
    "tab": read_original_tab,
    "mseed": partial(read_obspy, format="MSEED"),
    "sac": partial(read_obspy, format="SAC"),
}
