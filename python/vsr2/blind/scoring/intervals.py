"""Intervals of scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LEVEL = 0.95
REPLICATES = 2000


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


def proportion(hits: int, count: int) -> Score:
    """A proportion with the exact interval of Clopper and Pearson (1934).

    Its bounds are the beta quantiles B(0.025; k, n - k + 1) and B(0.975; k + 1, n - k).
    """
    if count == 0:
        return Score(float("nan"), float("nan"), float("nan"), 0)
    from scipy.stats import beta

    tail = (1 - LEVEL) / 2
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return Score(hits / count, low, high, count)


def resampled(values: ArrayLike, statistic: Callable[[Array], Array], *, seed: int = 0) -> Score:
    """A statistic of campaigns with the percentile interval of a bootstrap over campaigns.

    Of a statistic that resampling biases (a calibration error) that interval may lie beside the
    value; it is widened to hold it.

    Args:
        values: one row a campaign, shape (n,) or (n, k).
        statistic: of many samples of such rows at once, (samples, n) or (samples, n, k) to
            (samples,); may be NaN for a sample it is not defined on.
        seed: of the resamples.
    """
    rows = np.asarray(values, dtype=np.float64)
    count = len(rows)
    if count == 0:
        return Score(float("nan"), float("nan"), float("nan"), 0)
    rng = np.random.default_rng(seed)
    draws = statistic(rows[rng.integers(count, size=(REPLICATES, count))])
    known = draws[np.isfinite(draws)]
    low, high = (
        np.quantile(known, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        if known.size and count > 1
        else (np.nan, np.nan)
    )
    value = float(statistic(rows[None])[0])
    return Score(value, float(min(low, value)), float(max(high, value)), count)


def area_under_roc(samples: Array) -> Array:
    """Probability that a positive's score exceeds a negative's, ties for one half.

    Args:
        samples: score and label (1 or 0), shape (samples, n, 2).
    """
    out = np.full(len(samples), np.nan)
    for i, rows in enumerate(samples):
        positive, negative = rows[rows[:, 1] == 1, 0], rows[rows[:, 1] == 0, 0]
        if positive.size and negative.size:
            above = positive[:, None] > negative[None, :]
            level = positive[:, None] == negative[None, :]
            out[i] = above.mean() + 0.5 * level.mean()
    return out


def calibration_error(samples: Array, bins: int = 10) -> Array:
    """Expected calibration error over equally wide bins of probability (Naeini et al. 2015).

    Args:
        samples: stated probability and whether it came true (1 or 0), shape (samples, n, 2).
        bins: number of them.
    """
    stated, true = samples[..., 0], samples[..., 1]
    place = np.minimum((stated * bins).astype(int), bins - 1)
    gaps = [np.abs(((stated - true) * (place == i)).sum(axis=1)) for i in range(bins)]
    total: Array = np.sum(gaps, axis=0) / stated.shape[1]
    return total


def calibration_noise(stated: ArrayLike, *, seed: int = 0) -> Score:
    """The calibration error that true probabilities would get: the mean, and 95 % of all draws.

    In each draw as many campaigns come true with the stated probabilities. Of few campaigns the
    error is far from 0 however true what is stated (Broecker and Smith 2007, Weather and
    Forecasting 22).

    Args:
        stated: probabilities, shape (n,).
        seed: of the draws.
    """
    p = np.asarray(stated, dtype=np.float64)
    if not len(p):
        return Score(float("nan"), float("nan"), float("nan"), 0)
    true = np.random.default_rng(seed).random((REPLICATES, len(p))) < p
    draws = calibration_error(np.stack([np.broadcast_to(p, true.shape), true], axis=-1))
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Score(float(draws.mean()), float(low), float(high), len(p))


def reliability(rows: Array, bins: int = 10) -> list[tuple[float, float, float, int]]:
    """Of each bin that holds campaigns: its lower edge, mean probability, frequency, number."""
    place = np.minimum((rows[:, 0] * bins).astype(int), bins - 1)
    out = []
    for i in range(bins):
        inside = rows[place == i]
        if len(inside):
            stated, true = inside.mean(axis=0)
            out.append((i / bins, float(stated), float(true), len(inside)))
    return out
