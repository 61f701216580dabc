"""Probabilities of overturning: from replicates, and how well they agree with what was observed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.bootstrap import SCORES, Interval, percentile_interval, score_replicates
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.metrics import classification_metrics
from vsr2.campaign import motion_resamples
from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.read_only import label_argument, real_argument, truth_argument

Array = NDArray[np.float64]

PROBABILITY_SCORES = ("log_loss", "brier", *SCORES)
"""Scores that :func:`probability_intervals` gives; those of `SCORES` are of outcomes at 0.5."""


@dataclass(frozen=True)
class ReliabilityRules:
    """How a calibration curve is drawn; all are choices, none is fitted.

    Attributes:
        bins: of equal width between 0 and 1, a tenth each, as reliability diagrams usually have.
        threshold: probability above which a trial is predicted to overturn: where both errors cost
            the same, one half costs least.
    """

    bins: int = 10
    threshold: float = 0.5


RELIABILITY = ReliabilityRules()


@dataclass(frozen=True)
class ReliabilityBin:
    """A bin of the calibration curve.

    Attributes:
        low, high: its ends.
        trials: in it.
        predicted: their mean probability; NaN: none.
        observed: share of them that overturned.
    """

    low: float
    high: float
    trials: int
    predicted: float
    observed: Interval


def overturning_probability(overturned: ArrayLike) -> Array:
    """Probability of overturning from replicates, (k + 1/2) / (n + 1).

    k of the n replicates with an outcome overturned: the posterior mean under Jeffreys' prior, so
    that the logarithmic loss is finite (H. Jeffreys, "Theory of Probability", 1961).

    Args:
        overturned: 1 or 0, NaN where there is no outcome, shape (replicates, trials).

    Returns:
        Shape (trials,); 1/2 where no replicate has an outcome.

    Raises:
        ResultError: outcomes that are no numbers or truth values.
    """
    ends = real_argument(overturned, "overturned", ResultError, truths=True)
    ones, known = np.nansum(ends, axis=0), np.isfinite(ends).sum(axis=0)
    return np.asarray((ones + 0.5) / (known + 1))


def probability_error(overturned: ArrayLike) -> Array:
    """Monte-Carlo standard error of :func:`overturning_probability`, shape (trials,).

    The standard deviation of the same posterior, sqrt(p (1 - p) / (n + 2)).

    Args:
        overturned: as there.

    Raises:
        ResultError: as there.
    """
    ends = real_argument(overturned, "overturned", ResultError, truths=True)
    p, known = overturning_probability(ends), np.isfinite(ends).sum(axis=0)
    return np.asarray(np.sqrt(p * (1 - p) / (known + 2)))


def outcome_loss(probability: Array, overturned: Array) -> Array:
    """Logarithmic loss of outcomes [nat], shape (n,); 0 where nothing is known.

    Args:
        probability: of overturning, between 0 and 1, shape (n,).
        overturned: 1 or 0, NaN where unknown, shape (n,).
    """
    loss = -np.where(overturned > 0.5, np.log(probability), np.log1p(-probability))
    return np.where(np.isfinite(overturned), loss, 0.0)


def probability_intervals(
    observed: ArrayLike,
    probability: ArrayLike,
    motions: ArrayLike,
    *,
    replicates: int = INTERVALS.replicates,
    seed: int = 0,
) -> Mapping[str, Interval]:
    """Log loss [nat], Brier score and scores of outcomes at 0.5, with intervals over motions.

    Args:
        observed: whether each trial overturned, boolean, shape (n,).
        probability: of overturning, above 0 and below 1, shape (n,).
        motions: ground motion of each trial, shape (n,).
        replicates: of the bootstrap.
        seed: of its draws.

    Returns:
        By the names in `PROBABILITY_SCORES`.

    Raises:
        ResultError: shapes that differ, or a probability that is not between 0 and 1.
        CampaignError: no trials, or a number of replicates that cannot be.
    """
    truth, p, groups = _checked(observed, probability, motions)
    guess = p > RELIABILITY.threshold
    counts = motion_resamples(groups, replicates, seed)
    losses = {"log_loss": outcome_loss(p, truth.astype(np.float64)), "brier": (p - truth) ** 2}
    found = classification_metrics(truth, guess)
    drawn = {
        name: (float(values.mean()), counts @ values / counts.sum(axis=1))
        for name, values in losses.items()
    }
    for name, values in score_replicates(truth, guess, counts).items():
        drawn[name] = float(getattr(found, name)), values
    return {name: percentile_interval(*drawn[name]) for name in PROBABILITY_SCORES}


def reliability(
    observed: ArrayLike,
    probability: ArrayLike,
    motions: ArrayLike,
    *,
    replicates: int = INTERVALS.replicates,
    seed: int = 0,
) -> tuple[ReliabilityBin, ...]:
    """The calibration curve: share observed in bins of what was predicted.

    Args:
        observed: whether each trial overturned, boolean, shape (n,).
        probability: of overturning, above 0 and below 1, shape (n,).
        motions: ground motion of each trial, shape (n,).
        replicates: of the bootstrap over motions.
        seed: of its draws.

    Raises:
        ResultError, CampaignError: as :func:`probability_intervals`.
    """
    truth, p, groups = _checked(observed, probability, motions)
    counts = motion_resamples(groups, replicates, seed)
    place = np.minimum((p * RELIABILITY.bins).astype(np.intp), RELIABILITY.bins - 1)
    out = []
    for k in range(RELIABILITY.bins):
        inside = place == k
        low, high = k / RELIABILITY.bins, (k + 1) / RELIABILITY.bins
        trials = int(inside.sum())
        if not trials:
            blank = Interval(math.nan, math.nan, math.nan, math.nan, 1.0)
            out.append(ReliabilityBin(low, high, 0, math.nan, blank))
            continue
        total = counts @ inside.astype(np.float64)
        share = np.full(len(counts), np.nan)
        np.divide(counts @ (inside & truth).astype(np.float64), total, out=share, where=total > 0)
        seen = percentile_interval(float(truth[inside].mean()), share)
        out.append(ReliabilityBin(low, high, trials, float(p[inside].mean()), seen))
    return tuple(out)


def _checked(
    observed: ArrayLike, probability: ArrayLike, motions: ArrayLike
) -> tuple[NDArray[np.bool_], Array, NDArray[np.str_]]:
    truth = truth_argument(observed, "observed", ResultError)
    groups = label_argument(motions, "motions", ResultError)
    p = real_argument(probability, "probability", ResultError)
    if not truth.shape == groups.shape == p.shape:
        raise ResultError(
            f"{counted(truth.size, 'outcome')}, {p.size} probabilities and "
            f"{counted(groups.size, 'motion')}; give one each"
        )
    if not ((p > 0) & (p < 1)).all():
        raise ResultError("a probability is not between 0 and 1; no score holds for certainty")
    return truth, p, groups
