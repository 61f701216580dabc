"""Goodness of fit of the model without effect: a check without an alternative.

The posterior weighs hypotheses against one another. So the campaign is also held against simulated
ones without effect by its misfit, the mean square of standardised outcomes and features: a prior
predictive check (G. E. P. Box, "Sampling and Bayes' inference in scientific modelling and
robustness", J. R. Stat. Soc. A 143, 1980).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.linear_algebra import blocks
from vsr2.posterior.summaries import Copies, Standards

Array = NDArray[np.float64]


def misfit(residuals: Array) -> Array:
    """Mean square of standardised residuals, shape (..., columns) to (...)."""
    return np.asarray((residuals**2).mean(axis=-1))


def misfits_by(standards: Standards, copies: Copies, fold: NDArray[np.int64]) -> Array:
    """Misfits of campaigns, each standardised by those of the other folds, shape (copies, n).

    A campaign that is among those that it is standardised by seems to fit better than a new one.

    Args:
        standards: by the other folds.
        copies: of the campaigns that are judged.
        fold: group of each campaign, shape (n,).
    """
    out = np.zeros((len(copies), len(fold)))
    for k, standard in enumerate(standards.others):
        held = np.flatnonzero(fold == k)
        for row, (outcome, features) in zip(out, copies, strict=True):
            for part in blocks(held.size, features[0].size + outcome[0].size):
                own = held[part]
                noted = features[own].astype(np.float64)
                row[own] = misfit(standard.residuals(outcome[own], noted))
    return out


def tail_probability(observed: Array, known: Array) -> Array:
    """Share of known values that are at least as large; 1 where there are none.

    Each observed one counts with them, so that no probability is 0 (A. C. Davison and D. V.
    Hinkley, "Bootstrap methods and their application", 1997, section 4.2).

    Args:
        observed: any shape.
        known: rising, shape (m,).

    Returns:
        Of each, in the shape of `observed`.
    """
    above = known.size - np.searchsorted(known, observed, side="left")
    return np.asarray((1 + above) / (1 + known.size))
