"""Goodness of fit of the model without effect: a check that needs no alternative.

The posterior weighs hypotheses against one another. Where all of them fit badly, the least bad wins
with a high probability. So the campaign is also held against simulated campaigns without effect:
the misfit is the mean square of standardised outcomes and features, and its tail probability
that of a prior predictive check (G. E. P. Box, "Sampling and Bayes' inference in scientific
modelling and robustness", J. R. Stat. Soc. A 143, 1980).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.posterior.summaries import SUMMARY, Standard

Array = NDArray[np.float64]
Copies = list[tuple[Array, Array]]
"""Outcomes, shape (n, trials), and features, shape (n, trials, k), of each copy of campaigns."""


def misfit(residuals: Array) -> Array:
    """Mean square of standardised residuals, shape (..., columns) to (...)."""
    return np.asarray((residuals**2).mean(axis=-1))


def gap_free_misfits(copies: Copies, gap_free: NDArray[np.bool_], fold: NDArray[np.int64]) -> Array:
    """Discrepancies of disturbed campaigns without effect, each standardised by other campaigns.

    A campaign that is among those that it is standardised by seems to fit better than a new one.

    Args:
        copies: campaigns as simulated, then disturbed.
        gap_free: which have no effect, shape (n,).
        fold: group of each campaign, shape (n,).

    Returns:
        Rising, one for each disturbed copy of each campaign without effect.
    """
    out = []
    for k in range(SUMMARY.folds):
        held, rest = gap_free & (fold == k), fold != k
        if not held.any() or not (rest & gap_free).any():
            continue
        standard = Standard.of(
            np.concatenate([one[rest] for one, _ in copies]),
            np.concatenate([one[rest] for _, one in copies]),
            np.concatenate([gap_free[rest]] * len(copies)),
        )
        out += [misfit(standard.residuals(o[held], f[held])) for o, f in copies[1:]]
    return np.sort(np.concatenate(out)) if out else np.zeros(0)


def fit_probability(observed: float, gap_free: Array) -> float:
    """Tail probability of a misfit among campaigns without effect; 1 where there are none.

    The observed one counts with them, so that the probability is above 0 (A. C. Davison and D. V.
    Hinkley, "Bootstrap methods and their application", 1997, section 4.2).
    """
    above = gap_free.size - int(np.searchsorted(gap_free, observed, side="left"))
    return (1 + above) / (1 + gap_free.size)
