"""Response spectra: the greatest response of damped oscillators to a ground motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vsr2.errors import MotionError
from vsr2.motion.motion import Array, Motion
from vsr2.motion.units import STANDARD_GRAVITY
from vsr2.one_line import OneLine
from vsr2.read_only import ReadOnlyArrays, real_array

PERIODS = tuple(float(period) for period in np.round(np.geomspace(0.02, 10.0, 100), 5))
"""Of oscillators [s], where none are given."""


@dataclass(frozen=True, eq=False, repr=False)
class ResponseSpectrum(ReadOnlyArrays, OneLine):
    """Greatest responses of oscillators with one degree of freedom.

    Attributes:
        period: of the undamped oscillator T, shape (n,) [s].
        displacement: relative to the ground, SD, shape (n,) [m].
        damping: share of critical damping.
    """

    period: Array
    displacement: Array
    damping: float

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        ends = (float(self.period.min()), float(self.period.max())) if self.period.size else ()
        return {
            "periods": self.period.size,
            "from_s": ends[0] if ends else None,
            "to_s": ends[1] if ends else None,
            "damping": self.damping,
        }

    @property
    def pseudo_velocity(self) -> Array:
        """PSV = 2 pi SD / T, shape (n,) [m/s]."""
        return 2 * math.pi / self.period * self.displacement

    @property
    def pseudo_acceleration_g(self) -> Array:
        """PSA = (2 pi / T)^2 SD, shape (n,) [g]."""
        return (2 * math.pi / self.period) ** 2 * self.displacement / STANDARD_GRAVITY


def response_spectrum(
    motion: Motion, periods: ArrayLike = PERIODS, *, damping: float = 0.05
) -> ResponseSpectrum:
    """Response spectrum of a motion as driven.

    The oscillator u'' + 2 z w u' + w^2 u = -a, w = 2 pi / T, is stepped exactly for an acceleration
    that is linear between samples (Nigam and Jennings 1969). It is followed for one more period
    after the motion.

    Args:
        motion: its acceleration along x.
        periods: shape (n,) [s], above 0.
        damping: z, from 0 up to 1 exclusive.

    Raises:
        MotionError: a period or a damping out of these bounds.
    """
    from scipy.signal import cont2discrete, lfilter

    if not isinstance(motion, Motion):
        raise MotionError(f"response spectrum: got a {type(motion).__name__}; give a Motion")
    try:
        wanted = np.atleast_1d(real_array(periods))
    except TypeError as error:
        raise MotionError(f"response spectrum: periods {error}") from None
    if wanted.ndim != 1 or not wanted.size or not (np.isfinite(wanted) & (wanted > 0)).all():
        raise MotionError("response spectrum: periods must be numbers above 0 [s], shape (n,)")
    if not 0 <= damping < 1:
        raise MotionError(f"response spectrum: damping {damping} must lie from 0 up to 1")
    greatest = np.empty(wanted.size)
    for i, period in enumerate(wanted):
        w = 2 * math.pi / period
        rest = np.zeros(math.ceil(period / motion.time_step))
        ground = np.concatenate([motion.acceleration, rest])
        oscillator = ([-1.0], [1.0, 2 * damping * w, w * w])
        above, below, _ = cont2discrete(oscillator, motion.time_step, method="foh")
        greatest[i] = np.abs(lfilter(np.ravel(above), below, ground)).max()
    return ResponseSpectrum(wanted, greatest, damping)
