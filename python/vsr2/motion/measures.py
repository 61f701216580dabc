"""Intensity measures of a ground motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vsr2.config.motion_source import Channel, Filter
from vsr2.errors import MotionError, Renamed
from vsr2.motion.fusion import fuse
from vsr2.motion.motion import Array, Motion
from vsr2.motion.processing import (
    Kinematics,
    band_pass,
    differentiate,
    filter_amid_zeros,
    integrate_acceleration,
    integrate_velocity,
    remove_baseline,
)
from vsr2.motion.record import Record
from vsr2.motion.units import STANDARD_GRAVITY
from vsr2.read_only import real_argument


@dataclass(frozen=True)
class IntensityMeasures:
    """What a ground motion's history comes down to; g = 9.80665 m/s^2.

    Attributes:
        pga_g: peak ground acceleration [g].
        pgv_m_s: peak ground velocity [m/s].
        pgd: peak ground displacement, from where it starts [m].
        pgv_pga_s: PGV/PGA [s]; 0 at rest.
        arias: pi / (2 g) times the integral of a^2 (Arias 1970) [m/s].
        duration_5_75: significant duration, from 5 % to 75 % of the Arias intensity (Trifunac &
            Brady 1975) [s].
        duration_5_95: the same to 95 % [s].
        cav: cumulative absolute velocity, the integral of `|a|` (EPRI 1988) [m/s].
        time_step: of the samples they were taken from [s].
        duration: from the first to the last sample [s].
    """

    pga_g: float
    pgv_m_s: float
    pgd: float
    pgv_pga_s: float
    arias: float
    duration_5_75: float
    duration_5_95: float
    cav: float
    time_step: float
    duration: float

    pga = Renamed("pga_g", " [g]")
    pgv = Renamed("pgv_m_s", " [m/s]")
    pgv_pga = Renamed("pgv_pga_s", " [s]")

    def as_dict(self) -> dict[str, float]:
        """Every measure, its unit in its name."""
        return {
            "pga_g": self.pga_g,
            "pgv_m_s": self.pgv_m_s,
            "pgd_m": self.pgd,
            "pgv_pga_s": self.pgv_pga_s,
            "arias_m_s": self.arias,
            "duration_5_75_s": self.duration_5_75,
            "duration_5_95_s": self.duration_5_95,
            "cav_m_s": self.cav,
            "time_step_s": self.time_step,
            "duration_s": self.duration,
        }


def pga_g(acceleration: ArrayLike) -> float:
    """Peak ground acceleration [g]: the greatest magnitude of `acceleration` (n,) [m/s^2].

    Raises:
        MotionError: no samples.
    """
    return _peak(acceleration, "acceleration") / STANDARD_GRAVITY


def pgv_m_s(velocity: ArrayLike) -> float:
    """Peak ground velocity [m/s]: the greatest magnitude of `velocity` (n,) [m/s].

    Raises:
        MotionError: no samples.
    """
    return _peak(velocity, "velocity")


def arias_intensity(acceleration: ArrayLike, time_step: float) -> float:
    """Arias intensity [m/s] of `acceleration` (n,) [m/s^2], by the trapezium rule.

    Raises:
        MotionError: no samples.
    """
    return float(_husid(_samples(acceleration, "Arias intensity"), time_step)[-1])


def significant_duration(
    acceleration: ArrayLike, time_step: float, start: float = 0.05, end: float = 0.95
) -> float:
    """Time [s] between two shares of the Arias intensity, interpolated between samples; 0 at rest.

    Args:
        acceleration: shape (n,), any unit.
        time_step: [s].
        start: share at which it starts, 0 to 1.
        end: share at which it ends, `start` to 1.

    Raises:
        MotionError: no samples, or the shares are not ordered within 0 to 1.
    """
    if not 0 <= start < end <= 1:
        raise MotionError(f"significant duration from {start} to {end}: need 0 <= start < end <= 1")
    husid = _husid(_samples(acceleration, "significant duration"), time_step)
    if husid[-1] <= 0:
        return 0.0
    first, last = (_time_of(husid, share * husid[-1], time_step) for share in (start, end))
    return last - first


def cumulative_absolute_velocity(acceleration: ArrayLike, time_step: float) -> float:
    """CAV [m/s] of `acceleration` (n,) [m/s^2], by the trapezium rule on `|a|`.

    Raises:
        MotionError: no samples.
    """
    values = np.abs(_samples(acceleration, "CAV"))
    return float(np.sum(values[1:] + values[:-1])) * 0.5 * time_step


def kinematics(
    record: Record,
    *,
    channel: Channel = "auto",
    filter: Filter | None = None,
    baseline: int | None = None,
) -> Kinematics:
    """Displacement, velocity and acceleration of a record at its own sampling.

    Ends are not brought to rest, nothing is resampled: this is what was measured, not what a
    pedestal is given.

    Args:
        record: as read.
        channel: which one tells; "auto": acceleration where there is one, else velocity, else
            displacement, since the measures weigh the acceleration most; a record with all three
            is taken at its word if neither filter nor baseline is asked for.
        filter: band-pass; None: none.
        baseline: degree of a polynomial to take off the channel first; None: none.

    Raises:
        MotionError: the channel is missing, or filter or baseline does not fit.
    """
    interval = record.sample_interval
    recorded = record.channels
    if channel == "auto" and filter is None and baseline is None and len(recorded) == 3:
        displacement, velocity, acceleration = recorded.values()
        return Kinematics(displacement - displacement[0], velocity, acceleration)
    used = next(reversed(recorded)) if channel == "auto" else channel
    if used == "fused":
        fused = fuse(record, baseline=baseline)
        if filter is None:
            return fused
        displacement = band_pass(fused.displacement, interval, filter, name=record.label)
        velocity, acceleration = (
            filtered[pad : filtered.size - pad]
            for filtered, pad in (
                filter_amid_zeros(signal, interval, filter, name=record.label)
                for signal in (fused.velocity, fused.acceleration)
            )
        )
        return Kinematics(displacement - displacement[0], velocity, acceleration)
    signal = channel_signal(record, used, baseline)
    if used == "acceleration":
        return integrate_acceleration(signal, interval, filter, name=record.label)
    if used == "velocity":
        return integrate_velocity(signal, interval, filter, name=record.label)
    if filter is not None:
        signal = band_pass(signal, interval, filter, name=record.label)
    return differentiate(signal, interval)


def channel_signal(record: Record, channel: str, baseline: int | None) -> Array:
    """A channel of a record without its baseline (:func:`vsr2.motion.remove_baseline`), (n,).

    Raises:
        MotionError: the record lacks it, or the degree of `baseline` is not possible.
    """
    found: Array | None = getattr(record, channel)
    if found is None:
        raise MotionError(
            f"{record.label}: has no {channel} channel; choose the channel "
            f"'{next(iter(record.channels))}' or 'auto'"
        )
    return found if baseline is None else remove_baseline(found, baseline, name=record.label)


def intensity_measures(
    source: Motion | Record,
    *,
    channel: Channel = "auto",
    filter: Filter | None = None,
    baseline: int | None = None,
) -> IntensityMeasures:
    """Intensity measures of a motion as driven, or of a record as measured.

    Args:
        source: a motion; or a record, whose histories come from :func:`kinematics`.
        channel: of a record; as in :func:`kinematics`.
        filter: of a record.
        baseline: of a record.

    Raises:
        MotionError: as :func:`kinematics`; or channel, filter or baseline given for a motion, which
            is driven as it is.
    """
    if isinstance(source, Motion):
        if channel != "auto" or filter is not None or baseline is not None:
            raise MotionError(
                f"motion {source.name!r}: channel, filter and baseline are for records; a motion "
                "is measured as driven"
            )
        histories = Kinematics(source.displacement, source.velocity, source.acceleration)
        time_step = source.time_step
    else:
        histories = kinematics(source, channel=channel, filter=filter, baseline=baseline)
        time_step = source.sample_interval
    acceleration = histories.acceleration
    peak, speed = _peak(acceleration, "acceleration"), pgv_m_s(histories.velocity)
    return IntensityMeasures(
        pga_g=peak / STANDARD_GRAVITY,
        pgv_m_s=speed,
        pgd=_peak(histories.displacement, "displacement"),
        pgv_pga_s=speed / peak if peak > 0 else 0.0,
        arias=arias_intensity(acceleration, time_step),
        duration_5_75=significant_duration(acceleration, time_step, 0.05, 0.75),
        duration_5_95=significant_duration(acceleration, time_step, 0.05, 0.95),
        cav=cumulative_absolute_velocity(acceleration, time_step),
        time_step=time_step,
        duration=(acceleration.size - 1) * time_step,
    )


def _husid(acceleration: Array, time_step: float) -> Array:
    """Arias intensity up to each sample (n,) [m/s]."""
    squares = acceleration**2
    steps = 0.5 * (squares[1:] + squares[:-1]) * time_step
    total: Array = math.pi / (2 * STANDARD_GRAVITY) * np.concatenate([[0.0], np.cumsum(steps)])
    return total


def _time_of(husid: Array, level: float, time_step: float) -> float:
    after = int(np.searchsorted(husid, level))
    if after == 0:
        return 0.0
    below, above = float(husid[after - 1]), float(husid[after])
    return (after - 1 + (level - below) / (above - below)) * time_step


def _samples(signal: ArrayLike, quantity: str) -> Array:
    values = real_argument(signal, quantity, MotionError)
    if values.size == 0:
        raise MotionError(f"{quantity} is asked of no samples")
    return values


def _peak(signal: ArrayLike, quantity: str) -> float:
    return float(np.abs(_samples(signal, f"the peak of {quantity}")).max())
