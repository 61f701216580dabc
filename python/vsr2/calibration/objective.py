"""How well predictions agree with a campaign, as a search needs it: always a number.

A prediction is a probability of overturning; of a single run it is 0 or 1. The objective is the
supplement's (S3), the unweighted mean of accuracy, precision and recall of the outcomes at 0.5, or
the mean log loss with a minus sign. Where precision or recall is undefined (nothing predicted, or
nothing observed, to overturn) it counts as 0 here. A trial without an outcome (`failed`) counts as
wrongly predicted, so that settings which make trials fail gain nothing by it.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import Classification, classification_metrics
from vsr2.analysis.bootstrap import score_replicates
from vsr2.analysis.probability import RELIABILITY, outcome_loss

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Objective(StrEnum):
    """What a search maximises."""

    MEAN_OF_THREE = "mean_of_three"
    """Of accuracy, precision and recall."""
    LOG_LOSS = "log_loss"
    """The mean logarithmic loss [nat], with a minus sign."""


def as_predictions(observed: Mask, predicted: Array) -> Mask:
    """Outcomes at 0.5 with every failed trial counted as wrong.

    Args:
        observed: whether each trial overturned, shape (n,).
        predicted: probability of it, NaN for a failed trial, shape (n,).
    """
    return np.where(np.isnan(predicted), ~observed, predicted > RELIABILITY.threshold)


def metrics_of(observed: Mask, predicted: Array, among: Mask | None = None) -> Classification:
    """Counts and scores, of all trials or of those in `among`."""
    guess = as_predictions(observed, predicted)
    if among is None:
        return classification_metrics(observed, guess)
    return classification_metrics(observed[among], guess[among])


def objective_of(
    observed: Mask,
    predicted: Array,
    among: Mask | None = None,
    objective: Objective = Objective.MEAN_OF_THREE,
) -> float:
    """The objective with undefined parts as 0, of all trials or of those in `among`."""
    if objective is Objective.LOG_LOSS:
        losses = _losses(observed, predicted)
        return -float(losses.mean() if among is None else losses[among].mean())
    found = metrics_of(observed, predicted, among)
    return float(np.nan_to_num([found.accuracy, found.precision, found.recall]).sum() / 3.0)


def _losses(observed: Mask, predicted: Array) -> Array:
    """Log loss of each trial; infinite where a failed trial or a certain one is wrong."""
    p = np.where(np.isnan(predicted), ~observed, predicted)
    with np.errstate(divide="ignore"):
        return outcome_loss(p, observed.astype(np.float64))


def objective_replicates(
    observed: Mask,
    predicted: Array,
    counts: NDArray[np.int32] | NDArray[np.int64],
    objective: Objective = Objective.MEAN_OF_THREE,
) -> Array:
    """The objective in each bootstrap replicate.

    Args:
        observed: shape (n,).
        predicted: probability or NaN, shape (n,).
        counts: how often each trial is drawn, shape (replicates, n)
            (:func:`vsr2.campaign.motion_resamples`).
        objective: which.

    Returns:
        Shape (replicates,).
    """
    if objective is Objective.LOG_LOSS:
        return np.asarray(-(counts @ _losses(observed, predicted)) / counts.sum(axis=1))
    drawn = score_replicates(observed, as_predictions(observed, predicted), counts)
    parts = [np.nan_to_num(drawn[name]) for name in ("accuracy", "precision", "recall")]
    mean: Array = (parts[0] + parts[1] + parts[2]) / 3.0
    return mean
