"""Two horizontal components of one record: motions along rotated azimuths, RotD50 and RotD100.

RotD (Boore 2010) is a percentile, over azimuths, of the greatest magnitude of the component along
each azimuth: the 50th for RotD50, the greatest for RotD100. It does not depend on how the sensor
was turned. Azimuths of 180 degrees and more repeat the others with the sign reversed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.record import Record
from vsr2.motion.units import STANDARD_GRAVITY, Quantity
from vsr2.read_only import real_argument

STEP = 1.0
"""Between azimuths that RotD looks at [degree], as in Boore (2010)."""
SAME_INTERVAL = 1e-6
"""Relative difference of two sampling intervals that files' digits make."""


def rotated(first: Record, second: Record, azimuth: float) -> Record:
    """The motion along an azimuth: first cos(azimuth) + second sin(azimuth).

    Args:
        first: component at azimuth 0.
        second: component at azimuth 90, from the same start at the same sampling.
        azimuth: from the first towards the second [degree].

    Returns:
        A record with the channels that both have; the longer one's end is cut.

    Raises:
        MotionError: sampling differs, no common channel, or the azimuth is not finite.
    """
    channels, size = _common(first, second)
    if not math.isfinite(azimuth):
        raise MotionError(f"azimuth {azimuth} must be finite [degree]", file=first.label)
    angle = math.radians(azimuth)
    cosine, sine = math.cos(angle), math.sin(angle)
    turned = {
        name: cosine * first.channels[name][:size] + sine * second.channels[name][:size]
        for name in channels
    }
    return Record(
        f"{first.name}_{azimuth:g}deg",
        first.sample_interval,
        displacement=turned.get("displacement"),
        velocity=turned.get("velocity"),
        acceleration=turned.get("acceleration"),
        source=f"{first.label} and {second.label} at {azimuth:g} degrees",
    )


def rotd(
    first: ArrayLike, second: ArrayLike, percentiles: Sequence[float] = (50, 100)
) -> NDArray[np.float64]:
    """RotD of two components, shape (len(percentiles),), in their unit.

    Args:
        first: acceleration, or what is asked of, along one axis, shape (n,).
        second: the same across it, shape (n,).
        percentiles: 50 for RotD50, 100 for RotD100.

    Raises:
        MotionError: lengths differ, or no samples.
    """
    along = real_argument(first, "the first component", MotionError)
    across = real_argument(second, "the second component", MotionError)
    if along.ndim != 1 or along.shape != across.shape or not along.size:
        raise MotionError(
            f"components have shapes {along.shape} and {across.shape}; give two of one length"
        )
    angles = np.radians(np.arange(0.0, 180.0, STEP))
    peaks = [float(np.abs(along * np.cos(a) + across * np.sin(a)).max()) for a in angles]
    found: Array = np.percentile(peaks, percentiles)
    return found


def rotd_pga_g(first: Record, second: Record) -> tuple[float, float]:
    """RotD50 and RotD100 of PGA [g], of accelerations differentiated where it was not recorded.

    Raises:
        MotionError: sampling differs, or the records have no common channel.
    """
    from vsr2.motion.measures import kinematics

    size = _common(first, second)[1]
    along, across = (kinematics(one).acceleration[:size] for one in (first, second))
    half, full = rotd(along, across)
    return float(half) / STANDARD_GRAVITY, float(full) / STANDARD_GRAVITY


def _common(first: Record, second: Record) -> tuple[list[Quantity], int]:
    """Channels and number of samples that both records have."""
    if not math.isclose(first.sample_interval, second.sample_interval, rel_tol=SAME_INTERVAL):
        raise MotionError(
            f"is sampled every {first.sample_interval:g} s and {second.label} every "
            f"{second.sample_interval:g} s; resample one",
            file=first.label,
        )
    channels = [name for name in first.channels if name in second.channels]
    if not channels:
        raise MotionError(
            f"has {', '.join(first.channels)} and {second.label} has "
            f"{', '.join(second.channels)}; both need one channel in common",
            file=first.label,
        )
    return channels, min(first.size, second.size)
