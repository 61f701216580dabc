"""Goodness of fit, of the model without effect and of the library: checks without an alternative.

The posterior weighs hypotheses against one another. Where all of them fit badly, the least bad wins
with a high probability. So the campaign is also held against simulated ones, in prior predictive
checks (G. E. P. Box, "Sampling and Bayes' inference in scientific modelling and robustness", J. R.
Stat. Soc. A 143, 1980):

- against those without effect by its misfit, the mean square of standardised outcomes and features;
- against all, with effects and without, by the share of its misfit that the discriminants of the
  library do not reproduce. Large effects leave a smaller share than small ones, so it is compared
  among campaigns of like misfit.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class LibraryFitConstants:
    """With which campaigns one is compared; chosen by hand.

    Attributes:
        like: share of the simulated campaigns, those whose misfit is nearest.
        fewest: such campaigns, if there are as many; a tail probability below `NAMING.least_fit`
            needs a hundred.
    """

    like: float = 0.1
    fewest: int = 200


LIBRARY_FIT = LibraryFitConstants()


@dataclass(frozen=True, eq=False)
class LibraryFit:
    """What the library leaves unexplained of simulated campaigns, disturbed and held out.

    Attributes:
        size: logarithms of their misfits, rising, shape (n,).
        unexplained: logarithms of the shares of these that are left, shape (n,).
    """

    size: Array
    unexplained: Array

    @classmethod
    def of(cls, size: Array, unexplained: Array) -> LibraryFit:
        """From campaigns in any order, both shape (n,)."""
        order = np.argsort(size, kind="stable")
        return cls(size[order], unexplained[order])

    def probability(self, size: float, unexplained: float) -> float:
        """Share of the campaigns of like misfit of which at least as much is left.

        The observed one counts with them, so that no probability is 0.

        Args:
            size: logarithm of the misfit.
            unexplained: logarithm of the share that is left.
        """
        count = min(max(LIBRARY_FIT.fewest, int(LIBRARY_FIT.like * len(self.size))), len(self.size))
        middle = int(np.searchsorted(self.size, size))
        first = int(np.clip(middle - count // 2, 0, len(self.size) - count))
        above = int((self.unexplained[first : first + count] >= unexplained).sum())
        return (1 + above) / (1 + count)


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
