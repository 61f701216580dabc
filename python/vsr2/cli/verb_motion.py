"""`vsr2 motion`: measures, conversion, synthesis, fusion and rotation of ground motions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from vsr2.cli.options import Integer, Json, Overwrite, Quiet, print_json, target_file
from vsr2.config.motion_source import RecordUnits
from vsr2.config.section import DEFAULT_TIME_STEP
from vsr2.motion import Channel, Record, RecordFormat

verbs = App(name="motion")
Target = Annotated[Path, Parameter(help="the .csv file")]


@Parameter(name="*")
@dataclass(frozen=True)
class Reading:
    """How a recording is read.

    Attributes:
        format: of the files (default: recognised)
        units: of values whose format carries none
    """

    format: RecordFormat | None = None
    units: RecordUnits | None = None

    def read(self, file: Path) -> Record:
        """The recording in a file."""
        from vsr2.motion import read_record

        return read_record(file, format=self.format, units=self.units)


@Parameter(name="*")
@dataclass(frozen=True)
class Processing:
    """How a motion is made of a recording.

    Attributes:
        channel: that the motion follows (default: auto)
        baseline: degree of the polynomial to take off first
        filter: zero-phase Butterworth band-pass: LOW [Hz], HIGH [Hz], ORDER; LOW 0: low-pass
    """

    channel: Channel | None = None
    baseline: Integer | None = None
    filter: tuple[str, str, str] | None = None

    def arguments(self) -> dict[str, Any]:
        """As the functions of the room `motion` take them.

        Raises:
            ConfigError: the filter is impossible.
        """
        return {
            "channel": self.channel or "auto",
            "baseline": self.baseline,
            "filter": None if self.filter is None else _filter(self.filter),
        }


def _filter(values: tuple[str, str, str]) -> Any:
    from pydantic import ValidationError

    from vsr2.config.motion_source import Filter
    from vsr2.config.problems import dotted, problems_of
    from vsr2.errors import ConfigError

    try:
        low, high, order = values
        given = {"low": float(low), "high": float(high), "order": int(order)}
        return Filter.model_validate(given)
    except (ValueError, ValidationError) as error:
        reason = str(error)
        if isinstance(error, ValidationError):
            found = problems_of(error, Filter)
            reason = ", ".join(": ".join(filter(None, (dotted(p.path), p.what))) for p in found)
        raise ConfigError(
            f"--filter {' '.join(values)}: {reason}; give LOW and HIGH [Hz] and a whole "
            "ORDER from 1 to 10, for example --filter 0.1 25 3"
        ) from None


AS_IS, UNPROCESSED = Reading(), Processing()


@verbs.command
def info(
    files: Annotated[tuple[Path, ...], Parameter(consume_multiple=1)],
    /,
    *,
    reading: Reading = AS_IS,
    processing: Processing = UNPROCESSED,
    json: Json = False,
) -> int:
    """Intensity measures of records.

    At the records' own sampling; g = 9.80665 m/s^2.

    Args:
        files: recordings
    """
    from vsr2.motion import intensity_measures, warn_of_unusual_pga
    from vsr2.report.messages.commands import table

    rows = [
        intensity_measures(reading.read(file), **processing.arguments()).as_dict() for file in files
    ]
    warn_of_unusual_pga([(str(file), row["pga_g"]) for file, row in zip(files, rows, strict=True)])
    if json:
        named = [{"file": str(file), **row} for file, row in zip(files, rows, strict=True)]
        print_json(named)
        return 0
    cells = [
        (str(file), *(f"{value:.4g}" for value in row.values()))
        for file, row in zip(files, rows, strict=True)
    ]
    print(table([("file", *rows[0]), *cells]))
    return 0


@Parameter(name="*")
@dataclass(frozen=True)
class Scaling:
    """How a motion is changed.

    Attributes:
        scale: factor on the motion; negative mirrors it
        scale_to_pga_g: target PGA [g]
        time_step: resample to this [s] (default: the record's own)
    """

    scale: float | None = None
    scale_to_pga_g: float | None = None
    time_step: float | None = None


UNSCALED = Scaling()


@verbs.command
def convert(
    source: Path,
    /,
    *,
    out: Target,
    reading: Reading = AS_IS,
    processing: Processing = UNPROCESSED,
    scaling: Scaling = UNSCALED,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """Read any record, process it, write neutral .csv.

    Without processing options the channels are written as read, in SI units. With one, the motion
    as driven is written: displacement, velocity and acceleration, ends at rest.

    Args:
        source: recording
    """
    from vsr2.errors import MotionError
    from vsr2.motion import build_recorded_motion, warn_of_unusual_pga, write_record
    from vsr2.report.messages.data import motion_peaks

    pga_g = scaling.scale_to_pga_g
    if pga_g is not None and not (math.isfinite(pga_g) and pga_g > 0):
        raise MotionError(f"--scale-to-pga-g {pga_g:g}: give a PGA above 0, in g")
    record = reading.read(source)
    target = target_file(out, overwrite=overwrite)
    if processing == UNPROCESSED and scaling == UNSCALED:
        write_record(record, target, note=f"from {source.name}, channels as read")
        if not quiet:
            print(target)
        return 0
    motion = build_recorded_motion(
        record,
        record.sample_interval if scaling.time_step is None else scaling.time_step,
        **processing.arguments(),
        scale=1.0 if scaling.scale is None else scaling.scale,
    )
    if pga_g is not None:
        motion = motion.scaled_to_pga_g(pga_g, name=motion.name)
    warn_of_unusual_pga([(motion.name, motion.pga_g)])
    write_record(motion, target, note=motion.source)
    if not quiet:
        print(motion_peaks(motion, target))
    return 0


@verbs.command
def generate(
    *,
    out: Target,
    pga_g: float,
    pgv_pga_s: float,
    duration: float,
    seed: Integer = 0,
    time_step: float = DEFAULT_TIME_STEP,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """An earthquake-like motion with given measures.

    Seeded noise with an envelope and a Kanai-Tajimi spectrum, tuned to the measures: PGA exact,
    PGV/PGA within 1 %, significant duration within 3 %.

    Args:
        pga_g: [g]
        pgv_pga_s: PGV/PGA [s], 0.012 to 0.4
        duration: significant duration, 5-95 % [s]
        seed: of the noise
        time_step: [s]
    """
    from vsr2.motion import (
        intensity_measures,
        synthetic_motion,
        warn_of_unusual_pga,
        write_record,
    )
    from vsr2.report.messages.data import motion_measures

    motion = synthetic_motion(pga_g, pgv_pga_s, duration, seed, time_step)
    warn_of_unusual_pga([(motion.name, motion.pga_g)])
    write_record(motion, target_file(out, overwrite=overwrite), note=motion.source)
    if not quiet:
        print(motion_measures(intensity_measures(motion), out))
    return 0


@verbs.command
def fuse(
    source: Path,
    /,
    *,
    out: Target,
    reading: Reading = AS_IS,
    baseline: Integer | None = None,
    json: Json = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """One motion from a table's displacement and acceleration channels.

    Rauch-Tung-Striebel smoother over both channels, weighed by their noise at rest; prints how
    far they agree, band by band, and writes neutral .csv.

    Args:
        source: recording with both channels
        baseline: degree of the polynomial to take off first
    """
    from vsr2.motion import fuse as fuse_channels
    from vsr2.motion import input_uncertainty, write_record
    from vsr2.report.messages.commands import table

    record = reading.read(source)
    fused = fuse_channels(record, baseline=baseline)
    middle = fused.displacement.size // 2
    summary = {
        "rest_s": fused.noise.rest,
        "displacement_noise_m": fused.noise.displacement.deviation,
        "acceleration_noise_m_s2": fused.noise.acceleration.deviation,
        "consistency": fused.consistency,
        "displacement_error_m": float(fused.displacement_error[middle]),
        "velocity_error_m_s": float(fused.velocity_error[middle]),
        "acceleration_error_m_s2": float(fused.acceleration_error[middle]),
    }
    agreement = input_uncertainty(record)
    columns = {
        "low_hz": [low for low, _ in agreement.bands],
        "high_hz": [high for _, high in agreement.bands],
        "displacement_rms_m_s2": agreement.displacement_rms,
        "acceleration_rms_m_s2": agreement.acceleration_rms,
        "difference_rms_m_s2": agreement.difference_rms,
        "coherence": agreement.coherence,
        "gain": agreement.gain,
    }
    rows = zip(*columns.values(), strict=True)
    bands = [dict(zip(columns, map(float, row), strict=True)) for row in rows]
    motion = Record(
        name=record.name,
        sample_interval=fused.sample_interval,
        displacement=fused.displacement,
        velocity=fused.velocity,
        acceleration=fused.acceleration,
    )
    note = f"displacement and acceleration of {source.name} fused, sha256 {record.sha256}"
    write_record(motion, target_file(out, overwrite=overwrite), note=note)
    if json:
        print_json({**summary, "bands": bands})
        return 0
    if quiet:
        return 0
    for name, value in summary.items():
        print(f"{name}: {value:.4g}")
    print()
    cells = [["-" if isnan(v) else f"{v:.3g}" for v in band.values()] for band in bands]
    print(table([list(columns), *cells]))
    return 0


@verbs.command
def rotate(
    first: Path,
    second: Path,
    /,
    *,
    out: Path,
    azimuths: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (
        *map(float, range(0, 180, 15)),
    ),
    reading: Reading = AS_IS,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """Motions along rotated azimuths of two horizontal components, and RotD50 and RotD100.

    A study shakes along x alone: with `mode: all_recordings` it takes the folder, and so every
    azimuth in turn. docs/how-to/two_components.md explains.

    Args:
        first: component at azimuth 0
        second: component at azimuth 90
        out: folder for a .csv of each azimuth
        azimuths: from the first towards the second [degree] (default: every 15 from 0 to 165)
    """
    from vsr2.motion import rotated, rotd_pga_g, write_record
    from vsr2.report.messages.data import rotation_text

    pair = reading.read(first), reading.read(second)
    half, full = rotd_pga_g(*pair)
    records = [rotated(*pair, azimuth) for azimuth in azimuths]
    targets = [target_file(out / f"{one.name}.csv", overwrite=overwrite) for one in records]
    for record, target in zip(records, targets, strict=True):
        write_record(record, target, note=record.source)
    if not quiet:
        print(rotation_text(half, full, len(azimuths), out))
    return 0
