"""From the study's motion section to the motions of its trials."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal, Never, assert_never

from vsr2.config.study import (
    AllRecordings,
    Filter,
    GridCosine,
    MotionSource,
    SingleCosine,
    SingleRecording,
)
from vsr2.errors import MotionError
from vsr2.motion.cosine import (
    cosine_motion,
    cosine_name,
    cosine_parameters,
    grid_parameters,
    grid_values,
)
from vsr2.motion.motion import Motion
from vsr2.motion.processing import (
    band_pass,
    integrate_acceleration,
    taper_ends,
)
from vsr2.motion.recording import Record, read_record
from vsr2.motion.resample import resample

MAX_MOTIONS = 100_000
"""Most motions of one study."""
MAX_TOTAL_SAMPLES = 50_000_000
"""Most samples of all motions of one study together: 1.2 GB."""

Channel = Literal["auto", "displacement", "acceleration"]


def build_motions(source: MotionSource, time_step: float) -> list[Motion]:
    """The motions of a study, one a trial (the four modes of supplement S1.3).

    Names are unique. A grid runs over PGA, and for each PGA over PGV/PGA; recordings come in the
    order of their file names.

    Args:
        source: paths in it are absolute or relative to the working directory.
        time_step: of the simulation [s].

    Raises:
        MotionError: a file cannot be used, no file matches, or there are more than `MAX_MOTIONS`
            motions or `MAX_TOTAL_SAMPLES` samples in all.
    """
    match source:
        case SingleCosine():
            return [_single_cosine(source, time_step)]
        case GridCosine():
            return _grid_cosine(source, time_step)
        case SingleRecording():
            return [_from_file(source.file, source, time_step)]
        case AllRecordings():
            return _all_recordings(source, time_step)
    assert_never(source)


def build_recorded_motion(
    record: Record,
    time_step: float,
    *,
    channel: Channel = "auto",
    filter: Filter | None = None,
    scale: float = 1.0,
    name: str | None = None,
) -> Motion:
    """The motion that a record asks of the pedestal.

    The original drives recordings from the displacement channel after a band-pass 0.1-25 Hz of
    order 3; that is `channel="displacement"` (or "auto") with `filter=Filter()`. The displacement
    channel keeps its sign. The steps are those of :mod:`vsr2.motion.processing`, then
    :func:`vsr2.motion.resample.resample`.

    Args:
        record: at its own sampling interval.
        time_step: of the simulation [s].
        channel: which one drives; "auto": displacement where there is one.
        filter: band-pass at the record's own sampling; None: none. A raw displacement channel
            should have one: its noise is small, its second derivative is not.
        scale: factor on the motion; negative mirrors it.
        name: of the motion; by default the record's.

    Raises:
        MotionError: the channel is missing, the filter does not fit the sampling, or the record
            cannot be resampled at `time_step`.
    """
    if not math.isfinite(scale) or scale == 0:
        raise MotionError(f"{record.label}: scale {scale} must be finite and not 0")
    interval = record.sample_interval
    used = channel
    if used == "auto":
        used = "acceleration" if record.displacement is None else "displacement"
    if used == "displacement":
        if record.displacement is None:
            _missing(record, "displacement", "acceleration")
        displacement = record.displacement
        if filter is not None:
            displacement = band_pass(displacement, interval, filter, name=record.label)
    else:
        if record.acceleration is None:
            _missing(record, "acceleration", "displacement")
        displacement = integrate_acceleration(
            record.acceleration, interval, filter, name=record.label
        )
    driven = resample(
        scale * taper_ends(displacement, interval), interval, time_step, name=record.label
    )
    treatment = "no filter"
    if filter is not None:
        treatment = f"band-pass {filter.low:g}-{filter.high:g} Hz order {filter.order}"
    return Motion(
        name=record.name if name is None else name,
        time_step=time_step,
        displacement=driven.displacement,
        velocity=driven.velocity,
        acceleration=driven.acceleration,
        kind="recording",
        source=(
            f"{record.label}, sha256 {record.sha256 or 'none'}, {used} channel, {treatment}, "
            f"scale {scale:.12g}, sampled every {interval:.9g} s"
        ),
        resampling_error=driven.error,
        resampling_error_rms=driven.error_rms,
    )


def _single_cosine(source: SingleCosine, time_step: float) -> Motion:
    if source.amplitude is not None and source.frequency is not None:
        return cosine_motion(source.amplitude, source.frequency, time_step)
    assert source.pga is not None
    assert source.pgv_pga is not None
    return _cosine(source.pga, source.pgv_pga, time_step)


def _cosine(pga: float, pgv_pga: float, time_step: float) -> Motion:
    amplitude, frequency = cosine_parameters(pga, pgv_pga)
    return cosine_motion(amplitude, frequency, time_step, name=cosine_name(pga, pgv_pga))


def _grid_cosine(grid: GridCosine, time_step: float) -> list[Motion]:
    pgas, ratios = grid_values(grid.pga), grid_values(grid.pgv_pga)
    count = len(pgas) * len(ratios)
    if count > MAX_MOTIONS:
        raise MotionError(
            f"grid_cosine: {len(pgas)} values of pga times {len(ratios)} of pgv_pga give {count} "
            f"motions; at most {MAX_MOTIONS}: raise a `step`"
        )
    _check_total(
        len(pgas) * sum(2 * math.pi * ratio / time_step + 2 for ratio in ratios), "grid_cosine"
    )
    return [_cosine(pga, ratio, time_step) for pga, ratio in grid_parameters(grid)]


def _all_recordings(source: AllRecordings, time_step: float) -> list[Motion]:
    files = _matching_files(source.folder, source.pattern)
    motions: list[Motion] = []
    total = 0
    for file, name in zip(files, _unique_names(files), strict=True):
        motions.append(_from_file(file, source, time_step, name=name))
        total += motions[-1].displacement.size
        _check_total(total, str(source.folder))
    return motions


def _from_file(
    file: Path,
    source: SingleRecording | AllRecordings,
    time_step: float,
    *,
    name: str | None = None,
) -> Motion:
    return build_recorded_motion(
        read_record(file),
        time_step,
        channel=source.channel,
        filter=source.filter,
        scale=source.scale,
        name=name,
    )


def _matching_files(folder: Path, pattern: str) -> list[Path]:
    hidden = pattern.startswith(".")
    try:
        if not folder.is_dir():
            raise MotionError(f"{folder}: no such folder; check motion.folder")
        files = sorted(
            (
                path
                for path in folder.iterdir()
                if fnmatchcase(path.name, pattern)
                and (hidden or not path.name.startswith("."))
                and path.is_file()
            ),
            key=lambda path: path.name,
        )
    except (OSError, ValueError) as error:
        raise MotionError(f"{folder}: cannot be listed ({error})") from None
    if not files:
        raise MotionError(
            f"{folder}: no file matches the pattern {pattern!r}; check motion.folder and "
            "motion.pattern"
        )
    if len(files) > MAX_MOTIONS:
        raise MotionError(
            f"{folder}: {len(files)} files match {pattern!r}; at most {MAX_MOTIONS}: narrow "
            "motion.pattern"
        )
    return files


def _unique_names(files: Iterable[Path]) -> list[str]:
    """The stems; where two files share one, their full names."""
    files = list(files)
    stems = Counter(file.stem for file in files)
    return [file.stem if stems[file.stem] == 1 else file.name for file in files]


def _check_total(samples: float, where: str) -> None:
    if samples > MAX_TOTAL_SAMPLES:
        raise MotionError(
            f"{where}: {samples:.3g} samples in all motions; at most {MAX_TOTAL_SAMPLES}: use "
            "fewer or shorter motions, or a greater time step"
        )


def _missing(record: Record, channel: str, other: str) -> Never:
    raise MotionError(
        f"{record.label}: has no {channel} channel; set motion.channel to '{other}' or 'auto'"
    )
