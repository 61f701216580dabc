"""Recordings: one type, and readers for three kinds of file.

====================  ==============================================================================
file                  content
====================  ==============================================================================
``.csv``              neutral. Lines starting with ``#`` may come first; then the header line
                      ``time_s,displacement_m``, ``time_s,acceleration_m_s2`` or with all three
                      columns; then one row a sample.
``.npz``, neutral     ``sample_interval_s`` (a number) and ``displacement_m``,
                      ``acceleration_m_s2`` or both (n,).
``.npz``, laboratory  ``sample_interval_s`` (a number) and ``displacement_volt``,
                      ``acceleration_g`` or both (n,).
``.txt``, laboratory  a header line, then eight tab-separated columns: time [s], acceleration [g],
                      time, transverse acceleration, time, displacement [V], time, transverse
                      displacement.
====================  ==============================================================================

The laboratory's displacement transducer gives inches = volts x 5.9797e-4. Its accelerometer points
against the transducer, so the accelerometer's sign is turned on reading: in a `Record` both
channels point along the displacement channel. Offsets at rest stay in a `Record`
(:mod:`vsr2.motion.processing` removes them).

Time columns must increase and be uniform. A sample may be off its place by 1 % of the sampling
interval plus the rounding of six printed digits, and never by 45 % or more, so that a lost sample
is always found.
"""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import MotionError
from vsr2.motion.measures import STANDARD_GRAVITY
from vsr2.motion.motion import MAX_SAMPLES, Array
from vsr2.motion.resample import MIN_RECORD_SAMPLES

METRES_PER_VOLT = 5.9797e-4 * 0.0254
"""Scale of the laboratory's displacement transducer: inches per volt times metres per inch."""
MAX_FILE_BYTES = 256 * 1024**2
"""Greater files are refused unread."""
MAX_DISPLACEMENT = 1000.0
"""[m]; more is a mistaken unit."""
MAX_ACCELERATION = 1.0e5
"""[m/s^2]; more is a mistaken unit."""
MIN_INTERVAL, MAX_INTERVAL = 1.0e-6, 1.0
"""Bounds of the sampling interval [s]."""

_SUFFIXES = ".csv, .npz, .txt"
_NEUTRAL_COLUMNS = ("time_s", "displacement_m", "acceleration_m_s2")
_NEUTRAL_KEYS = {"sample_interval_s", "displacement_m", "acceleration_m_s2"}
_LABORATORY_KEYS = {"sample_interval_s", "displacement_volt", "acceleration_g"}
_LABORATORY_COLUMNS = 8
_MAX_LINE = 10_000


@dataclass(frozen=True, eq=False)
class Record:
    """A recorded horizontal motion at its own sampling interval.

    Attributes:
        name: the file's name without its suffix, or any other.
        sample_interval: [s].
        displacement: shape (n,) [m], or None; as recorded, offset included.
        acceleration: shape (n,) [m/s^2], or None; positive along the displacement.
        source: the file it came from.
        sha256: hash of that file's bytes.

    The arrays are copies and read-only.

    Raises:
        MotionError: no channel; lengths differ; fewer than 16 or more than `MAX_SAMPLES` samples;
            NaN, infinity or an absurd value; a sampling interval outside 1e-6 to 1 s.
    """

    name: str
    sample_interval: float
    displacement: Array | None = None
    acceleration: Array | None = None
    source: str = ""
    sha256: str = ""

    def __post_init__(self) -> None:
        if not MIN_INTERVAL <= self.sample_interval <= MAX_INTERVAL:
            raise MotionError(
                f"{self.label}: sampling interval {self.sample_interval:g} s lies outside "
                f"{MIN_INTERVAL:g} to {MAX_INTERVAL:g} s; check the unit of time"
            )
        sizes = {}
        for field, unit, limit in (
            ("displacement", "m", MAX_DISPLACEMENT),
            ("acceleration", "m/s^2", MAX_ACCELERATION),
        ):
            if getattr(self, field) is not None:
                value = self._checked(field, unit, limit)
                object.__setattr__(self, field, value)
                sizes[field] = value.size
        if not sizes:
            raise MotionError(f"{self.label}: has neither displacement nor acceleration")
        if len(set(sizes.values())) > 1:
            raise MotionError(
                f"{self.label}: displacement has {sizes['displacement']} samples, acceleration "
                f"{sizes['acceleration']}; they must have the same number"
            )

    def _checked(self, field: str, unit: str, limit: float) -> Array:
        try:
            value = np.array(getattr(self, field), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise MotionError(f"{self.label}: {field} is no array of numbers ({error})") from None
        value.setflags(write=False)
        if value.ndim != 1 or not MIN_RECORD_SAMPLES <= value.size <= MAX_SAMPLES:
            raise MotionError(
                f"{self.label}: {field} has shape {value.shape}; it needs one dimension and "
                f"{MIN_RECORD_SAMPLES} to {MAX_SAMPLES} samples"
            )
        bad = np.flatnonzero(~(np.abs(value) <= limit))
        if bad.size:
            remedy = "check the unit" if np.isfinite(value[bad[0]]) else "repair or cut the record"
            raise MotionError(
                f"{self.label}: {field} is {value[bad[0]]:g} {unit} at sample {bad[0]} "
                f"(t = {bad[0] * self.sample_interval:g} s), beyond {limit:g} {unit}; {bad.size} "
                f"such samples; {remedy}"
            )
        return value

    @property
    def label(self) -> str:
        """The file, or the name where there is none; for messages."""
        return self.source or f"record {self.name!r}"

    @property
    def size(self) -> int:
        """Number of samples."""
        channel = self.acceleration if self.displacement is None else self.displacement
        assert channel is not None
        return channel.size

    @property
    def sample_rate(self) -> float:
        """[Hz]."""
        return 1 / self.sample_interval

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return (self.size - 1) * self.sample_interval


def read_record(path: Path | str) -> Record:
    """Read a recording; the suffix and, for ``.npz``, the names in the file tell its kind.

    Raises:
        MotionError: the file cannot be read or is not one of the kinds in this module's
            description; the message names file, row or array, value and remedy. No other
            exception leaves this function, whatever the file's bytes.
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".npz": _read_npz, ".txt": _read_laboratory_text}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise MotionError(
            f"{path}: unknown kind of recording {path.suffix!r}; supported: {_SUFFIXES} "
            "(for a folder with other files set motion.pattern, for example '*.csv')"
        )
    return reader(path, _read_bytes(path))


def _read_bytes(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise MotionError(f"{path}: no such file; check the path in the study")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise MotionError(
                f"{path}: {size} bytes; at most {MAX_FILE_BYTES}: cut or decimate the record"
            )
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES)
    except (OSError, ValueError) as error:
        raise MotionError(f"{path}: cannot be read ({error})") from None
    if not content:
        raise MotionError(f"{path}: the file is empty; export the record again")
    return content


# --- text ---------------------------------------------------------------------------------------


def _read_csv(path: Path, content: bytes) -> Record:
    lines = _lines(path, content)
    start = 0
    while start < len(lines) and lines[start].startswith("#"):
        start += 1
    header = [name.strip() for name in lines[start].split(",")] if start < len(lines) else []
    _check_csv_header(path, header, start + 1)
    columns = _columns(path, lines, start + 1, ",", len(header))
    named = dict(zip(header, columns, strict=True))
    return Record(
        name=path.stem,
        sample_interval=_sample_interval(path, named["time_s"], start + 2),
        displacement=named.get("displacement_m"),
        acceleration=named.get("acceleration_m_s2"),
        source=str(path),
        sha256=hashlib.sha256(content).hexdigest(),
    )


def _check_csv_header(path: Path, header: Sequence[str], row: int) -> None:
    known = set(header) <= set(_NEUTRAL_COLUMNS) and len(set(header)) == len(header)
    if not (known and "time_s" in header and len(header) > 1):
        shown = ",".join(header)[:100]
        raise MotionError(
            f"{path}: row {row}: header {shown!r}; expected `time_s,displacement_m`, "
            "`time_s,acceleration_m_s2` or `time_s,displacement_m,acceleration_m_s2` (SI units: "
            "convert other ones)"
        )


def _read_laboratory_text(path: Path, content: bytes) -> Record:
    lines = _lines(path, content)
    if not lines[0].startswith("Time [s]"):
        raise MotionError(
            f"{path}: row 1: {lines[0][:60]!r} is not the laboratory's header, which starts with "
            "'Time [s]'; save other records as .csv with the header `time_s,displacement_m`"
        )
    columns = _columns(path, lines, 1, "\t", _LABORATORY_COLUMNS)
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
    return _laboratory_record(
        path,
        content,
        sample_interval=_sample_interval(path, time, 2),
        displacement_volt=columns[5],
        acceleration_g=columns[1],
    )


def _laboratory_record(
    path: Path,
    content: bytes,
    *,
    sample_interval: float,
    displacement_volt: Array | None,
    acceleration_g: Array | None,
) -> Record:
    with np.errstate(over="ignore"):  # Record refuses an infinity and names the sample
        return Record(
            name=path.stem,
            sample_interval=sample_interval,
            displacement=None if displacement_volt is None else displacement_volt * METRES_PER_VOLT,
            acceleration=None if acceleration_g is None else -acceleration_g * STANDARD_GRAVITY,
            source=str(path),
            sha256=hashlib.sha256(content).hexdigest(),
        )


def _lines(path: Path, content: bytes) -> list[str]:
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
    lines = text.replace("\r\n", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise MotionError(f"{path}: the file is empty; export the record again")
    return lines


def _columns(
    path: Path, lines: Sequence[str], start: int, separator: str, count: int
) -> list[Array]:
    """The numbers of `lines[start:]`, one array a column."""
    if len(lines) - start > MAX_SAMPLES:
        raise MotionError(
            f"{path}: {len(lines) - start} rows; at most {MAX_SAMPLES} samples: cut or decimate "
            "the record"
        )
    table = np.empty((max(len(lines) - start, 0), count))
    for index, line in enumerate(lines[start:]):
        row = start + index + 1
        if len(line) > _MAX_LINE:
            raise MotionError(f"{path}: row {row}: {len(line)} characters; one row a sample")
        cells = line.rstrip().split(separator)
        if len(cells) != count:
            raise MotionError(
                f"{path}: row {row}: {len(cells)} columns, expected {count}; repair or remove "
                "the row"
            )
        for column, cell in enumerate(cells):
            table[index, column] = _number(path, row, column, cell)
    if len(table) < MIN_RECORD_SAMPLES:
        raise MotionError(
            f"{path}: {len(table)} samples; a record needs at least {MIN_RECORD_SAMPLES}"
        )
    return [np.ascontiguousarray(column) for column in table.T]


def _number(path: Path, row: int, column: int, cell: str) -> float:
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


def _sample_interval(path: Path, time: Array, first_row: int) -> float:
    """The interval of a uniform time column [s]."""
    absurd = np.flatnonzero(np.abs(time) > 1e7)
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
        # six printed digits do not carry 800 Hz; the nearest whole rate within them is meant
        rate = round(1 / interval)
        possible = (rounding[0] + rounding[-1]) / intervals + 1e-12
        if rate > 0 and abs(1 / rate - interval) <= possible:
            interval = 1 / rate
    off = np.abs(time - time[0] - np.arange(time.size) * interval)
    allowed = np.minimum(
        0.01 * interval + 1.05 * (rounding + rounding[0] + rounding[-1]), 0.45 * interval
    )
    wrong = np.flatnonzero(off > allowed)
    if wrong.size:
        row = int(wrong[0])
        raise MotionError(
            f"{path}: row {row + first_row}: time {time[row]:.12g} s, expected "
            f"{time[0] + row * interval:.12g} s at a uniform {interval:.6g} s; {wrong.size} such "
            "rows: fill the gaps or interpolate to uniform sampling"
        )
    return interval


def _printed_rounding(time: Array) -> Array:
    """Half a unit in the sixth significant digit of each time [s]."""
    magnitude = np.floor(np.log10(np.maximum(np.abs(time), 1e-6)))
    half_unit: Array = 0.5 * 10.0 ** (magnitude - 5)
    return half_unit


# --- npz ----------------------------------------------------------------------------------------


def _read_npz(path: Path, content: bytes) -> Record:
    arrays = _npz_arrays(path, content)
    interval = arrays["sample_interval_s"]
    if interval.size != 1:
        raise MotionError(
            f"{path}: sample_interval_s has shape {interval.shape}; it is one number [s]"
        )
    seconds = float(interval.reshape(-1)[0])
    if arrays.keys() <= _NEUTRAL_KEYS:
        return Record(
            name=path.stem,
            sample_interval=seconds,
            displacement=arrays.get("displacement_m"),
            acceleration=arrays.get("acceleration_m_s2"),
            source=str(path),
            sha256=hashlib.sha256(content).hexdigest(),
        )
    return _laboratory_record(
        path,
        content,
        sample_interval=seconds,
        displacement_volt=arrays.get("displacement_volt"),
        acceleration_g=arrays.get("acceleration_g"),
    )


def _npz_arrays(path: Path, content: bytes) -> Mapping[str, Array]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = {name.removesuffix(".npy"): name for name in archive.namelist()}
            _check_npz_names(path, names.keys())
            return {key: _npy_array(path, archive, name) for key, name in names.items()}
    except MotionError:
        raise
    except Exception as error:  # a damaged archive raises what zipfile and numpy happen to raise
        raise MotionError(
            f"{path}: not a readable .npz file ({type(error).__name__}: {error}); write it again "
            "with numpy.savez"
        ) from None


def _check_npz_names(path: Path, names: Iterable[str]) -> None:
    given = set(names)
    kinds = (_NEUTRAL_KEYS, _LABORATORY_KEYS)
    if not any("sample_interval_s" in given <= kind and len(given) > 1 for kind in kinds):
        shown = ", ".join(sorted(given))[:200]
        raise MotionError(
            f"{path}: arrays {shown or 'none'}; expected sample_interval_s with displacement_m or "
            "acceleration_m_s2 (or both), or with displacement_volt or acceleration_g (or both)"
        )


def _npy_array(path: Path, archive: zipfile.ZipFile, name: str) -> Array:
    """One array of real numbers; its header is judged before its data are read or unpacked."""
    with archive.open(name) as file:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, _, dtype = np.lib.format.read_array_header_2_0(file)
        else:
            raise MotionError(f"{path}: {name}: .npy version {version}; write it with numpy.savez")
        if dtype.kind not in "fiu" or dtype.itemsize > 16:
            raise MotionError(
                f"{path}: {name}: holds {dtype}, expected real numbers; convert it to float64"
            )
        if len(shape) > 1 or not 0 < math.prod(shape) <= MAX_SAMPLES:
            raise MotionError(
                f"{path}: {name}: has shape {shape}; it needs at most one dimension and 1 to "
                f"{MAX_SAMPLES} samples"
            )
        wanted = math.prod(shape) * dtype.itemsize
        data = file.read(wanted)
    if len(data) != wanted:
        raise MotionError(
            f"{path}: {name}: cut short, {len(data)} of {wanted} bytes; copy the file again"
        )
    raw: NDArray[np.generic] = np.frombuffer(data, dtype=dtype)
    with np.errstate(all="ignore"):  # Record refuses what does not fit and names the sample
        return raw.astype(np.float64).reshape(shape)
