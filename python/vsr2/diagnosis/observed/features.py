"""Numbers drawn from the response in time, the same for measured and simulated ones.

Series are compared in time up to the divergence horizon only, which is the first two excursions;
beyond it only through what does not need them to agree in time: the time to rest, the final turn
about the vertical and the final travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Feature(NamedTuple):
    """What a number tells of.

    Attributes:
        name: of it.
        channel: tilt, yaw, slip or table.
        phase: of the response.
    """

    name: str
    channel: str
    phase: str


LARGEST_TILT = Feature("largest_tilt", "tilt", "strong shaking")
"""Logarithm of the largest tilt [rad]: all that tier M knows."""
TILT_FEATURES = (
    Feature("uplift_time", "tilt", "uplift"),
    Feature("first_excursion", "tilt", "first impacts"),
    Feature("first_duration", "tilt", "first impacts"),
    Feature("second_excursion", "tilt", "first impacts"),
    Feature("rest_time", "tilt", "free decay"),
)
"""Time of the first uplift [s], logarithm of the first excursion's largest tilt [rad] and of its
duration [s], the same tilt of the second excursion, time of the last uplift [s]."""
REST_FEATURES = (
    Feature("final_yaw", "yaw", "rest pose"),
    Feature("final_travel", "slip", "rest pose"),
)
"""Turn about the vertical [rad] and travel in plan [m] from rest to rest, both magnitudes: which
way a rock turns is often chance."""


@dataclass(frozen=True)
class SeriesConstants:
    """How series are read; chosen by hand.

    Attributes:
        uplift: tilt above which a rock has lifted off [rad].
        last: rows of the end whose median is the rest.
        rest_noise: standard error of that median over that of a row: sqrt(pi / 2 / 10).
    """

    uplift: float = 0.01
    last: int = 10
    rest_noise: float = 0.4


SERIES = SeriesConstants()


@dataclass(frozen=True)
class Sampling:
    """How a campaign measured its series.

    Attributes:
        interval: of samples [s].
        tilt_noise: standard error of a tilt [rad].
    """

    interval: float
    tilt_noise: float

    def measured(
        self, time: Array, values: Array, rng: np.random.Generator | None
    ) -> tuple[Array, Array]:
        """A simulated tilt as the campaign would have measured it: sampled, with noise, magnitude.

        Args:
            time: shape (t,) [s].
            values: shape (t,) [rad].
            rng: of the noise.
        """
        grid = np.arange(time[0], time[-1] + 1e-6 * self.interval, self.interval)
        tilt = np.interp(grid, time, values)
        if self.tilt_noise and rng is not None:
            tilt = np.abs(tilt + self.tilt_noise * rng.standard_normal(tilt.size))
        return grid, tilt


def tilt_features(time: Array, tilt: Array, uplift: float = SERIES.uplift) -> Array:
    """Features of many series on one time axis.

    An excursion lasts while the tilt stays above `uplift`.

    Args:
        time: shape (t,) [s].
        tilt: magnitudes, shape (t, n) [rad].
        uplift: threshold [rad].

    Returns:
        Shape (n, 5), NaN where there is no such excursion, or where it does not end within the
        series (duration, second excursion, time of rest).
    """
    rows, count = tilt.shape
    out = np.full((count, len(TILT_FEATURES)), np.nan)
    up = tilt > uplift
    lifted = up.any(axis=0)
    first = np.argmax(up, axis=0)
    index = np.arange(rows)[:, None]
    ended = ~up & (index > first)
    returns = ended.any(axis=0) & lifted
    end = np.where(returns, np.argmax(ended, axis=0), rows)
    again = up & (index > end)
    second = again.any(axis=0) & returns
    start2 = np.argmax(again, axis=0)
    ended2 = ~up & (index > start2)
    end2 = np.where(ended2.any(axis=0), np.argmax(ended2, axis=0), rows)
    inside = up & (index >= first) & (index < end)
    inside2 = up & (index >= start2) & (index < end2)
    last = rows - 1 - np.argmax(up[::-1], axis=0)
    with np.errstate(divide="ignore"):
        out[lifted, 0] = time[first[lifted]]
        out[returns, 1] = np.log(np.where(inside, tilt, 0.0).max(axis=0))[returns]
        out[returns, 2] = np.log(time[np.minimum(end, rows - 1)] - time[first] + 1e-3)[returns]
        done2 = second & ended2.any(axis=0)
        out[done2, 3] = np.log(np.where(inside2, tilt, 0.0).max(axis=0))[done2]
    rests = lifted & ~up[-1]
    out[rests, 4] = time[last[rests]]
    return out


def rest_features(
    tilt: Array | None,
    position: Array | None,
    orientation: Array | None,
    table: Array | None,
) -> Array:
    """Turn and travel of a rock that came to rest upright.

    Args:
        tilt: magnitudes, shape (t,) [rad]; where it ends above `SERIES.uplift` there is nothing.
        position: travel of the mass centre since the rest before the motion, shape (t, 3) [m].
        orientation: rotation since then, in world axes, x, y, z, w, shape (t, 4).
        table: its own travel since then, along x, shape (t,) [m]; None: not known.

    Returns:
        Shape (2,): magnitudes of the turn [rad] and of the travel [m]; NaN where not known.
    """
    out = np.full(len(REST_FEATURES), np.nan)
    if tilt is not None and np.median(np.abs(tilt[-SERIES.last :])) > SERIES.uplift:
        return out
    if orientation is not None:
        # The twist about the vertical; its sign and that of the quaternion do not matter.
        twist = 2 * np.arctan2(orientation[-SERIES.last :, 2], orientation[-SERIES.last :, 3])
        out[0] = abs(np.median((twist + np.pi) % (2 * np.pi) - np.pi))
    if position is not None and table is not None:
        along = np.median((position[:, 0] - table)[-SERIES.last :])
        out[1] = np.hypot(along, np.median(position[-SERIES.last :, 1]))
    return out
