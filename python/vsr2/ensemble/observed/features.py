"""Numbers drawn from the response in time, the same for measured and simulated ones.

An excursion is what lies between lift-off and the next return to the base. Two correct simulators
agree on the first ones alone. What is chaotic scatters as much in campaigns without effect, by
which all is standardised, so that it weighs nothing there.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_Float = TypeVar("_Float", bound=np.floating[Any])


@dataclass(frozen=True)
class SeriesConstants:
    """How series are read; chosen by hand.

    Attributes:
        uplift: tilt above which a rock has lifted off [rad].
        fallen: tilt from which nothing comes back [rad].
        last: rows of the end whose median is the rest.
        rest_noise: standard error of that median over that of a row: sqrt(pi / 2 / 10).
        excursions: that are described one by one, at most four.
        least_tilt: that a series' largest tilt counts for at least [rad].
        least_duration: added to an excursion's before the logarithm: a tenth of a sample of
            simulated series [s].
        least_aloft: added to the time spent in excursions before the logarithm: some samples of a
            camera [s].
        row: between rows of simulated series, unless the campaign's own are nearer [s].
    """

    uplift: float = 0.01
    fallen: float = 1.0
    last: int = 10
    rest_noise: float = 0.4
    excursions: int = 4
    least_tilt: float = 1e-4
    least_duration: float = 1e-3
    least_aloft: float = 0.05
    row: float = 0.01


SERIES = SeriesConstants()


class FeatureChannel(StrEnum):
    """What was measured."""

    OUTCOME = "outcome"
    LABEL = "label"
    """Outcome and series against each other."""
    TILT = "tilt"
    YAW = "yaw"
    SLIP = "slip"
    TABLE = "table"
    """Its two recordings against each other."""


class Phase(StrEnum):
    """Part of the response, or of the motion, in the order of figures."""

    RESPONSE = "response"
    UPLIFT = "uplift"
    IMPACTS = "impacts"
    STRONG = "strong_shaking"
    DECAY = "free_decay"
    FALL = "fall"
    REST = "rest_pose"
    MOTION = "motion"


class Feature(NamedTuple):
    """What a number tells of.

    Attributes:
        name: of it.
        channel: that it is read from.
        phase: of the response or of the motion.
    """

    name: str
    channel: FeatureChannel
    phase: Phase


LARGEST_TILT = Feature("largest_tilt", FeatureChannel.TILT, Phase.STRONG)
"""Logarithm of the largest tilt [rad] of a rock that stood: all that tier M knows."""
SERIES_TILT = Feature("series_tilt", FeatureChannel.TILT, Phase.STRONG)
"""Logarithm of the series' own largest tilt [rad], of rocks noted as overturned."""
CONTRADICTION = Feature("contradiction", FeatureChannel.LABEL, Phase.RESPONSE)
"""1 where the noted outcome contradicts the series, else 0."""
TIME_ALOFT = Feature("time_aloft", FeatureChannel.TILT, Phase.STRONG)
"""Logarithm of the time spent in excursions [s], of rocks that do not fall."""
_NUMBERS = ("first", "second", "third", "fourth")[: SERIES.excursions]
TILT_FEATURES = (
    SERIES_TILT,
    CONTRADICTION,
    *(
        Feature(f"{number}_{what}", FeatureChannel.TILT, phase)
        for number in _NUMBERS
        for what, phase in (
            ("start", Phase.UPLIFT),
            ("excursion", Phase.IMPACTS),
            ("duration", Phase.IMPACTS),
        )
    ),
    Feature("excursions", FeatureChannel.TILT, Phase.STRONG),
    TIME_ALOFT,
    Feature("rest_time", FeatureChannel.TILT, Phase.DECAY),
    Feature("fall_time", FeatureChannel.TILT, Phase.FALL),
)
"""Of each of the first four excursions its start [s] and the logarithms of its largest tilt [rad]
and of its duration [s]; the logarithm of one more than the number of excursions; the end of the
last one [s]; the time at which the rock fell [s]."""
REST_FEATURES = (
    Feature("final_yaw", FeatureChannel.YAW, Phase.REST),
    Feature("final_travel", FeatureChannel.SLIP, Phase.REST),
)
"""Turn about the vertical [rad] and travel in plan [m] from rest to rest, both magnitudes: which
way a rock turns is often chance."""


@dataclass(frozen=True)
class Sampling:
    """How a campaign measured its series.

    Attributes:
        interval: of samples [s].
        tilt_noise: standard error of a tilt, or of the orientation about each axis [rad].
        axes: about which there are errors: 2 where the tilt is read from the orientation.
    """

    interval: float
    tilt_noise: float
    axes: int = 1

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
            for _ in range(1, self.axes):
                tilt = np.hypot(tilt, self.tilt_noise * rng.standard_normal(tilt.size))
        return grid, tilt


def tilt_features(time: Array, tilt: Array) -> Array:
    """Features of one series, in the order of `TILT_FEATURES`.

    Args:
        time: shape (t,) [s].
        tilt: magnitudes, shape (t,) [rad].

    Returns:
        Shape (18,); NaN where there is no such excursion, or where it does not end within the
        series. The largest tilt is that of any rock, and the contradiction is 1 where the series
        ends without a fall: :func:`noted_tilt_features` has both as they count.
    """
    out = np.full(len(TILT_FEATURES), np.nan)
    out[0] = np.log(max(float(tilt.max()), SERIES.least_tilt))
    fell = tilt >= SERIES.fallen
    out[1] = float(not fell.any())
    if fell.any():
        out[-1] = time[int(np.argmax(fell))]
    up = np.concatenate([[False], tilt > SERIES.uplift, [False]])
    starts, ends = np.flatnonzero(up[1:] & ~up[:-1]), np.flatnonzero(up[:-1] & ~up[1:])
    complete = ends < tilt.size
    for k, (start, end) in enumerate(
        zip(starts[complete][: SERIES.excursions], ends[complete][: SERIES.excursions], strict=True)
    ):
        duration = np.log(time[end] - time[start] + SERIES.least_duration)
        out[2 + 3 * k : 5 + 3 * k] = time[start], np.log(tilt[start:end].max()), duration
    last = 2 + 3 * SERIES.excursions
    step = float(time[1] - time[0]) if time.size > 1 else 1.0
    out[last] = np.log1p(starts.size)
    out[last + 1] = np.log((ends - starts).sum() * step + SERIES.least_aloft)
    if starts.size and complete[-1]:
        out[last + 2] = time[ends[-1]]
    return out


def noted_tilt_features(found: NDArray[_Float], overturned: Array) -> NDArray[_Float]:
    """Features beside noted outcomes: what counts of them.

    Args:
        found: of :func:`tilt_features`, shape (..., 18).
        overturned: noted outcomes, 1 or 0, shape (...).

    Returns:
        Shape (..., 18): the series' largest tilt of rocks noted as overturned alone, the time aloft
        of those that do not fall alone, and 1 where outcome and series contradict each other.
    """
    out = np.array(found)
    # How far a fall is seen, and how long, is the camera's matter, or of when a simulation stops.
    capped = np.minimum(out[..., 0], np.log(SERIES.fallen))
    out[..., 0] = np.where(overturned > 0.5, capped, np.nan)
    aloft = TILT_FEATURES.index(TIME_ALOFT)
    out[..., aloft] = np.where(np.isnan(out[..., -1]), out[..., aloft], np.nan)
    # A series says that its rock stood, the outcome that it fell, or the other way round.
    same = (overturned > 0.5) == (out[..., 1] > 0.5)
    out[..., 1] = np.where(np.isnan(out[..., 1]), np.nan, same)
    return out


def rest_features(
    tilt: Array | None,
    position: Array | None,
    orientation: Array | None,
    table: Array | None,
    yaw: Array | None = None,
) -> Array:
    """Turn and travel of a rock that came to rest upright.

    Args:
        tilt: magnitudes, shape (t,) [rad]; where it ends above `SERIES.uplift` there is nothing.
        position: travel of the mass centre since the rest before the motion, shape (t, 3) [m].
        orientation: rotation since then, in world axes, x, y, z, w, shape (t, 4).
        table: its own travel since then, along x, shape (t,) [m]; None: not known.
        yaw: turn about the vertical since then, shape (t,) [rad]; the orientation goes before it.

    Returns:
        Shape (2,): magnitudes of the turn [rad] and of the travel [m]; NaN where not known.
    """
    out = np.full(len(REST_FEATURES), np.nan)
    if tilt is not None and np.median(np.abs(tilt[-SERIES.last :])) > SERIES.uplift:
        return out
    if orientation is not None:
        # The twist about the vertical; its sign and that of the quaternion do not matter.
        yaw = 2 * np.arctan2(orientation[:, 2], orientation[:, 3])
    if yaw is not None:
        out[0] = abs(np.median((yaw[-SERIES.last :] + np.pi) % (2 * np.pi) - np.pi))
    if position is not None and table is not None:
        along = np.median((position[:, 0] - table)[-SERIES.last :])
        out[1] = np.hypot(along, np.median(position[-SERIES.last :, 1]))
    return out
