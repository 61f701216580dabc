"""Numbers drawn from a tilt's series, the same for measured and simulated ones.

Series are compared in time up to the divergence horizon only, which is the first two excursions;
beyond it only through what does not need them to agree in time: the time to rest, the final turn
about the vertical and the final travel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TILT_FEATURES = (
    "uplift_time",
    "first_excursion",
    "first_duration",
    "second_excursion",
    "rest_time",
)
"""Time of the first uplift [s], logarithm of the first excursion's largest tilt [rad] and of its
duration [s], the same tilt of the second excursion, time of the last uplift [s]."""
PHASES = ("uplift", "first impacts", "first impacts", "strong shaking", "free decay")
"""Phase of the response that each feature of `TILT_FEATURES` belongs to."""
UPLIFT = 0.01
"""Tilt above which a rock has lifted off [rad]."""


def tilt_features(time: Array, tilt: Array, uplift: float = UPLIFT) -> Array:
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
