"""miniSEED, SAC and K-NET records, through obspy: an extra, `pip install vsr2[seismology]`."""

from __future__ import annotations

import io
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError
from vsr2.motion.record import Record, file_record
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.units import require_units
from vsr2.one_line import counted

ObspyFormat = Literal["MSEED", "SAC", "KNET"]


def read_obspy(
    path: Path, content: bytes, units: RecordUnits | None, *, format: ObspyFormat
) -> Record:
    """Read one channel (the instrument's response is not removed).

    Args:
        path: the file.
        content: its bytes.
        units: of the values; K-NET's scale factor gives m/s^2.
        format: obspy's name of it.

    Raises:
        MotionError: as :func:`vsr2.motion.recording.read_record`; several channels or a gap; obspy
            is not installed.
    """
    quantity, size = require_units(path, "miniSEED" if format == "MSEED" else format, units)
    if format == "KNET" and not content.startswith(b"Origin Time"):
        raise MotionError(
            f"{path}: does not start with 'Origin Time', so no K-NET ASCII; rename it, or give "
            "`format`"
        )
    read = _obspy_reader(path)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            stream = read(io.BytesIO(content), format=format, apply_calib=format == "KNET")
            traces = _merged(stream)
        except Exception as error:  # obspy raises what struct, numpy and libmseed happen to raise
            raise MotionError(
                f"{path}: not a readable {format} file ({type(error).__name__}: "
                f"{str(error)[:200]}); export it again"
            ) from None
    _, interval, data, _ = _only(traces, str(path), "write each to a file of its own")
    with np.errstate(all="ignore"):  # Record refuses what does not fit and names the sample
        try:
            values = size * np.asarray(data, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise MotionError(
                f"{path}: holds no numbers ({error}); export the waveform, not a log"
            ) from None
    return file_record(path, content, interval, {quantity: values})


class Samples(NamedTuple):
    """Id, sampling interval [s] and samples of a trace.

    `overlapping` is the number of samples that two traces state, when they were one.
    """

    name: str
    interval: float
    data: Any
    overlapping: int = 0


def one_trace(stream: Any) -> Samples:
    """Id, sampling interval [s] and samples (n,) of an obspy Trace, or a Stream of one channel.

    Raises:
        MotionError: neither of these, several channels, a gap, or traces that overlap and differ.
    """
    given = [stream] if hasattr(stream, "stats") else stream
    if not hasattr(given, "merge"):
        if not all(hasattr(trace, "stats") for trace in given):
            raise MotionError(
                f"from_obspy: got a {type(stream).__name__}; give an obspy Stream or Trace"
            )
        traces = [_samples(trace) for trace in given]
    else:
        traces = _merged(given.copy())  # as merging changes a stream
    return _only(traces, "from_obspy", "select one")


def _merged(stream: Any) -> list[Samples]:
    # The last of what it says of a gap is the number of samples, below 0 where traces overlap.
    overlapping = sum(max(0, -int(gap[-1])) for gap in stream.get_gaps())
    stream.merge()
    return [_samples(trace)._replace(overlapping=overlapping) for trace in stream]


def _samples(trace: Any) -> Samples:
    name = str(trace.id).strip(".") or "trace"
    return Samples(name, float(trace.stats.delta), trace.data)


def _only(traces: list[Samples], what: str, remedy: str) -> Samples:
    """The one trace that there is, without a gap."""
    if not traces:
        raise MotionError(f"{what}: holds no trace; a record has one channel")
    if len(traces) != 1:
        shown = ", ".join(trace[0] for trace in traces)[:200]
        raise MotionError(
            f"{what}: {counted(len(traces), 'channel')} ({shown}); a record has one: {remedy}"
        )
    [only] = traces
    data = only.data
    if len(data) > MAX_SAMPLES:
        raise MotionError(
            f"{what}: {counted(len(data), 'sample')}; at most {MAX_SAMPLES}: cut the record"
        )
    if np.ma.isMaskedArray(data):
        missing = int(np.ma.getmaskarray(data).sum())
        if only.overlapping:
            raise MotionError(
                f"{what}: {missing} samples are missing or disputed: traces overlap by "
                f"{only.overlapping} and differ there; cut one, or choose by obspy's "
                "`stream.merge(method=1)`"
            )
        raise MotionError(
            f"{what}: {missing} samples are missing (a gap); cut the record or fill the gap"
        )
    return only


def _obspy_reader(path: Path) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its own imports warn of what is deprecated
            return import_module("obspy").read
    except ImportError as error:
        raise MotionError(
            f"{path}: this format is read through obspy, which cannot be imported ({error}): "
            "`pip install vsr2[seismology]`, or convert the file to .csv"
        ) from None
