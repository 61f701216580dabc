"""Intensity measures of a ground motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vsr2.errors import MotionError

STANDARD_GRAVITY = 9.80665
"""The unit g of recorded accelerations and of PGA [m/s^2] (CGPM 1901); not the engine's gravity."""


def pga(acceleration: ArrayLike) -> float:
    """Peak ground acceleration [m/s^2]: the greatest magnitude of `acceleration` (n,) [m/s^2].

    Raises:
        MotionError: no samples.
    """
    return _peak(acceleration, "acceleration")


def pgv(velocity: ArrayLike) -> float:
    """Peak ground velocity [m/s]: the greatest magnitude of `velocity` (n,) [m/s].

    Raises:
        MotionError: no samples.
    """
    return _peak(velocity, "velocity")


def _peak(signal: ArrayLike, quantity: str) -> float:
    values = np.asarray(signal, dtype=np.float64)
    if values.size == 0:
        raise MotionError(f"the peak of {quantity} is asked of no samples")
    return float(np.abs(values).max())
