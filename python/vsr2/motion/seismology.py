"""miniSEED, SAC and K-NET records, through obspy: an extra, `pip install vsr2[seismology]`."""

from __future__ import annotations

import io
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError
from vsr2.motion.motion import MAX_SAMPLES
from vsr2.motion.record import Record, one_channel_record
from vsr2.motion.units import UNITS, require_units

_KNET_START = b"Origin Time"


def read_miniseed(path: Path, content: bytes, units: RecordUnits | None) -> Record:
    """Read the one channel of a miniSEED file, values in `units` (the response is not removed).

    Raises:
        MotionError: as :func:`vsr2.motion.recording.read_record`; several channels or a gap; obspy
            is not installed.
    """
    require_units(path, "miniSEED", units)
    assert units is not None
    return _record(path, content, "MSEED", units)


def read_sac(path: Path, content: bytes, units: RecordUnits | None) -> Record:
    """Read a SAC file, values in `units`.

    Raises:
        MotionError: as :func:`read_miniseed`.
    """
    require_units(path, "SAC", units)
    assert units is not None
    return _record(path, content, "SAC", units)


def read_knet(path: Path, content: bytes) -> Record:
    """Read one component of K-NET or KiK-net ASCII; its scale factor gives acceleration.

    Raises:
        MotionError: as :func:`read_miniseed`.
    """
    if not content.startswith(_KNET_START):
        raise MotionError(
            f"{path}: does not start with 'Origin Time', so no K-NET ASCII; rename it, or give "
            "`format`"
        )
    return _record(path, content, "KNET", "m/s^2")


def _record(path: Path, content: bytes, format: str, units: str) -> Record:
    read = _obspy_reader(path)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            stream = read(io.BytesIO(content), format=format, apply_calib=format == "KNET")
            stream.merge()
            traces = [
                (trace.id, float(trace.stats.delta), trace.stats.npts, trace.data)
                for trace in stream
            ]
        except Exception as error:  # obspy raises what struct, numpy and libmseed happen to raise
            raise MotionError(
                f"{path}: not a readable {format} file ({type(error).__name__}: "
                f"{str(error)[:200]}); export it again"
            ) from None
    if len(traces) != 1:
        shown = ", ".join(str(trace[0]) for trace in traces)[:200]
        raise MotionError(
            f"{path}: {len(traces)} channels ({shown}); a record has one: write each to a file of "
            "its own"
        )
    ((_, interval, count, data),) = traces
    if count > MAX_SAMPLES:
        raise MotionError(f"{path}: {count} samples; at most {MAX_SAMPLES}: cut the record")
    if np.ma.isMaskedArray(data):
        missing = int(np.ma.getmaskarray(data).sum())
        raise MotionError(
            f"{path}: {missing} samples are missing (a gap); cut the record or fill the gap"
        )
    quantity, size = UNITS[units]
    with np.errstate(all="ignore"):  # Record refuses what does not fit and names the sample
        try:
            values = size * np.asarray(data, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise MotionError(
                f"{path}: holds no numbers ({error}); export the waveform, not a log"
            ) from None
    return one_channel_record(path, content, interval, quantity, values)


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
