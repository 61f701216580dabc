"""Intervals of scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.config.seeds import checked_seed
from vsr2.errors import ResultError
from vsr2.read_only import real_argument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IntervalRules:
    """How intervals are made; all are choices, none is fitted.

    Attributes:
        level: of all intervals; usual in engineering statistics.
        replicates: of a bootstrap, and draws of true probabilities; usual for percentile intervals
            (Efron and Tibshirani 1993).
        inner: quantiles of a second, narrower interval of parameters.
        bins: of probability, for calibration errors: a tenth each, as in
            :class:`vsr2.analysis.probability.ReliabilityRules`.
    """

    level: float = 0.95
    replicates: int = 2000
    inner: tuple[float, float] = (0.05, 0.95)
    bins: int = 10

    @property
    def ends(self) -> tuple[float, float]:
        """Quantiles that an interval lies between, as decimal fractions are read."""
        return round((1 - self.level) / 2, 12), round((1 + self.level) / 2, 12)


INTERVALS = IntervalRules()


@dataclass(frozen=True)
class Score:
    """One figure with its 95 % interval.

    Attributes:
        value: NaN where nothing could be scored.
        low, high: of the interval; NaN where there is none.
        count: campaigns behind it.
    """

    value: float
    low: float
    high: float
    count: int


NOTHING = Score(np.nan, np.nan, np.nan, 0)


def proportion(hits: int, count: int) -> Score:
    """A proportion with the exact interval of Clopper and Pearson (1934), by beta quantiles."""
    if count == 0:
        return NOTHING
    from scipy.special import betaincinv

    low, high = INTERVALS.ends
    least = float(betaincinv(hits, count - hits + 1, low)) if hits else 0.0
    most = float(betaincinv(hits + 1, count - hits, high)) if hits < count else 1.0
    return Score(hits / count, least, most, count)


def resampled(values: ArrayLike, statistic: Callable[[Array], Array], *, seed: int = 0) -> Score:
    """A statistic of campaigns with the percentile interval of a bootstrap over campaigns.

    Of a statistic that resampling biases (a calibration error) that interval may lie beside the
    value; it is widened to hold it. `scipy.stats.bootstrap` has no interval where some resample
    has no statistic (an AUROC without a positive); here those resamples are left out.

    Args:
        values: one row a campaign, shape (n,) or (n, k).
        statistic: of many samples of such rows at once, (samples, n) or (samples, n, k) to
            (samples,); may be NaN for a sample it is not defined on.
        seed: of the resamples.

    Raises:
        ResultError: values that are no real numbers or truth values, or what is no seed.
    """
    rows = real_argument(values, "values", ResultError, truths=True)
    count = len(rows)
    if count == 0:
        return NOTHING
    rng = np.random.default_rng(checked_seed(seed, ResultError))
    draws = statistic(rows[rng.integers(count, size=(INTERVALS.replicates, count))])
    known = draws[np.isfinite(draws)]
    value = float(statistic(rows[None])[0])
    if not known.size or count == 1:
        return Score(value, np.nan, np.nan, count)
    low, high = np.quantile(known, INTERVALS.ends)
    return Score(value, float(min(low, value)), float(max(high, value)), count)


def area_under_roc(samples: Array) -> Array:
    """Probability that a positive's score exceeds a negative's, ties for one half.

    By the rank sum of the positives (Mann and Whitney 1947), for all samples at once.

    Args:
        samples: score and label (1 or 0), shape (samples, n, 2).

    Returns:
        Shape (samples,), NaN where one of the labels is missing.
    """
    from scipy.stats import rankdata

    label = samples[..., 1]
    positive = label.sum(axis=1)
    pairs = positive * (label.shape[1] - positive)
    above = (rankdata(samples[..., 0], axis=1) * label).sum(axis=1) - positive * (positive + 1) / 2
    out: Array = np.where(pairs > 0, above / np.maximum(pairs, 1), np.nan)
    return out


def calibration_error(samples: Array, weight: ArrayLike = 1.0) -> Array:
    """Expected calibration error over equally wide bins of probability (Naeini et al. 2015).

    Args:
        samples: stated probability and whether it came true (1 or 0), shape (samples, n, 2).
        weight: of each of the n, shape (n,); the default counts all alike.
    """
    stated, true, bins = samples[..., 0], samples[..., 1], INTERVALS.bins
    inside = np.minimum((stated * bins).astype(int), bins - 1)
    counts = np.broadcast_to(np.asarray(weight, dtype=np.float64), stated.shape[1:])
    gaps = [np.abs(((stated - true) * counts * (inside == i)).sum(axis=1)) for i in range(bins)]
    total: Array = np.sum(gaps, axis=0) / counts.sum()
    return total


def calibration_noise(stated: ArrayLike) -> Score:
    """The calibration error that true probabilities would get: the mean, and 95 % of all draws.

    In each draw as many campaigns come true with the stated probabilities. Of few campaigns the
    error is far from 0 however true what is stated (Broecker and Smith 2007, Weather and
    Forecasting 22).

    Args:
        stated: probabilities, shape (n,).

    Raises:
        ResultError: they are no real numbers.
    """
    p = real_argument(stated, "stated", ResultError)
    if not len(p):
        return NOTHING
    true = np.random.default_rng(0).random((INTERVALS.replicates, len(p))) < p
    draws = calibration_error(np.stack([np.broadcast_to(p, true.shape), true], axis=-1))
    low, high = np.quantile(draws, INTERVALS.ends)
    return Score(float(draws.mean()), float(low), float(high), len(p))
