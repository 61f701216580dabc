"""From a recorded channel to a displacement that a pedestal can follow.

The chain of :class:`vsr2.motion.study_motions.Recorded`, all of it at the record's own sampling
interval until the last step but one:

1. baseline, if asked: a polynomial (:func:`remove_baseline`).
2. displacement of the chosen channel: the displacement itself; the velocity integrated
   (:func:`integrate_velocity`); the acceleration integrated twice
   (:func:`integrate_acceleration`); or both fused (:mod:`vsr2.motion.fusion`).
3. band-pass, if asked, before an integration (:func:`band_pass`).
4. ends brought to rest (:func:`taper_ends`).
5. resampling to the time step (:func:`vsr2.motion.resample.resample`).
6. scaling by a factor, and to a PGA if asked.

A displacement's offset needs no rest to be known from: the band-pass takes it (exactly, the filter
starts in its steady state), and :func:`taper_ends` counts from the first sample. Where the pedestal
stands has no effect on the rock. An acceleration's offset would drift, so its level at rest comes
off first. A velocity's is kept unless a baseline or band-pass takes it: records in velocity are
integrals already, and a small slow velocity before the shaking is theirs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vsr2.config.motion_source import Filter
from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.sample_spline import on_grid, sample_spline

MAX_PADDING = 1_000_000
"""Most zeros on either side of an acceleration that is filtered and integrated."""
MAX_BASELINE_DEGREE = 10
"""Greatest degree of a baseline; more follows the shaking."""
MIN_RELATIVE_CORNER = 1e-5
"""Least lower corner, relative to the Nyquist frequency: below, the filter loses its digits."""


@dataclass(frozen=True)
class ProcessingConstants:
    """How rest is distinguished from motion, and ends are brought to rest; chosen by hand.

    Attributes:
        rest_band: before shaking: a signal within this share of its peak around its first level.
        rest_time: shortest rest that tells an offset [s].
        taper_time: length of the taper of a moving end [s].
        taper_share: of the record, that a taper takes at most.
        moving_end: an end moves when its speed exceeds this share of the peak velocity.
        ringing: zeros beside a signal that is filtered, in periods of the lower corner, an order.
    """

    rest_band: float = 0.1
    rest_time: float = 0.1
    taper_time: float = 0.5
    taper_share: float = 0.1
    moving_end: float = 0.01
    ringing: float = 1.5


PROCESSING = ProcessingConstants()


@dataclass(frozen=True, eq=False)
class Kinematics:
    """One motion, sampled uniformly.

    Attributes:
        displacement: shape (n,) [m]; of a record from 0 at the start.
        velocity: shape (n,) [m/s].
        acceleration: shape (n,) [m/s^2].
    """

    displacement: Array
    velocity: Array
    acceleration: Array


def remove_baseline(signal: Array, degree: int, *, name: str = "record") -> Array:
    """The signal (n,) without its least-squares polynomial, any unit.

    Args:
        signal: shape (n,).
        degree: 0 takes the mean, 1 the straight line, up to 10.
        name: named in errors.

    Raises:
        MotionError: the degree is not within 0 to 10.
    """
    if not 0 <= degree <= MAX_BASELINE_DEGREE:
        raise MotionError(
            f"{name}: baseline of degree {degree}; 0 (mean) to {MAX_BASELINE_DEGREE} are possible"
        )
    # Legendre polynomials are nearly orthogonal on the samples, so high degrees keep their digits
    s = np.linspace(-1.0, 1.0, signal.size)
    basis = np.polynomial.legendre.legvander(s, min(degree, signal.size - 1))
    coefficients = np.linalg.lstsq(basis, signal, rcond=None)[0]
    corrected: Array = signal - basis @ coefficients
    return corrected


def rest_level(signal: Array, sample_interval: float) -> float:
    """Level of a channel at rest, in the channel's unit.

    The rest before shaking is the initial stretch within 10 % of the signal's peak deviation from
    the median of its first 0.1 s; its mean is the level. A record that leaves this band within
    0.1 s was cut to the shaking; then the mean of the whole record is taken.

    Args:
        signal: shape (n,).
        sample_interval: [s].
    """
    first = max(2, math.ceil(PROCESSING.rest_time / sample_interval))
    deviation = np.abs(signal - np.median(signal[:first]))
    moving = np.flatnonzero(deviation > PROCESSING.rest_band * deviation.max())
    rest = int(moving[0]) if moving.size else signal.size
    return float(np.mean(signal[:rest] if rest >= first else signal))


def band_pass(
    signal: Array, sample_interval: float, filter: Filter, *, name: str = "record"
) -> Array:
    """Butterworth band-pass forward and backward: no shift in time, twice the order's slope.

    With 0.1-25 Hz and order 3 this is the filter behind the published PGA of the laboratory
    campaign. Ends are extended by odd reflection. It is scipy's `sosfiltfilt`, which
    would find the filter's steady state for every signal again.

    Args:
        signal: shape (n,), or several of shape (k, n), any unit.
        sample_interval: [s].
        filter: corners [Hz]; `low` of 0 leaves a low-pass.
        name: named in errors.

    Raises:
        MotionError: `high` is at or above the Nyquist frequency, or `low` so low that the filter
            loses its digits.
    """
    from scipy.signal import sosfilt

    nyquist = 0.5 / sample_interval
    if filter.high >= nyquist:
        raise MotionError(
            f"{name}: filter.high = {filter.high:g} Hz is not below the record's Nyquist frequency "
            f"{nyquist:g} Hz (sampled every {sample_interval:g} s); lower it"
        )
    if 0 < filter.low < MIN_RELATIVE_CORNER * nyquist:
        raise MotionError(
            f"{name}: filter.low = {filter.low:g} Hz is below {MIN_RELATIVE_CORNER * nyquist:g} "
            "Hz, where the filter is not accurate; raise it, or set 0 for none"
        )
    sections, states = _sections(filter.order, filter.low, filter.high, sample_interval)
    # scipy's own choice of padding, which needs a longer signal than the shortest records
    zeros = min((sections[:, 2] == 0).sum(), (sections[:, 5] == 0).sum())
    size = signal.shape[-1]
    padding = min(int(3 * (2 * len(sections) + 1 - zeros)), size - 1)
    before = 2 * signal[..., :1] - signal[..., padding:0:-1]
    after = 2 * signal[..., -1:] - signal[..., -2 : -padding - 2 : -1]
    passed = np.concatenate([before, signal, after], axis=-1)
    states = states.reshape(-1, *[1] * (signal.ndim - 1), 2)
    for _ in ("forward", "backward"):
        passed = sosfilt(sections, passed, zi=states * passed[..., :1])[0][..., ::-1]
    return passed[..., padding : padding + size]


@lru_cache(maxsize=256)
def _sections(order: int, low: float, high: float, sample_interval: float) -> tuple[Array, Array]:
    """Butterworth's second-order sections, and their states amid ones: they serve many signals."""
    from scipy.signal import butter, sosfilt_zi

    corners = [low, high] if low > 0 else high
    kind = "bandpass" if low > 0 else "lowpass"
    sections: Array = butter(order, corners, kind, fs=1 / sample_interval, output="sos")
    return sections, sosfilt_zi(sections)


def integrate_velocity(
    velocity: Array,
    sample_interval: float,
    filter: Filter | None = None,
    *,
    name: str = "record",
) -> Kinematics:
    """Displacement and acceleration of `velocity` (n,) [m/s], as a cubic spline.

    With a `filter` the velocity is band-passed amid zeros, as in :func:`integrate_acceleration`.
    Without one it is believed as it is: an offset drifts (take it off with a baseline).

    Raises:
        MotionError: as :func:`band_pass`.
    """
    clean, pad = filter_amid_zeros(velocity, sample_interval, filter, name=name)
    spline = sample_spline(clean, 3)
    inside = pad, clean.size - pad
    displacement = on_grid(spline.antiderivative(), *inside) * sample_interval
    return Kinematics(
        displacement=displacement - displacement[0],
        velocity=clean[pad : clean.size - pad],
        acceleration=on_grid(spline, *inside, 1) / sample_interval,
    )


def integrate_acceleration(
    acceleration: Array,
    sample_interval: float,
    filter: Filter | None = None,
    *,
    name: str = "record",
) -> Kinematics:
    """Velocity and displacement of `acceleration` (n,) [m/s^2], drift controlled.

    The acceleration is integrated twice as a cubic spline, so exactly between samples. Two things
    would drift. An offset: the level at rest is subtracted first, and what is left of it is taken
    out as the one constant acceleration that brings the final velocity to 0. Slow noise: with a
    `filter` the acceleration is band-passed and integrated amid zeros of 1.5 order / low [s] on
    either side, in which the filter rings out, and then cut to the record (Boore 2005, Bull.
    Seismol. Soc. Am. 95(2)); the ringing leaves the ends with a small velocity, which
    :func:`taper_ends` brings to rest. Without a filter slow noise stays, and with it a doubtful
    displacement: give one to real records.

    Raises:
        MotionError: as :func:`band_pass`.
    """
    at_rest = acceleration - rest_level(acceleration, sample_interval)
    clean, pad = filter_amid_zeros(at_rest, sample_interval, filter, name=name)
    velocity = sample_spline(clean, 3).antiderivative()
    # the constant that ends it at rest: v - v_end t / T, so x - v_end t^2 / (2 T)
    last = clean.size - 1.0
    slope = float(velocity(last)) / last
    inside = pad, clean.size - pad
    samples = np.arange(*inside, dtype=np.float64)
    displacement = (
        on_grid(velocity.antiderivative(), *inside) - 0.5 * slope * samples**2
    ) * sample_interval**2
    return Kinematics(
        displacement=displacement - displacement[0],
        velocity=(on_grid(velocity, *inside) - slope * samples) * sample_interval,
        acceleration=clean[pad : clean.size - pad] - slope,
    )


def filter_amid_zeros(
    signal: Array, sample_interval: float, filter: Filter | None, *, name: str = "record"
) -> tuple[Array, int]:
    """The band-passed signal amid zeros in which it rings out; as it is without a `filter`.

    Args:
        signal: shape (n,), near 0 at both ends, any unit.
        sample_interval: [s].
        filter: None: none, and no zeros.
        name: named in errors.

    Returns:
        The signal (n + 2 p,) and p.

    Raises:
        MotionError: as :func:`band_pass`.
    """
    if filter is None:
        return signal, 0
    rings = PROCESSING.ringing * filter.order / filter.low if filter.low > 0 else 1.0
    pad = min(math.ceil(rings / sample_interval), MAX_PADDING)
    return band_pass(np.pad(signal, pad), sample_interval, filter, name=name), pad


def differentiate(displacement: Array, sample_interval: float) -> Kinematics:
    """Velocity and acceleration of `displacement` (n,) [m], as a quintic spline."""
    spline = sample_spline(displacement, 5)
    return Kinematics(
        displacement=displacement - displacement[0],
        velocity=on_grid(spline, 0, displacement.size, 1) / sample_interval,
        acceleration=on_grid(spline, 0, displacement.size, 2) / sample_interval**2,
    )


def taper_ends(displacement: Array, sample_interval: float) -> Array:
    """The displacement (n,) [m] from its first sample on, with ends at rest.

    An end slower than 1 % of the peak velocity is at rest and stays as it is, so a clean pulse
    or a record with rest around it is not changed. A moving end is blended into a rest over
    0.5 s (at most a tenth of the record): the start into 0, the end into its last value, by the
    factor 10 s^3 - 15 s^4 + 6 s^5, whose first and second derivative vanish at both ends. The
    constant taken off has no effect: the pedestal's start is 0.
    """
    tapered: Array = displacement - displacement[0]
    velocity = np.gradient(tapered, sample_interval, edge_order=2)
    limit = PROCESSING.moving_end * float(np.abs(velocity).max())
    most = int(PROCESSING.taper_share * displacement.size)
    length = min(math.ceil(PROCESSING.taper_time / sample_interval), most)
    s = np.arange(length) / max(length, 1)
    blend = s**3 * (10 - 15 * s + 6 * s**2)
    if abs(velocity[0]) > limit:
        tapered[:length] *= blend
    if abs(velocity[-1]) > limit:
        last = tapered[-1]
        tapered[tapered.size - length :] = (
            last + (tapered[tapered.size - length :] - last) * blend[::-1]
        )
    return tapered
