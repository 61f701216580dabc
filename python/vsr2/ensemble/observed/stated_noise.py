"""Standard errors of what a campaign measured in time: a series' own, else the campaign's."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vsr2.campaign import MeasurementNoise, Series


def channel_noise(series: Series, noise: MeasurementNoise, channel: str) -> float:
    """Of one channel, in its unit; 0: not stated.

    Args:
        series: one of its own may be stated in it.
        noise: of the campaign.
        channel: tilt, position, orientation, yaw or slip.
    """
    own: float | None = getattr(series, f"noise_{channel}")
    stated: float | None = getattr(noise, channel) if own is None else own
    return stated or 0.0


def tilt_noise(series: Series, noise: MeasurementNoise) -> float:
    """Of the tilt, or of the orientation that it is read from, about each axis [rad]."""
    return channel_noise(series, noise, "tilt" if series.tilt is not None else "orientation")


def turn_noise(series: Series, noise: MeasurementNoise) -> float:
    """Of the turn about the vertical, or of the orientation that it is read from [rad]."""
    return channel_noise(series, noise, "yaw" if series.orientation is None else "orientation")


def travel_noise(series: Series, noise: MeasurementNoise) -> float:
    """Of each component of the position [m]."""
    return channel_noise(series, noise, "position")


def typical(
    series: Sequence[Series],
    noise: MeasurementNoise,
    noise_of: Callable[[Series, MeasurementNoise], float],
) -> float:
    """Median over series, in the unit of the channel; 0 where there are none."""
    found = [noise_of(one, noise) for one in series]
    return float(np.median(found)) if found else 0.0
