"""Goodness of fit, of the model without effect and of the library: checks without an alternative.

The posterior weighs hypotheses against one another. Where all of them fit badly, the least bad wins
with a high probability. So the campaign is also held against simulated ones, in prior predictive
checks (G. E. P. Box, "Sampling and Bayes' inference in scientific modelling and robustness", J. R.
Stat. Soc. A 143, 1980):

- against those without effect by its misfit, the mean square of standardised outcomes and features;
- against all, with effects and without, by the share of its misfit that the discriminants of the
  library do not reproduce. Some effects leave a larger share than others, and small ones a larger
  one than large ones. So what is left is compared with what is expected of a campaign of this
  misfit and of this posterior of what acts, as in a posterior predictive check (A. Gelman, X.-L.
  Meng and H. Stern, "Posterior predictive assessment of model fitness via realized discrepancies",
  Statistica Sinica 6, 1996).
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
    """How what is left of a campaign is predicted; chosen by hand.

    Attributes:
        penalty: of the squares of the coefficients, in campaigns.
        tiny: least width of the range of sizes, and share of a campaign that others do not tell;
            added to the squares of errors before their logarithm is taken.
    """

    penalty: float = 1.0
    tiny: float = 1e-6


LIBRARY_FIT = LibraryFitConstants()


@dataclass(frozen=True, eq=False)
class LibraryFit:
    """What the library is expected to leave unexplained of a campaign, and by how much it errs.

    Attributes:
        sizes: least and greatest of the logarithms of misfits, shape (2,).
        expected: coefficients of the logarithm of the share that is left, constant first, shape
            (coefficients,).
        spread: of the logarithm of the squared error, by the size alone, shape (3,).
        errors: of simulated campaigns, disturbed and held out, each over its spread and predicted
            without itself, rising, shape (n,).
    """

    sizes: Array
    expected: Array
    spread: Array
    errors: Array

    @staticmethod
    def coefficients(effects: int) -> int:
        """Number of coefficients by a library of so many effects."""
        return 1 + 2 + 2 * (effects + 1)

    @classmethod
    def of(cls, size: Array, unexplained: Array, acts: Array) -> LibraryFit:
        """From simulated campaigns.

        Args:
            size: logarithms of their misfits, shape (n,).
            unexplained: logarithms of the shares of these that are left, shape (n,).
            acts: posterior probability of each effect and of a cause outside, shape (n, effects
                + 1).
        """
        sizes = np.array([size.min(), size.max()])
        by_size = _by_size(sizes, size)
        terms = _with_acts(by_size, acts)
        expected, errors = _without_itself(terms, unexplained)
        spread, _ = _without_itself(by_size, np.log(errors**2 + LIBRARY_FIT.tiny))
        return cls(sizes, expected, spread, np.sort(errors / _deviation(by_size, spread)))

    def probability(self, size: Array, unexplained: Array, acts: Array) -> Array:
        """Share of simulated campaigns that exceed what is expected of them at least as much.

        The observed one counts with them, so that no probability is 0.

        Args:
            size: logarithms of misfits, shape (m,).
            unexplained: logarithms of the shares that are left, shape (m,).
            acts: posterior probability of each effect and of a cause outside, shape (m, effects
                + 1).

        Returns:
            Shape (m,).
        """
        by_size = _by_size(self.sizes, size)
        expected = _with_acts(by_size, acts) @ self.expected
        errors = (unexplained - expected) / _deviation(by_size, self.spread)
        return tail_probability(errors, self.errors)


def _by_size(sizes: Array, size: Array) -> Array:
    """One, the place in the range of sizes, from 0 to 1, and its square, shape (n, 3)."""
    least, most = sizes
    place = (np.clip(size, least, most) - least) / max(most - least, LIBRARY_FIT.tiny)
    return np.stack([np.ones(len(place)), place, place**2], axis=1)


def _with_acts(by_size: Array, acts: Array) -> Array:
    """The same, what acts, and its products with the place, shape (n, coefficients)."""
    return np.concatenate([by_size, acts, acts * by_size[:, 1:2]], axis=1)


def _deviation(by_size: Array, spread: Array) -> Array:
    return np.asarray(np.exp(0.5 * (by_size @ spread)))


def _without_itself(x: Array, y: Array) -> tuple[Array, Array]:
    """Coefficients of a ridge regression, and the error of each row when it is left out.

    That is its error over 1 less its leverage (D. M. Allen, "The relationship between variable
    selection and data augmentation and a method for prediction", Technometrics 16, 1974).

    Args:
        x: its first column is 1, whose coefficient is free, shape (n, columns).
        y: shape (n,).
    """
    penalty = np.full(x.shape[1], LIBRARY_FIT.penalty)
    penalty[0] = 0.0
    inverse = np.linalg.inv(x.T @ x + np.diag(penalty))
    coefficients = inverse @ (x.T @ y)
    leverage = np.einsum("ij,jk,ik->i", x, inverse, x)
    return coefficients, (y - x @ coefficients) / np.maximum(1 - leverage, LIBRARY_FIT.tiny)


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
