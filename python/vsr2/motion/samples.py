"""Samples of records and motions: what is taken for them, and those that are made later."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import MotionError
from vsr2.read_only import read_only, real_array

Array = NDArray[np.float64]

MAX_SAMPLES = 2_000_000
"""Most samples of a record or a motion (2000 s at 1 kHz): bounds memory before it is taken."""


@dataclass(frozen=True)
class Deferred:
    """The acceleration of a motion, made when it is asked for: nothing is driven by it.

    Attributes:
        make: gives it, shape (n,) [m/s^2], with no other result whenever it is called.
        peak: gives its greatest magnitude [m/s^2] in less time; None: there is no shorter way.
    """

    make: Callable[[], Array]
    peak: Callable[[], float] | None = None


def samples_of(given: Any, what: str, *, fewest: int, file: str = "") -> Array:
    """`given` as a read-only array of shape (n,), copied where it can be written to.

    Args:
        given: what should be samples.
        what: names it in errors.
        fewest: samples.
        file: that errors name.

    Raises:
        MotionError: no array of real numbers, one with a mask, or not of one dimension and
            `fewest` to `MAX_SAMPLES`.
    """
    try:
        value = read_only(np.asarray(real_array(given), order="C"))
    except TypeError as error:
        raise MotionError(f"{what} {error}", file=file) from None
    if value.ndim != 1 or not fewest <= value.size <= MAX_SAMPLES:
        raise MotionError(
            f"{what} has shape {value.shape}; it needs one dimension and {fewest} to "
            f"{MAX_SAMPLES} samples",
            file=file,
        )
    return value


def number_of(given: Any, what: str, unit: str, *, positive: bool) -> float:
    """`given` as a number of Python's own type, however numpy spells it.

    Args:
        given: what should be a number.
        what: names it in errors.
        unit: of it.
        positive: whether it must be above 0, else not below.

    Raises:
        MotionError: no finite real number, or none of that sign.
    """
    number = isinstance(given, Real) and not isinstance(given, bool)
    if not (number and math.isfinite(given) and (given > 0 if positive else given >= 0)):
        wanted = f"positive number [{unit}]" if positive else f"finite number [{unit}], 0 or more"
        raise MotionError(f"{what} must be a {wanted} (is {given!r})")
    return float(given)


def length(signal: Array) -> float:
    """Root of the sum of squares.

    numpy's `norm` leaves it to BLAS, whose second thread costs more than the sum.
    """
    return math.sqrt(float(np.square(signal).sum()))
