"""Stochastic ground motions of our own, in displacement."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE_INTERVAL = 0.005
"""[s]"""
QUIET = 0.3
"""At rest before and after the shaking [s]."""


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
    if rng.random() < 0.75:
        length = rng.uniform(2.5, 5.0)
        time = np.arange(0.0, length, SAMPLE_INTERVAL)
        frequency = np.geomspace(0.3, 18.0, 160) * rng.uniform(0.99, 1.01, 160)
        corner = math.exp(rng.uniform(math.log(0.3), math.log(2.0)))
        kappa = math.exp(rng.uniform(math.log(0.05), math.log(0.3)))
        shape = np.exp(-np.pi * kappa * frequency) / (1 + (frequency / corner) ** 2)
        # Components are evenly spaced in ln f: each stands for a band proportional to f.
        amplitude = shape * np.sqrt(frequency) * rng.rayleigh(size=160)
        phase = rng.uniform(0, 2 * np.pi, 160)
        moved = (amplitude * np.cos(2 * np.pi * time[:, None] * frequency + phase)).sum(axis=1)
        s = time / length
        envelope = np.sin(np.pi * s**0.6) ** 4
    else:
        frequency_p, cycles = rng.uniform(0.6, 2.5), rng.uniform(1.0, 3.0)
        length = (cycles + 1) / frequency_p
        time = np.arange(0.0, length, SAMPLE_INTERVAL)
        moved = np.cos(2 * np.pi * frequency_p * (time - length / 2) + rng.uniform(0, 2 * np.pi))
        envelope = np.sin(np.pi * time / length) ** 4
    quiet = np.zeros(round(QUIET / SAMPLE_INTERVAL))
    displacement = np.concatenate([quiet, envelope * moved, quiet])
    peak = np.abs(acceleration_of(displacement, SAMPLE_INTERVAL)).max()
    return GroundMotion(name, SAMPLE_INTERVAL, displacement / peak)


def acceleration_of(displacement: Array, interval: float) -> Array:
    """Second derivative of the cubic spline through the samples."""
    from scipy.interpolate import CubicSpline

    time = np.arange(displacement.size) * interval
    second: Array = CubicSpline(time, displacement, bc_type="clamped")(time, 2)
    return second
