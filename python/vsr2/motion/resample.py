"""Resampling in time: from a record's own sampling interval to the simulation's time step.

A quintic spline through the displacement samples is evaluated, with its first and second
derivative, at the time steps. So displacement, velocity and acceleration belong to one function,
and the acceleration is smooth; a cubic spline's would have a kink at every sample.

Relative to a sine of 25 Hz, the upper corner of the usual band-pass, the displacement's error is at
most 4e-9 from 800 Hz and 2.2e-5 from 200 Hz; the acceleration's 2.2e-6 and 6.5e-4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.sample_spline import KeptWeights, at, greatest, on_grid, sample_spline
from vsr2.motion.samples import MAX_SAMPLES

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


@dataclass(frozen=True)
class ResampleConstants:
    """How a record is brought to another time step; chosen by hand.

    Attributes:
        degree: of the interpolating spline, whose second derivative, the acceleration, is smooth.
        aliasing: share of the peak velocity that may lie above the new Nyquist frequency.
    """

    degree: int = 5
    aliasing: float = 0.01


RESAMPLE = ResampleConstants()
MIN_RECORD_SAMPLES = 16
"""Fewer leave no quintic spline through every second sample."""


@dataclass(frozen=True, eq=False)
class Resampled:
    """A displacement history at a new sampling interval, with the derivatives of its spline.

    Attributes:
        displacement: shape (n,) [m].
        velocity: shape (n,) [m/s].
        spline: through the samples, over their number.
        position: of the new samples but the last, in numbers of old ones, shape (n - 1,).
        ratio: of the new interval to the old one.
        interval: between the old samples [s].
        record: displacement that was resampled, shape (m,) [m]; None where every new sample falls
            on an old one.
    """

    displacement: Array
    velocity: Array
    spline: BSpline
    position: Array
    ratio: float
    interval: float
    record: Array | None

    @cached_property
    def acceleration(self) -> Array:
        """Of the spline, and 0 at the last sample; shape (n,) [m/s^2], made when asked for."""
        (second,) = at(self.spline, self.position, (2,), _weights(self.ratio))
        return np.append(second / self.interval**2, 0.0)

    @property
    def peak_acceleration(self) -> float:
        """Greatest magnitude of the acceleration [m/s^2], to the last bit, in less time."""
        return greatest(self.spline, self.position, 2) / self.interval**2

    @property
    def error(self) -> float:
        """Stated error of the displacement, greatest magnitude [m]."""
        return self._errors[0]

    @property
    def error_rms(self) -> float:
        """The same, root mean square [m]."""
        return self._errors[1]

    @cached_property
    def _errors(self) -> tuple[float, float]:
        return (0.0, 0.0) if self.record is None else _left_out_error(self.record)


def resample(
    displacement: Array, sample_interval: float, time_step: float, *, name: str = "record"
) -> Resampled:
    """Resample a displacement history and add a last sample at rest.

    Samples lie at 0, `time_step`, ... up to the record's end. One more follows, where the record's
    last displacement is held with v = a = 0.

    The stated error is measured on the record itself: the spline through every second sample is
    compared with the samples left out. That is the error at twice the sampling interval, so for
    content that the record resolves it is well above the real one (64 times for a smooth signal,
    as the error of a quintic spline falls with the sixth power of the interval). It is 0 where
    every new sample falls on an old one.

    Args:
        displacement: shape (n,) [m], n >= `MIN_RECORD_SAMPLES`.
        sample_interval: of the record [s].
        time_step: of the simulation [s].
        name: named in errors.

    Raises:
        MotionError: too few samples, more than `MAX_SAMPLES` at the new interval, or content above
            the Nyquist frequency of `time_step`, which would fold down (aliasing).
    """
    values = np.ascontiguousarray(displacement, dtype=np.float64)
    for label, value in (("sampling interval", sample_interval), ("time step", time_step)):
        if not (math.isfinite(value) and value > 0):
            raise MotionError(f"{name}: {label} {value} s is not positive and finite")
    if values.ndim != 1 or values.size < MIN_RECORD_SAMPLES:
        raise MotionError(
            f"{name}: displacement has shape {values.shape}; resampling needs one dimension and "
            f"at least {MIN_RECORD_SAMPLES} samples"
        )
    span = (values.size - 1) * sample_interval
    if span / time_step > MAX_SAMPLES - 2:
        raise MotionError(
            f"{name}: lasts {span:g} s, that is {span / time_step:.3g} time steps of {time_step:g} "
            f"s; at most {MAX_SAMPLES - 2}: cut the record or raise the time step"
        )
    spline = sample_spline(values, RESAMPLE.degree)
    # Judged on velocity: its weight lies between the displacement that is driven and the
    # acceleration that overturns.
    if time_step > sample_interval * (1 + 1e-9):
        velocity = on_grid(spline, 0, values.size, 1) / sample_interval
        _refuse_aliasing(velocity, sample_interval, time_step, name)
    ratio = time_step / sample_interval
    position = np.arange(math.floor(span / time_step + 1e-9) + 1) * ratio
    position = np.minimum(position, values.size - 1.0)
    nearest = np.rint(position)
    on_sample = np.abs(position - nearest) < 1e-9
    position = np.where(on_sample, nearest, position)
    resampled, rate = at(spline, position, (0, 1), _weights(ratio))
    resampled[on_sample] = values[nearest[on_sample].astype(np.intp)]
    return Resampled(
        displacement=np.append(resampled, values[-1]),
        velocity=np.append(rate / sample_interval, 0.0),
        spline=spline,
        position=position,
        ratio=ratio,
        interval=sample_interval,
        record=None if on_sample.all() else values,
    )


@lru_cache(maxsize=2)  # A campaign's records have one ratio, and one more where time is stretched.
def _weights(ratio: float) -> KeptWeights:
    """Of the positions at multiples of a ratio of intervals, those near samples taken for them."""
    return KeptWeights()


def _left_out_error(values: Array) -> tuple[float, float]:
    left_out = values[1:-1:2]
    through = sample_spline(np.ascontiguousarray(values[::2]), RESAMPLE.degree)
    difference = on_grid(through, 0, left_out.size, shift=0.5) - left_out
    return float(np.abs(difference).max()), float(np.sqrt(np.mean(difference**2)))


def _refuse_aliasing(velocity: Array, sample_interval: float, time_step: float, name: str) -> None:
    # Without the line between its ends it is continuous when repeated, so the transform shows no
    # content that is not there.
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    length = next_fast_len(velocity.size, real=True)
    spectrum = rfft(velocity - np.linspace(velocity[0], velocity[-1], velocity.size), length)
    nyquist = 0.5 / time_step
    beyond = rfftfreq(length, sample_interval) >= nyquist
    peak = float(np.abs(velocity).max())
    # No signal exceeds the sum of its amplitudes, which is known without transforming back.
    if 2 * float(np.abs(spectrum[beyond]).sum()) / length <= RESAMPLE.aliasing * peak:
        return
    spectrum[~beyond] = 0
    above = float(np.abs(irfft(spectrum, length)).max())
    if above > RESAMPLE.aliasing * peak:
        raise MotionError(
            f"{name}: sampled every {sample_interval:g} s, it has content above {nyquist:g} Hz, "
            f"the Nyquist frequency of the time step {time_step:g} s ({above / peak:.1%} of its "
            f"peak velocity); it would fold down: lower the time step to {sample_interval:g} s, "
            f"or give motion.filter with `high` well below {nyquist:g} Hz"
        )
