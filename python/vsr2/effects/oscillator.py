"""Linear second-order systems driven by a motion, and a table with limits.

The systems are solved exactly for an input that runs linearly between samples, so displacement,
velocity and acceleration belong to one solution whatever the time step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.motion import Motion
from vsr2.motion.processing import Kinematics
from vsr2.motion.resample import Resampled

Array = NDArray[np.float64]
Path: TypeAlias = "Kinematics | LazyPath | Motion | Resampled"
"""Whatever has displacement, velocity and acceleration, each of shape (n,), in SI units."""


@dataclass(frozen=True)
class OscillatorConstants:
    """When a driven system is taken to be at rest; chosen by hand.

    Attributes:
        rest_share: share to which free oscillations decay before.
        longest_ringing: longest time appended for that [s].
    """

    rest_share: float = 1e-6
    longest_ringing: float = 5.0


OSCILLATOR = OscillatorConstants()


def held(path: Path, count: int) -> LazyPath:
    """The path with its last displacement held for `count` more samples, at rest."""
    return LazyPath(
        np.pad(path.displacement, (0, count), mode="edge"),
        np.pad(path.velocity, (0, count)),
        lambda: np.pad(path.acceleration, (0, count)),
    )


def ringing_samples(frequency: float, ratio: float, time_step: float) -> int:
    """Samples until free oscillations have decayed, as `OscillatorConstants` have it."""
    omega = 2 * math.pi * frequency
    # Overdamped systems decay with the smaller root.
    rate = ratio * omega if ratio <= 1 else omega * (ratio - math.sqrt(ratio**2 - 1))
    return math.ceil(
        min(-math.log(OSCILLATOR.rest_share) / rate, OSCILLATOR.longest_ringing) / time_step
    )


def respond(
    rate_gain: float, gain: float, frequency: float, ratio: float, signal: Array, step: float
) -> tuple[Array, Array]:
    """Output of y'' + 2 zeta w y' + w^2 y = rate_gain u' + gain u from rest, and its rate.

    Args:
        rate_gain: factor on the input's rate.
        gain: factor on the input.
        frequency: w / (2 pi) [Hz].
        ratio: zeta.
        signal: u, shape (n,); before it there is rest at u[0].
        step: sampling interval [s].

    Returns:
        y and y', each of shape (n,).
    """
    omega = 2 * math.pi * frequency
    z, rate, second = _states(omega, ratio, signal - signal[0], step)
    y = rate_gain * rate + gain * z + signal[0] * gain / omega**2
    return y, rate_gain * second + gain * rate


def _states(omega: float, ratio: float, signal: Array, step: float) -> tuple[Array, Array, Array]:
    """z, z' and z'' of z'' + 2 zeta w z' + w^2 z = u from rest."""
    from scipy.signal import lfilter

    numerators, denominator = _recursions(omega, ratio, step)
    z, rate = (lfilter(numerator, denominator, signal) for numerator in numerators)
    return z, rate, signal - 2 * ratio * omega * rate - omega**2 * z


@lru_cache(maxsize=256)
def _recursions(
    omega: float, ratio: float, step: float
) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
    """Numerators of z and z', and their denominator: an oscillator serves many trials."""
    from scipy.linalg import expm

    # The state (z, z') with an input linear over the step: exponential of the augmented matrix
    # (van Loan 1978, IEEE Trans. Autom. Control 23(3)).
    system = np.zeros((4, 4))
    system[0, 1] = step
    system[1, 0], system[1, 1] = -(omega**2) * step, -2 * ratio * omega * step
    system[1, 2] = step
    system[2, 3] = 1.0
    exponential = expm(system)
    a, now, change = exponential[:2, :2], exponential[:2, 2], exponential[:2, 3]
    trace, det = a[0, 0] + a[1, 1], a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    # x[k+1] = A x[k] + (now - change) u[k] + change u[k+1], as one recursion for each component.
    old = now - change
    numerators = []
    for row in range(2):
        other = 1 - row
        lead = change[row]
        first = old[row] - a[other, other] * change[row] + a[row, other] * change[other]
        second = a[row, other] * old[other] - a[other, other] * old[row]
        numerators.append((float(lead), float(first), float(second)))
    return tuple(numerators), (1.0, float(-trace), float(det))


@dataclass(frozen=True, eq=False)
class LazyPath:
    """A path whose acceleration is found when it is asked for.

    Attributes:
        displacement: shape (n,) [m].
        velocity: shape (n,) [m/s].
        second: gives the acceleration, shape (n,) [m/s^2].
    """

    displacement: Array
    velocity: Array
    second: Callable[[], Array]

    @cached_property
    def acceleration(self) -> Array:
        """Shape (n,) [m/s^2]."""
        return self.second()


def low_passed(displacement: Array, frequency: float, ratio: float, step: float) -> LazyPath:
    """The path behind y'' + 2 zeta w y' + w^2 y = w^2 x, x of shape (n,) [m]."""
    omega = 2 * math.pi * frequency
    y, rate = respond(0.0, omega**2, frequency, ratio, displacement, step)
    return LazyPath(y, rate, lambda: omega**2 * (displacement - y) - 2 * ratio * omega * rate)


def base_excited(
    displacement: Array, velocity: Array, frequency: float, ratio: float, step: float
) -> LazyPath:
    """The path behind y'' + 2 zeta w (y' - x') + w^2 (y - x) = 0.

    Args:
        displacement: x, shape (n,) [m].
        velocity: x', shape (n,) [m/s].
        frequency: w / (2 pi) [Hz].
        ratio: zeta.
        step: sampling interval [s].
    """
    omega = 2 * math.pi * frequency
    y, rate = respond(2 * ratio * omega, omega**2, frequency, ratio, displacement, step)

    def second() -> Array:
        return omega**2 * (displacement - y) + 2 * ratio * omega * (velocity - rate)

    return LazyPath(y, rate, second)


def limited(path: Path, velocity: float, acceleration: float, step: float, *, loop: float) -> Path:
    """A table with limits that follows a path: clipped, integrated again, and brought back.

    Where the command is within the limits and the table is on it, it follows exactly. Beyond, its
    acceleration is that of the command plus a critically damped correction of frequency `loop`,
    clipped to `acceleration` and so that the speed stays below `velocity`.

    Args:
        path: the command; at rest at its end.
        velocity: greatest speed [m/s].
        acceleration: greatest acceleration [m/s^2].
        step: sampling interval [s].
        loop: frequency of the loop that brings the table back [Hz].
    """
    x, v = path.displacement.copy(), path.velocity.copy()
    a = path.acceleration.copy()
    over = (np.abs(path.velocity) > velocity) | (np.abs(path.acceleration) > acceleration)
    if not over.any():
        return path
    omega = 2 * math.pi * loop
    begin = int(np.argmax(over))
    position, speed = (float(x[begin - 1]), float(v[begin - 1])) if begin else (0.0, 0.0)
    x[begin:], v[begin:], a[begin:] = _native.follow_within_limits(
        command=np.stack([x[begin:], v[begin:], a[begin:]]), place=position, speed=speed,
        greatest_speed=velocity, greatest_acceleration=acceleration,
        stiffness=omega**2, damping=2 * omega, time_step=step,
    )  # fmt: skip
    return Kinematics(x, v, a)


def braked(path: Path, deceleration: float, step: float) -> Path:
    """The path, brought to rest after its end.

    Args:
        path: its end may move.
        deceleration: at which it is stopped, about [m/s^2]; what half a step of it stops is rest.
        step: sampling interval [s].
    """
    speed = float(path.velocity[-1])
    count = round(abs(speed) / (deceleration * step))
    if not count:
        return path
    slowing = speed * (1 - np.arange(count + 1) / count)
    way = np.cumsum((slowing[1:] + slowing[:-1]) / 2) * step
    return Kinematics(
        np.concatenate([path.displacement, path.displacement[-1] + way]),
        np.concatenate([path.velocity, slowing[1:]]),
        np.concatenate([path.acceleration, np.full(count, -speed / (count * step))]),
    )
