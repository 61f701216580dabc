"""Losses of predictions, their floor, and intervals over motion blocks.

The loss of a trial is the logarithmic loss of its outcome plus, from tier M on, the continuous
ranked probability score of the logarithm of its largest tilt and, at tier T, the mean score of its
series' features, each a normal distribution's (T. Gneiting and A. E. Raftery, "Strictly proper
scoring rules, prediction, and estimation", JASA 102, 2007; the energy distance in one dimension).
The floor is the mean loss of campaigns simulated without any effect, nuisances drawn,
that are treated as the observed one is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.evidence import Data, Prediction, Table, posterior, predict

Array = NDArray[np.float64]

BLOCKS = 5
"""Groups of motions for cross-fitting."""


def losses(prediction: Prediction, data: Data) -> Array:
    """Loss of each trial, shape (campaigns, trials); 0 where nothing is known."""
    p, y = prediction.probability, data.overturned
    out = np.where(np.isfinite(y), -np.where(y > 0.5, np.log(p), np.log1p(-p)), 0.0)
    return np.asarray(out + _feature_scores(prediction, data), dtype=np.float64)


def by_kind(scores: Array) -> Array:
    """The largest tilt's score plus the mean of the others."""
    if scores.shape[-1] == 0:
        return np.zeros(scores.shape[:-1])
    out = scores[..., 0]
    if scores.shape[-1] > 1:
        out = out + scores[..., 1:].mean(axis=-1)
    return np.asarray(out, dtype=np.float64)


def _feature_scores(prediction: Prediction, data: Data) -> Array:
    from scipy.special import ndtr

    known = np.isfinite(data.features)
    z = np.where(known, data.features - prediction.centre, 0.0) / prediction.deviation
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    score = prediction.deviation * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))
    return by_kind(np.where(known, score, 0.0))


def blocks(motion: NDArray[np.int64], outcomes: Array) -> NDArray[np.int64]:
    """Group of each trial's motion, 0 to `BLOCKS` - 1, shape (trials,)."""
    from vsr2.campaign.folds import grouped_folds

    count = min(BLOCKS, np.unique(motion).size)
    return grouped_folds(motion, outcomes, count, seed=0)


def crossfitted(table: Table, data: Data, group: NDArray[np.int64]) -> Prediction:
    """Predict each group of trials from what the others say of parameters and nuisances."""
    parts: list[tuple[NDArray[np.bool_], Prediction]] = []
    for k in np.unique(group):
        judged = group == k
        parts.append((judged, predict(table, posterior(table, data.only(~judged)))))
    first = parts[0][1]
    p, centre, deviation = (first.probability.copy(), first.centre.copy(), first.deviation.copy())
    for judged, found in parts[1:]:
        p[:, judged] = found.probability[:, judged]
        centre[:, judged] = found.centre[:, judged]
        deviation[:, judged] = found.deviation[:, judged]
    return Prediction(p, centre, deviation)


def crossfitted_none(table: Table, data: Data, motion: NDArray[np.int64]) -> Prediction:
    """The same for the model without effects, in fixed groups of motions."""
    names = np.unique(motion)
    group = np.searchsorted(names, motion) % min(BLOCKS, names.size)
    return crossfitted(table, data, group)


def novelty_statistics(prediction: Prediction, data: Data, directions: Array) -> Array:
    """How badly campaigns fit: excess loss and largest directed residual, outcomes and features.

    Args:
        prediction: of the best hypothesis.
        data: campaigns.
        directions: weights of trials, shape (directions, trials).

    Returns:
        Shape (campaigns, 2), or (campaigns, 4) with features.
    """
    p, y = prediction.probability, data.overturned
    known = np.isfinite(y)
    variance = np.where(known, p * (1 - p), 0.0)
    residual = np.where(known, y - p, 0.0)
    logit = np.log(p) - np.log1p(-p)
    surprise = -(residual * logit).sum(axis=1)
    surprise /= np.sqrt((variance * logit**2).sum(axis=1) + 1e-9)
    directed = np.abs(residual @ directions.T) / np.sqrt(variance @ (directions**2).T + 1e-9)
    columns = [surprise, directed.max(axis=1)]
    if data.features.shape[-1]:
        gap = (data.features - prediction.centre) / prediction.deviation
        seen = np.isfinite(gap)
        z = np.clip(np.where(seen, gap, 0.0), -4, 4)
        count = np.maximum(seen.sum(axis=(1, 2)), 1)
        columns.append((np.abs(z)).sum(axis=(1, 2)) / count)
        along = np.einsum("ctk,dt->cdk", z, directions)
        size = np.sqrt(np.einsum("ctk,dt->cdk", seen.astype(np.float64), directions**2) + 1e-9)
        columns.append(np.abs(along / size).max(axis=(1, 2)))
    return np.stack(columns, axis=1)
