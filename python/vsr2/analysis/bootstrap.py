"""Intervals of scores from a bootstrap over ground motions.

Trials of one ground motion resemble each other, so whole motions are drawn, with all their trials
(cluster bootstrap; Davison and Hinkley 1997, *Bootstrap Methods and their Application*, 3.8).
Intervals are of the percentile kind. They tell what other motions would have given, not what other
fits would: predictions stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.metrics import classification_metrics
from vsr2.campaign import motion_resamples
from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.read_only import label_argument

Array = NDArray[np.float64]

SCORES = ("accuracy", "precision", "recall", "f1", "objective")
"""Scores that :func:`classification_intervals` gives."""


@dataclass(frozen=True)
class Interval:
    """A figure and how sure it is.

    Attributes:
        value: on the trials as they are; NaN: undefined.
        low: lower end of the interval; NaN: no replicate defines the figure.
        high: upper end.
        standard_error: standard deviation over the replicates.
        undefined: share of replicates without the figure (no overturning predicted, for example),
            which the interval leaves out.
    """

    value: float
    low: float
    high: float
    standard_error: float
    undefined: float = 0.0

    def __str__(self) -> str:
        return f"{self.value:.3f} [{self.low:.3f}, {self.high:.3f}]"


def classification_intervals(
    observed: ArrayLike,
    predicted: ArrayLike,
    motions: ArrayLike,
    *,
    level: float = INTERVALS.level,
    replicates: int = INTERVALS.replicates,
    seed: int = 0,
) -> Mapping[str, Interval]:
    """Accuracy, precision, recall, F1 and their objective, with intervals.

    Args:
        observed: whether each trial overturned, boolean, shape (n,).
        predicted: whether it was predicted to, boolean, shape (n,).
        motions: ground motion of each trial, shape (n,).
        level: of the intervals.
        replicates: of the bootstrap.
        seed: of its draws; equal seeds draw equal replicates, so that predictions of the same
            trials can be compared.

    Returns:
        By the names in `SCORES`.

    Raises:
        ResultError: as :func:`classification_metrics`; or `motions` of another length, or `level`
            not between 0 and 1.
        CampaignError: no trials, or a number of replicates that cannot be.
    """
    found = classification_metrics(observed, predicted)
    truth, guess = np.asarray(observed), np.asarray(predicted)
    groups = label_argument(motions, "motions", ResultError)
    if groups.shape != truth.shape:
        raise ResultError(f"motions has shape {groups.shape} for {counted(truth.size, 'trial')}")
    if not 0 < level < 1:
        raise ResultError(f"level {level} must lie between 0 and 1")
    drawn = score_replicates(truth, guess, motion_resamples(groups, replicates, seed))
    return {
        name: percentile_interval(float(getattr(found, name)), values, level)
        for name, values in drawn.items()
    }


def score_replicates(
    observed: NDArray[np.bool_], predicted: NDArray[np.bool_], counts: NDArray[np.integer[Any]]
) -> dict[str, Array]:
    """Each score in each bootstrap replicate, shape (replicates,), NaN where it is undefined.

    Args:
        observed: shape (n,).
        predicted: shape (n,).
        counts: how often each trial is drawn, shape (replicates, n)
            (:func:`vsr2.campaign.motion_resamples`).
    """
    drawn = counts.astype(np.float64)
    hits, false = drawn @ (observed & predicted), drawn @ (~observed & predicted)
    missed, right = drawn @ (observed & ~predicted), drawn @ (observed == predicted)
    accuracy = _ratio(right, drawn.sum(axis=1))
    precision, recall = _ratio(hits, hits + false), _ratio(hits, hits + missed)
    f1 = _ratio(2 * hits, 2 * hits + false + missed)
    objective = (accuracy + precision + recall) / 3.0
    return dict(zip(SCORES, (accuracy, precision, recall, f1, objective), strict=True))


def _ratio(part: Array, total: Array) -> Array:
    out = np.full(part.shape, np.nan)
    np.divide(part, total, out=out, where=total > 0)
    return out


def percentile_interval(
    value: float, replicates: Array, level: float = INTERVALS.level
) -> Interval:
    """A figure with its percentile interval.

    Args:
        value: on the trials as they are.
        replicates: of the bootstrap, NaN where the figure is undefined, shape (replicates,).
        level: of the interval.
    """
    known = replicates[~np.isnan(replicates)]
    undefined = 1.0 - known.size / replicates.size
    if known.size == 0:
        return Interval(value, math.nan, math.nan, math.nan, undefined)
    tail = 0.5 * (1.0 - level)
    low, high = np.quantile(known, [tail, 1.0 - tail])
    error = float(known.std(ddof=1)) if known.size > 1 else 0.0
    return Interval(value, float(low), float(high), error, undefined)
