"""Whether displacement, velocity and acceleration of a motion are of one movement."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import MotionError
from vsr2.motion.samples import length

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AgreementConstants:
    """How an acceleration may differ from the velocity's derivative; chosen by hand.

    Attributes:
        gain: of the acceleration, and of its inverse. g for m/s^2 is 9.8, another sign -1; records
            are within a few per cent.
        offset: of the acceleration's zero, as a share of its peak. A sensor that leans by 0.5
            degrees has 0.09 m/s^2, a quarter of a peak of 0.035 g.
        noise: of the integral, as a share of the velocity's rms: where a table moves steadily, the
            acceleration is noise alone.
        rounding: rms of the integral that counts as rest [m/s].
    """

    gain: float = 2.6
    offset: float = 0.25
    noise: float = 0.05
    rounding: float = 1e-9


AGREEMENT = AgreementConstants()


def check_displacement(name: str, time_step: float, displacement: Array, velocity: Array) -> None:
    """Refuse displacement and velocity of which one is nil, or of another sign or unit.

    The velocity's integral and the displacement are refused where the square of their distance is
    no less than the product of their lengths: where one is 2.6 times the other, and where they are
    of equal length, at an angle of 60 degrees. Noise, and the way of differentiating, are far from
    that.

    Args:
        name: of the motion.
        time_step: between samples [s].
        displacement: shape (n,) [m].
        velocity: shape (n,) [m/s].

    Raises:
        MotionError: they contradict each other.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        change = displacement[1:] - displacement[0]
        integral = _integral(velocity, time_step)[1:]
        lengths = length(change), length(integral)
        apart = length(change - integral)
    if max(lengths) > 0 and apart**2 >= lengths[0] * lengths[1]:
        root = math.sqrt(displacement.size)
        raise MotionError(
            f"motion {name!r}: displacement and velocity contradict each other: rms "
            f"{lengths[0] / root:.3g} m against {lengths[1] / root:.3g} m of the velocity's "
            "integral; check units and signs, or differentiate the displacement"
        )


def check_acceleration(name: str, time_step: float, velocity: Array, acceleration: Array) -> None:
    """Refuse velocity and acceleration of which one is nil, or of another sign or unit.

    The acceleration's integral is compared with the velocity once the straight line that lies
    nearest to their difference is taken off. Its height is the constant of integration, which no
    acceleration has. Its slope is an offset of the accelerometer, which is refused where it exceeds
    a share of the peak (`AGREEMENT`).

    What is left is refused where its projection on the velocity is not the velocity within a
    factor. Noise, drift and a filter on one of the two add what the velocity does not hold, and
    leave the projection as it is.

    Args:
        name: of the motion.
        time_step: between samples [s].
        velocity: shape (n,) [m/s].
        acceleration: shape (n,) [m/s^2].

    Raises:
        MotionError: they contradict each other.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        change = velocity - velocity.mean()
        integral = _integral(acceleration, time_step)
        integral -= integral.mean()
        apart = change - integral
        root = math.sqrt(velocity.size)
        if length(apart) <= max(AGREEMENT.rounding * root, AGREEMENT.noise * length(velocity)):
            return
        time = time_step * (np.arange(velocity.size) - 0.5 * (velocity.size - 1))
        offset = float((time * apart).sum() / np.square(time).sum())
        apart -= offset * time
        beyond = abs(offset) > AGREEMENT.offset * float(np.abs(acceleration).max())
        own = float(np.square(change).sum())
        projected = own - float((change * apart).sum())
    if beyond or not own / AGREEMENT.gain < projected < own * AGREEMENT.gain:
        raise MotionError(
            f"motion {name!r}: velocity and acceleration contradict each other: rms about the mean "
            f"{length(change) / root:.3g} m/s against {length(integral) / root:.3g} m/s of the "
            "acceleration's integral; check units (m/s^2, not g) and signs, or differentiate the "
            "velocity"
        )


def _integral(rates: Array, time_step: float) -> Array:
    """By trapezoids from 0, shape (n,) like the rates."""
    steps = 0.5 * (rates[1:] + rates[:-1]) * time_step
    return np.concatenate([[0.0], np.cumsum(steps)])
