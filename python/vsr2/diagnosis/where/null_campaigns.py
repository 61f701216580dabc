"""Gap-free campaigns drawn from the fitted model of no effect, as many as a p value needs.

The engine's own are few. Nuisances are drawn from their prior, outcomes and features from the
emulator's distributions: what the engine's campaigns share with these is how locations and channels
hang together, and that is all that :mod:`vsr2.diagnosis.where.scan` takes from them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.evidence import LAPSE, Data, Table
from vsr2.diagnosis.likelihood.regression import DEGREES

COUNT = 999
"""Campaigns: the least p value is 0.001."""


def null_campaigns(table: Table, simulated: Data, *, count: int = COUNT, seed: int = 0) -> Data:
    """Draw campaigns.

    Args:
        table: of the hypothesis without parameters.
        simulated: the engine's gap-free campaigns; what their features lack, the drawn ones lack
            as often, trial by trial.
        count: of campaigns.
        seed: of the draws.

    Returns:
        Outcomes (count, trials) and features (count, trials, k).
    """
    rng = np.random.default_rng([seed, 7])
    at = table.fine.at(0)
    trials = at.logit.shape[1]
    z = rng.standard_normal((count, table.nuisances))
    logit = at.logit + at.factor * table.slope(z)
    p = LAPSE + (1 - 2 * LAPSE) / (1 + np.exp(-np.clip(logit, -30, 30)))
    overturned = (rng.random(p.shape) < p).astype(np.float64)
    features = np.full((count, trials, len(at.centre)), np.nan)
    for k, (centre, variance, response) in enumerate(
        zip(at.centre, at.variance, table.response, strict=True)
    ):
        noise = np.sqrt(variance) * rng.standard_t(DEGREES, p.shape)
        share = np.where(
            overturned > 0.5,
            _known(simulated.features[..., k], simulated.overturned > 0.5),
            _known(simulated.features[..., k], simulated.overturned < 0.5),
        )
        seen = rng.random(p.shape) < share
        features[..., k] = np.where(seen, centre + response(z) + noise, np.nan)
    return Data(overturned, features)


def _known(values: NDArray[np.float64], among: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Share of known values of each trial among some campaigns; 0 where there are none."""
    there = np.isfinite(values) & among
    return np.asarray(there.sum(axis=0) / np.maximum(among.sum(axis=0), 1), dtype=np.float64)
