"""How well predictions agree with a campaign, as a search needs it: always a number.

The objective is the supplement's (S3): the unweighted mean of accuracy, precision and recall. Where
precision or recall is undefined (nothing predicted, or nothing observed, to overturn) it counts as
0 here. A trial without an outcome (`failed`) counts as wrongly predicted, so that settings which
make trials fail gain nothing by it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import Classification, classification_metrics
from vsr2.analysis.bootstrap import score_replicates

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def as_predictions(observed: Mask, predicted: Array) -> Mask:
    """Predictions with every failed trial counted as wrong.

    Args:
        observed: whether each trial overturned, shape (n,).
        predicted: 1, 0, or NaN for a failed trial, shape (n,).
    """
    return np.where(np.isnan(predicted), ~observed, predicted == 1)


def metrics_of(observed: Mask, predicted: Array, among: Mask | None = None) -> Classification:
    """Counts and scores, of all trials or of those in `among`."""
    guess = as_predictions(observed, predicted)
    if among is None:
        return classification_metrics(observed, guess)
    return classification_metrics(observed[among], guess[among])


def objective_of(observed: Mask, predicted: Array, among: Mask | None = None) -> float:
    """The objective with undefined parts as 0."""
    found = metrics_of(observed, predicted, among)
    return float(np.nan_to_num([found.accuracy, found.precision, found.recall]).sum() / 3.0)


def objective_replicates(
    observed: Mask, predicted: Array, counts: NDArray[np.int32] | NDArray[np.int64]
) -> Array:
    """The objective in each bootstrap replicate.

    Args:
        observed: shape (n,).
        predicted: 1, 0 or NaN, shape (n,).
        counts: how often each trial is drawn, shape (replicates, n)
            (:func:`vsr2.campaign.motion_resamples`).

    Returns:
        Shape (replicates,).
    """
    drawn = score_replicates(observed, as_predictions(observed, predicted), counts)
    parts = [np.nan_to_num(drawn[name]) for name in ("accuracy", "precision", "recall")]
    mean: Array = (parts[0] + parts[1] + parts[2]) / 3.0
    return mean
