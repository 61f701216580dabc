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


def held_out_misfits(copies: Copies, gap_free: NDArray[np.bool_], fold: NDArray[np.int64]) -> Array:
    """Misfits of disturbed campaigns, each standardised by campaigns of the other folds.

    A campaign that is among those that it is standardised by seems to fit better than a new one.

    Args:
        copies: campaigns as simulated, then disturbed.
        gap_free: which have no effect, shape (n,).
        fold: group of each campaign, shape (n,).

    Returns:
        Of each disturbed copy, shape (copies - 1, n).
    """
    out = np.zeros((len(copies) - 1, len(fold)))
    for k in range(SUMMARY.folds):
        held, rest = fold == k, fold != k
        standard = Standard.of(
            np.concatenate([one[rest] for one, _ in copies]),
            np.concatenate([one[rest] for _, one in copies]),
            np.concatenate([gap_free[rest]] * len(copies)),
        )
        for row, (outcome, features) in zip(out, copies[1:], strict=True):
            row[held] = misfit(standard.residuals(outcome[held], features[held]))
    return out


def fit_probability(observed: Array, gap_free: Array) -> Array:
    """Tail probability of misfits among campaigns without effect; 1 where there are none.

    Each observed one counts with them, so that no probability is 0 (A. C. Davison and D. V.
    Hinkley, "Bootstrap methods and their application", 1997, section 4.2).

    Args:
        observed: misfits, any shape.
        gap_free: those of campaigns without effect, rising, shape (m,).

    Returns:
        Of each, in the shape of `observed`.
    """
    above = gap_free.size - np.searchsorted(gap_free, observed, side="left")
    return np.asarray((1 + above) / (1 + gap_free.size))
