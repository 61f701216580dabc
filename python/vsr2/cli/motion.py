"""`vsr2 motion`: measures, conversion, synthesis and fusion of ground motions."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from vsr2.config.motion_source import RecordUnits


def add_verbs(verbs: Any) -> None:
    """Add `motion` with `info`, `convert`, `generate` and `fuse`."""
    motion = verbs.add_parser(
        "motion",
        help="ground motions: measures, conversion, synthesis, fusion",
        description="Ground motions: intensity measures, conversion, synthesis, fusion of a "
        "table's channels.",
    )
    kinds = motion.add_subparsers(dest="motion_verb", metavar="WHAT", required=True)
    _add_info(kinds)
    _add_convert(kinds)
    _add_generate(kinds)
    _add_fuse(kinds)


def _add_info(kinds: Any) -> None:
    info = kinds.add_parser(
        "info",
        help="intensity measures of records",
        description="Intensity measures of records at their own sampling; g = 9.80665 m/s^2.",
    )
    info.add_argument("files", metavar="FILE", type=Path, nargs="+", help="recordings")
    _add_reading(info)
    _add_processing(info)
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info)


def _add_convert(kinds: Any) -> None:
    convert = kinds.add_parser(
        "convert",
        help="read any record, process it, write neutral .csv",
        description="Without processing options the channels are written as read, in SI units. "
        "With one, the motion as driven is written: displacement, velocity and acceleration, ends "
        "at rest.",
    )
    convert.add_argument("source", metavar="IN", type=Path, help="recording")
    convert.add_argument("target", metavar="OUT.csv", type=Path, help="replaced if it exists")
    _add_reading(convert)
    _add_processing(convert)
    convert.add_argument("--scale", type=float, help="factor on the motion; negative mirrors it")
    convert.add_argument("--scale-to-pga", metavar="PGA", type=float, help="target PGA [g]")
    convert.add_argument(
        "--time-step", type=float, help="resample to this [s] (default: the record's own)"
    )
    convert.set_defaults(run=_convert)


def _add_generate(kinds: Any) -> None:
    generate = kinds.add_parser(
        "generate",
        help="an earthquake-like motion with given measures",
        description="Seeded noise with an envelope and a Kanai-Tajimi spectrum, tuned to the "
        "measures: PGA exact, PGV/PGA within 1 %%, significant duration within 3 %%.",
    )
    generate.add_argument("target", metavar="OUT.csv", type=Path, help="replaced if it exists")
    generate.add_argument("--pga", type=float, required=True, help="[g]")
    generate.add_argument("--pgv-pga", type=float, required=True, help="[s], 0.012 to 0.4")
    generate.add_argument(
        "--duration", type=float, required=True, help="significant duration, 5-95 %% [s]"
    )
    generate.add_argument("--seed", type=int, default=0, help="(default 0)")
    generate.add_argument("--time-step", type=float, default=0.001, help="[s] (default 0.001)")
    generate.set_defaults(run=_generate)


def _add_fuse(kinds: Any) -> None:
    fuse = kinds.add_parser(
        "fuse",
        help="one motion from a table's displacement and acceleration channels",
        description="Rauch-Tung-Striebel smoother over both channels, weighed by their noise at "
        "rest; prints how far they agree, band by band, and writes neutral .csv.",
    )
    fuse.add_argument("source", metavar="IN", type=Path, help="recording with both channels")
    fuse.add_argument("target", metavar="OUT.csv", type=Path, help="replaced if it exists")
    _add_reading(fuse)
    fuse.add_argument("--baseline", metavar="DEGREE", type=int, help="polynomial to take off first")
    fuse.add_argument("--json", action="store_true", help="print JSON")
    fuse.set_defaults(run=_fuse)


def _add_reading(parser: argparse.ArgumentParser) -> None:
    from vsr2.motion import RecordFormat

    parser.add_argument("--format", choices=get_args(RecordFormat), help="(default: recognised)")
    parser.add_argument(
        "--units", choices=get_args(RecordUnits), help="of values whose format carries none"
    )


def _add_processing(parser: argparse.ArgumentParser) -> None:
    from vsr2.motion import Channel

    parser.add_argument("--channel", choices=get_args(Channel), help="(default auto)")
    parser.add_argument(
        "--baseline", metavar="DEGREE", type=int, help="polynomial to take off first"
    )
    parser.add_argument(
        "--filter",
        metavar=("LOW", "HIGH", "ORDER"),
        nargs=3,
        help="zero-phase Butterworth band-pass [Hz], [Hz], order; LOW 0: low-pass",
    )


def _info(options: argparse.Namespace) -> int:
    from vsr2.motion import intensity_measures

    rows: list[dict[str, float]] = []
    for file in options.files:
        record = _read(file, options)
        measures = intensity_measures(
            record,
            channel=options.channel or "auto",
            baseline=options.baseline,
            filter=_filter(options),
        )
        rows.append(measures.as_dict())
    if options.json:
        named = [{"file": str(f), **row} for f, row in zip(options.files, rows, strict=True)]
        print(json.dumps(named, indent=2))
    else:
        table = [
            [str(file), *(f"{value:.4g}" for value in row.values())]
            for file, row in zip(options.files, rows, strict=True)
        ]
        _print_table(["file", *rows[0]], table)
    return 0


def _convert(options: argparse.Namespace) -> int:
    from vsr2.motion import STANDARD_GRAVITY, build_recorded_motion, write_record

    record = _read(options.source, options)
    asked = (
        options.channel,
        options.baseline,
        options.filter,
        options.scale,
        options.scale_to_pga,
        options.time_step,
    )
    if all(option is None for option in asked):
        write_record(record, options.target, note=f"from {options.source.name}, channels as read")
        print(options.target)
        return 0
    motion = build_recorded_motion(
        record,
        record.sample_interval if options.time_step is None else options.time_step,
        channel=options.channel or "auto",
        baseline=options.baseline,
        filter=_filter(options),
        scale=1.0 if options.scale is None else options.scale,
    )
    if options.scale_to_pga is not None:
        motion = motion.scaled_to_pga(options.scale_to_pga * STANDARD_GRAVITY, name=motion.name)
    write_record(motion, options.target, note=motion.source)
    print(f"{options.target}: PGA {motion.pga / STANDARD_GRAVITY:.4g} g, PGV {motion.pgv:.4g} m/s")
    return 0


def _generate(options: argparse.Namespace) -> int:
    from vsr2.motion import intensity_measures, synthetic_motion, write_record

    motion = synthetic_motion(
        options.pga, options.pgv_pga, options.duration, options.seed, options.time_step
    )
    write_record(motion, options.target, note=motion.source)
    measures = intensity_measures(motion)
    print(
        f"{options.target}: PGA {measures.pga_g:.4g} g, PGV/PGA {measures.pgv_pga:.4g} s, "
        f"significant duration {measures.duration_5_95:.4g} s"
    )
    return 0


def _fuse(options: argparse.Namespace) -> int:
    from vsr2.motion import Record, fuse, input_uncertainty, write_record

    record = _read(options.source, options)
    fused = fuse(record, baseline=options.baseline)
    agreement = input_uncertainty(record)
    noise = fused.noise
    middle = fused.displacement.size // 2
    summary: dict[str, Any] = {
        "rest_s": noise.rest,
        "displacement_noise_m": noise.displacement.deviation,
        "acceleration_noise_m_s2": noise.acceleration.deviation,
        "consistency": fused.consistency,
        "displacement_error_m": float(fused.displacement_error[middle]),
        "velocity_error_m_s": float(fused.velocity_error[middle]),
        "acceleration_error_m_s2": float(fused.acceleration_error[middle]),
    }
    bands: list[dict[str, float | None]] = []
    for index, (low, high) in enumerate(agreement.bands):
        values = {
            "low_hz": low,
            "high_hz": high,
            "displacement_rms_m_s2": agreement.displacement_rms[index],
            "acceleration_rms_m_s2": agreement.acceleration_rms[index],
            "difference_rms_m_s2": agreement.difference_rms[index],
            "coherence": agreement.coherence[index],
            "gain": agreement.gain[index],
        }
        # JSON has no NaN; a band beyond the sampling tells nothing
        bands.append({k: float(v) if v == v else None for k, v in values.items()})
    write_record(
        Record(
            name=record.name,
            sample_interval=fused.sample_interval,
            displacement=fused.displacement,
            velocity=fused.velocity,
            acceleration=fused.acceleration,
        ),
        options.target,
        note=(
            f"displacement and acceleration of {options.source.name} fused, sha256 {record.sha256}"
        ),
    )
    if options.json:
        print(json.dumps({**summary, "bands": bands}, indent=2))
        return 0
    for name, value in summary.items():
        print(f"{name}: {value:.4g}")
    print()
    _print_table(
        list(bands[0]),
        [["-" if v is None else f"{v:.3g}" for v in band.values()] for band in bands],
    )
    return 0


def _read(file: Path, options: argparse.Namespace) -> Any:
    from vsr2.motion import read_record

    return read_record(file, format=options.format, units=options.units)


def _filter(options: argparse.Namespace) -> Any:
    if options.filter is None:
        return None
    from pydantic import ValidationError

    from vsr2.config.motion_source import Filter
    from vsr2.errors import ConfigError

    try:
        low, high, order = options.filter
        return Filter(low=float(low), high=float(high), order=int(order))
    except (ValueError, ValidationError) as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        raise ConfigError(
            f"--filter {' '.join(options.filter)}: {reason}; give LOW and HIGH [Hz] and a whole "
            "ORDER from 1 to 10, for example --filter 0.1 25 3"
        ) from None


def _print_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    for row in (header, *rows):
        print("  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)).rstrip())
