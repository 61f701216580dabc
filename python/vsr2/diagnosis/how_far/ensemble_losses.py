"""Losses of trials by an ensemble of simulations.

The loss of a trial is the logarithmic loss of its outcome plus, from tier M on, the continuous
ranked probability score of the logarithm of its largest tilt and, at tier T, the mean score of its
series' features (T. Gneiting and A. E. Raftery, "Strictly proper scoring rules, prediction, and
estimation", JASA 102, 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import overturning_probability
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.probability import outcome_loss

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Simulations of the trials of a campaign.

    Attributes:
        overturned: 1 or 0, NaN where unknown, shape (members, trials).
        features: as observed, shape (members, trials, k).
    """

    overturned: Array
    features: Array

    def __len__(self) -> int:
        return len(self.overturned)

    @property
    def probability(self) -> Array:
        """Share that overturned, half a count on each side, shape (trials,)."""
        return overturning_probability(self.overturned)

    def take(self, members: Sequence[int] | NDArray[np.int64]) -> Ensemble:
        """Some of the simulations."""
        return Ensemble(self.overturned[members], self.features[members])


def feature_scores(simulated: Array, observed: Array) -> Array:
    """Fair CRPS of each feature by an ensemble, NaN where it is not known, shape (trials, k).

    What a few members would lose against many is taken off (C. A. T. Ferro, "Fair scores for
    ensemble forecasts", Q. J. R. Meteorol. Soc. 140, 2014).

    Args:
        simulated: shape (members, trials, k).
        observed: shape (trials, k).
    """
    count = np.isfinite(simulated).sum(axis=0)
    members = len(simulated)
    # Pairs of members by their order: O(n log n), and no array of all pairs.
    ordered = np.sort(simulated, axis=0)
    rank = np.arange(members)[:, None, None]
    pairs = np.nansum(np.where(np.isfinite(ordered), (2 * rank - count + 1) * ordered, 0.0), axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.nansum(np.abs(simulated - observed), axis=0) / count
        score = score - pairs / (count * (count - 1))
    return np.where(np.isfinite(observed) & (count > 1), score, np.nan)


def by_kind(scores: Array) -> Array:
    """The largest tilt's score plus the mean of the others, unknown ones 0, shape (trials,)."""
    known = np.nan_to_num(scores)
    if known.shape[-1] == 0:
        return np.zeros(known.shape[:-1])
    out = known[..., 0]
    if known.shape[-1] > 1:
        out = out + known[..., 1:].mean(axis=-1)
    return np.asarray(out)


def simulated_loss(
    simulated: Ensemble, probability: Array, outcome: Array, features: Array
) -> Array:
    """Loss of each trial by simulations of it, shape (trials,)."""
    scores = by_kind(feature_scores(simulated.features, features))
    return np.asarray(outcome_loss(probability, outcome) + scores)


def floor_loss(simulated: Ensemble) -> Array:
    """Mean loss of each simulation by the others: what a campaign without a gap loses."""
    out = np.zeros(simulated.overturned.shape[1])
    everyone = np.arange(len(simulated))
    for i in everyone:
        others = simulated.take(np.delete(everyone, i))
        own = simulated.overturned[i], simulated.features[i]
        out += simulated_loss(others, others.probability, *own)
    return out / len(simulated)


@dataclass(frozen=True)
class LossInterval:
    """An estimate with its 95 % interval; NaN where it does not exist, or has no bounds."""

    value: float
    low: float
    high: float

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        if not np.isfinite(self.value):
            return {"value": None, "ci95": None}
        bounded = np.isfinite([self.low, self.high]).all()
        return {"value": self.value, "ci95": [self.low, self.high] if bounded else None}


def interval(values: Array) -> LossInterval:
    """The first value, and the 95 % interval of the others."""
    low, high = np.quantile(values[1:], INTERVALS.ends)
    return LossInterval(float(values[0]), float(low), float(high))


def share_of_gap(part: Array, gap: Array) -> LossInterval:
    """A difference of mean losses over the gap, of equal replicates.

    NaN where there is no gap. Without bounds where the gap's own interval touches zero: a share of
    what may be nothing has none (E. C. Fieller, "Some problems in interval estimation", 1954).

    Args:
        part: mean of all trials, then of each replicate [nat a trial], shape (1 + replicates,).
        gap: likewise.
    """
    if gap[0] <= 0:
        return LossInterval(np.nan, np.nan, np.nan)
    if interval(gap).low <= 0:
        return LossInterval(float(part[0] / gap[0]), np.nan, np.nan)
    # The share is infinite in the few replicates that may still have no gap; where an end of the
    # interval falls on these it has no bounds either.
    shares = np.where(gap > 0, part / np.where(gap > 0, gap, 1.0), np.copysign(np.inf, part))
    with np.errstate(invalid="ignore"):
        return interval(shares)


def resampled_means(values: Array, motion: NDArray[np.int64], *, replicates: int) -> Array:
    """Means over trials under a bootstrap of motions, values (k, trials), shape (replicates, k)."""
    from vsr2.campaign import motion_resamples

    counts = motion_resamples(motion, replicates, seed=0)
    return np.asarray((counts @ values.T) / counts.sum(axis=1)[:, None])
