"""Stochastic ground motions of our own, in displacement."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundConstants:
    """From what a ground motion is drawn; all are choices, none is fitted; sealed with a pack.

    Attributes:
        interval: of samples [s].
        quiet: at rest before and after the shaking [s].
        sums: share of motions that are sums of cosines; the others are pulses.
        components: of a sum.
        band: least and greatest frequency of a sum [Hz].
        jitter: of the frequencies of a sum, over themselves.
        corner: ends of the log-uniform corner frequency [Hz].
        kappa: ends of the log-uniform decay [s].
        length: ends of the uniform length of a sum [s].
        pulse: ends of the uniform frequency of a pulse [Hz].
        cycles: ends of the uniform number of its cycles.
        rise: power of time in the envelope of a sum.
        bell: power of the sine in both envelopes.
    """

    interval: float = 0.005
    quiet: float = 0.3
    sums: float = 0.75
    components: int = 160
    band: tuple[float, float] = (0.3, 18.0)
    jitter: tuple[float, float] = (0.99, 1.01)
    corner: tuple[float, float] = (0.3, 2.0)
    kappa: tuple[float, float] = (0.05, 0.3)
    length: tuple[float, float] = (2.5, 5.0)
    pulse: tuple[float, float] = (0.6, 2.5)
    cycles: tuple[float, float] = (1.0, 3.0)
    rise: float = 0.6
    bell: int = 4


GROUND = GroundConstants()


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """A horizontal motion of unit peak acceleration.

    Attributes:
        name: of the motion.
        interval: of its samples [s].
        displacement: at rest at 0 at both ends, per unit of peak acceleration, shape (n,) [s^2].
    """

    name: str
    interval: float
    displacement: Array

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return (self.displacement.size - 1) * self.interval


def ground_motion(name: str, rng: np.random.Generator) -> GroundMotion:
    """Draw a motion.

    Three in four are sums of cosines of random phase (spectral representation, Shinozuka and
    Deodatis 1991) with an omega-square spectrum (Brune 1970) between 0.3 and 18 Hz, corner 0.3 to
    2 Hz, decay kappa 0.05 to 0.3 s, under an envelope of 2.5 to 5 s; the others are a cosine under
    a bell, a pulse of 1 to 3 cycles (as Mavroeidis and Papageorgiou 2003) of 0.6 to 2.5 Hz. The
    sums make displacement, which the envelope takes to 0, so that no baseline needs correction.
    """
    interval, count = GROUND.interval, GROUND.components
    if rng.random() < GROUND.sums:
        length = rng.uniform(*GROUND.length)
        time = np.arange(0.0, length, interval)
        frequency = np.geomspace(*GROUND.band, count) * rng.uniform(*GROUND.jitter, count)
        corner = _log_uniform(rng, *GROUND.corner)
        kappa = _log_uniform(rng, *GROUND.kappa)
        shape = np.exp(-np.pi * kappa * frequency) / (1 + (frequency / corner) ** 2)
        # Components are evenly spaced in ln f: each stands for a band proportional to f.
        amplitude = shape * np.sqrt(frequency) * rng.rayleigh(size=count)
        phase = rng.uniform(0, 2 * np.pi, count)
        moved = (amplitude * np.cos(2 * np.pi * time[:, None] * frequency + phase)).sum(axis=1)
        s = time / length
        envelope = np.sin(np.pi * s**GROUND.rise) ** GROUND.bell
    else:
        frequency_p, cycles = rng.uniform(*GROUND.pulse), rng.uniform(*GROUND.cycles)
        length = (cycles + 1) / frequency_p
        time = np.arange(0.0, length, interval)
        moved = np.cos(2 * np.pi * frequency_p * (time - length / 2) + rng.uniform(0, 2 * np.pi))
        envelope = np.sin(np.pi * time / length) ** GROUND.bell
    quiet = np.zeros(round(GROUND.quiet / interval))
    displacement = np.concatenate([quiet, envelope * moved, quiet])
    peak = np.abs(acceleration_of(displacement, interval)).max()
    return GroundMotion(name, interval, displacement / peak)


def _log_uniform(rng: np.random.Generator, least: float, most: float) -> float:
    return math.exp(rng.uniform(math.log(least), math.log(most)))


def acceleration_of(displacement: Array, interval: float) -> Array:
    """Second derivative of the cubic spline through the samples."""
    from scipy.interpolate import CubicSpline

    time = np.arange(displacement.size) * interval
    second: Array = CubicSpline(time, displacement, bc_type="clamped")(time, 2)
    return second
