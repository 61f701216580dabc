"""The table: how a sampled motion is driven, and what stands between the two."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco.rigid_body import GRAVITY

Array = NDArray[np.float64]
Channel = Literal["x", "y", "z", "pitch"]
CHANNELS: tuple[Channel, ...] = ("x", "y", "z", "pitch")


@dataclass(frozen=True)
class DrivenTableConstants:
    """How the table swings; chosen by hand, sealed with a pack.

    Attributes:
        pitch_damping: damping ratio of the pitching mode [1].
        slow: corner below which an instrument's gain for slow motion acts [Hz].
        fast: corner above which its gain for fast motion acts [Hz].
        rest: around a motion, in which such filters ring out [s].
    """

    pitch_damping: float = 0.1
    slow: float = 2.0
    fast: float = 8.0
    rest: float = 2.0


DRIVEN_TABLE = DrivenTableConstants()


@dataclass(frozen=True, eq=False)
class TableMotion:
    """What the table does, sampled.

    Attributes:
        interval: [s].
        x: displacement along the shaking, shape (n,) [m].
        others: displacement along y and z [m] and pitch about y [rad], each of shape (n,).
        pivot: height of the axis of the pitch below the table's surface [m].
    """

    interval: float
    x: Array
    others: dict[Channel, Array] = field(default_factory=dict)
    pivot: float = 0.5

    @property
    def channels(self) -> dict[Channel, Array]:
        """Samples of all channels in use, in the order of :data:`CHANNELS`."""
        known: dict[Channel, Array] = {"x": self.x, **self.others}
        return {channel: known[channel] for channel in CHANNELS if channel in known}

    @property
    def acceleration(self) -> Array:
        """Along x at the samples [m/s^2]."""
        from vsr2.blind.mujoco.ground import acceleration_of

        return acceleration_of(self.x, self.interval)


def drive(samples: Array, interval: float, step: float) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration every `step` by a cubic spline, clamped at both ends."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.arange(samples.size) * interval, samples, bc_type="clamped")
    time = np.arange(int((samples.size - 1) * interval / step + 1e-9) + 1) * step
    return spline(time), spline(time, 1), spline(time, 2)


def shaded(samples: Array, interval: float, low: float, high: float) -> Array:
    """A motion whose slow and fast parts were recorded by instruments of another gain.

    H = 1 + low L(f / f_low) + high (1 - L(f / f_high)) with L(r) = 1 / (1 + r^4), f_low and f_high
    of `DRIVEN_TABLE`, by the discrete Fourier transform amid rest.

    Args:
        samples: shape (n,).
        interval: [s].
        low: relative change of what is slow [1].
        high: relative change of what is fast [1].
    """
    pad = round(DRIVEN_TABLE.rest / interval)
    amid = np.pad(samples, pad, mode="edge")
    # Without its trend the transform's two ends meet.
    trend = np.linspace(amid[0], amid[-1], amid.size)
    frequency = np.fft.rfftfreq(amid.size, interval)
    slow = 1 / (1 + (frequency / DRIVEN_TABLE.slow) ** 4)
    fast = 1 - 1 / (1 + (frequency / DRIVEN_TABLE.fast) ** 4)
    spectrum = np.fft.rfft(amid - trend) * (1 + low * slow + high * fast)
    moved: Array = np.fft.irfft(spectrum, amid.size) + trend
    moved -= moved[0]
    return moved


def low_passed(samples: Array, interval: float, corner: float, delay: float = 0.0) -> Array:
    """A critically damped second-order lag, in time, and a delay.

    |H| = 1 / (1 + (f / f_n)^2): -3 dB at the corner f_c, so that f_n = f_c / (2^(1/2) - 1)^(1/2).

    Args:
        samples: shape (n,).
        interval: [s].
        corner: f_c [Hz].
        delay: [s].
    """
    natural = corner / (2**0.5 - 1) ** 0.5
    return _second_order(_delayed(samples, interval, delay), interval, natural, 1.0)


def resonated(samples: Array, interval: float, frequency: float, amplification: float) -> Array:
    """The motion behind a mode between actuator and the rock's base, shaken at its foot.

    H = (1 + 2 i zeta r) / (1 - r^2 + 2 i zeta r), r = f / `frequency`, with the zeta for which
    |H| = A at r = 1: A^2 = 1 + 1 / (4 zeta^2).

    Args:
        samples: shape (n,).
        interval: [s].
        frequency: of the mode [Hz].
        amplification: A, 1 or more [1].
    """
    if amplification == 1:
        return samples
    damping = 0.5 / (amplification**2 - 1) ** 0.5
    return _second_order(samples, interval, frequency, damping, foot=True)


def saturated(samples: Array, interval: float, velocity: float, acceleration: float) -> Array:
    """Velocity and acceleration clipped, then integrated; ends at rest, maybe displaced.

    Args:
        samples: displacement, shape (n,) [m].
        interval: [s].
        velocity: cap [m/s]; `inf`: none.
        acceleration: cap [m/s^2]; `inf`: none.
    """
    speed = np.clip(np.diff(samples, prepend=samples[0]) / interval, -velocity, velocity)
    rate = np.clip(np.diff(speed, prepend=0.0) / interval, -acceleration, acceleration)
    # What clipping took from the velocity's end is given back evenly, so that the table stops.
    rate = rate - rate.sum() * np.abs(rate) / max(float(np.abs(rate).sum()), 1e-300)
    moved: Array = samples[0] + np.cumsum(np.cumsum(rate)) * interval**2
    return moved


def stretched(samples: Array, factor: float) -> Array:
    """The same path, time multiplied by `factor`; the sampling interval is kept."""
    from scipy.interpolate import CubicSpline

    index = np.arange(samples.size, dtype=np.float64)
    count = round((samples.size - 1) * factor) + 1
    at = np.minimum(np.arange(count) / factor, samples.size - 1.0)
    moved: Array = CubicSpline(index, samples, bc_type="clamped")(at)
    return moved


def pitched(acceleration: Array, interval: float, gain: float, frequency: float) -> Array:
    """Rotation of a sprung table, which leans back as it accelerates, behind a second-order lag.

    Args:
        acceleration: shape (n,) [m/s^2].
        interval: [s].
        gain: [rad per g].
        frequency: of the pitching mode [Hz]; its damping ratio is `DRIVEN_TABLE.pitch_damping`.
    """
    return (
        -gain
        / GRAVITY
        * _second_order(acceleration, interval, frequency, DRIVEN_TABLE.pitch_damping)
    )


def _delayed(samples: Array, interval: float, delay: float) -> Array:
    if delay == 0:
        return samples
    time = np.arange(samples.size) * interval
    moved: Array = np.interp(time - delay, time, samples)
    return moved


def _second_order(
    samples: Array, interval: float, frequency: float, damping: float, *, foot: bool = False
) -> Array:
    """Solves y'' + 2 zeta w y' + w^2 y = w^2 u, exactly for u linear between samples.

    With `foot` the dashpot hangs on the input, too: + 2 zeta w u' on the right.
    """
    from scipy.signal import cont2discrete, lfilter

    w = 2 * np.pi * frequency
    above = [2 * damping * w, w * w] if foot else [w * w]
    over, under, _ = cont2discrete((above, [1.0, 2 * damping * w, w * w]), interval, "foh")
    moved: Array = lfilter(np.ravel(over), under, samples - samples[0]) + samples[0]
    return moved
