"""Goodness of fit, of the model without effect and of the library: checks without an alternative.

The posterior weighs hypotheses against one another. Where all of them fit badly, the least bad wins
with a high probability. So the campaign is also held against simulated ones, in prior predictive
checks (G. E. P. Box, "Sampling and Bayes' inference in scientific modelling and robustness", J. R.
Stat. Soc. A 143, 1980):

- against those without effect by its misfit, the mean square of standardised outcomes and features;
- against all, with effects and without, by the part of its misfit that the discriminants of the
  library do not reproduce. Large misfits leave more than small ones, and some effects more than
  others. So what is left is compared with what is expected of the misfit and the posterior of what
  acts, as in a posterior predictive check (A. Gelman, X.-L. Meng and H. Stern, "Posterior
  predictive assessment of model fitness via realized discrepancies", Statistica Sinica 6, 1996).
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
        penalty: of the squares of the coefficients of what is expected, in campaigns.
        spread_penalty: of those of its spread: the variance of the logarithm of a squared normal
            error, pi^2 / 2, over that of the effects' logarithms of variances, 0.5^2.
        tiny: least part of a row's error that others do not tell, and least width of the range of
            sizes; added to squares of errors before their logarithm is taken.
    """

    penalty: float = 1.0
    spread_penalty: float = 20.0
    tiny: float = 1e-6


LIBRARY_FIT = LibraryFitConstants()


@dataclass(frozen=True, eq=False)
class LibraryFit:
    """What the library is expected to leave unexplained of a campaign, and by how much it errs.

    Attributes:
        sizes: least and greatest of the logarithms of misfits, shape (2,).
        expected: coefficients of the logarithm of what is left: a constant, of the posterior
            probability of each effect and of a cause outside, of the size and of its square, shape
            (effects + 4,).
        spread: those of the logarithm of its squared error, without the size, shape (effects + 2,).
        errors: of simulated campaigns, disturbed and held out, each predicted without itself, over
            their spread, rising, shape (n,).
    """

    sizes: Array
    expected: Array
    spread: Array
    errors: Array

    @classmethod
    def of(cls, size: Array, unexplained: Array, acts: Array) -> LibraryFit:
        """From simulated campaigns.

        Variances are by A. C. Harvey, "Estimating regression models with multiplicative
        heteroscedasticity", Econometrica 44, 1976.

        Args:
            size: logarithms of their misfits, shape (n,).
            unexplained: of what is left of these, shape (n,).
            acts: posterior probability of each effect and of a cause outside, shape (n, effects
                + 1).
        """
        sizes, x = np.array([size.min(), size.max()]), _with_constant(acts)
        terms = np.concatenate([x, _by_size(sizes, size)], axis=1)
        expected, errors = _regressed(terms, unexplained, LIBRARY_FIT.penalty)
        squares = np.log(errors**2 + LIBRARY_FIT.tiny)
        spread, _ = _regressed(x, squares, LIBRARY_FIT.spread_penalty)
        return cls(sizes, expected, spread, np.sort(errors / _deviation(x, spread)))

    def probability(self, size: Array, unexplained: Array, acts: Array) -> Array:
        """Share of simulated campaigns that exceed what is expected of them at least as much.

        The observed one counts with them, so that no probability is 0.

        Args:
            size: logarithms of misfits, shape (m,); beyond those of the simulated campaigns the
                nearest of these counts.
            unexplained: of what is left of these, shape (m,).
            acts: posterior probability of each effect and of a cause outside, shape (m, effects
                + 1).

        Returns:
            Shape (m,).
        """
        x = _with_constant(acts)
        terms = np.concatenate([x, _by_size(self.sizes, size)], axis=1)
        errors = (unexplained - terms @ self.expected) / _deviation(x, self.spread)
        return tail_probability(errors, self.errors)


def _by_size(sizes: Array, size: Array) -> Array:
    """The place in the range of sizes, from 0 to 1, and its square, shape (n, 2)."""
    least, most = sizes
    place = (np.clip(size, least, most) - least) / max(most - least, LIBRARY_FIT.tiny)
    return np.stack([place, place**2], axis=1)


def _with_constant(acts: Array) -> Array:
    return np.concatenate([np.ones((len(acts), 1)), acts], axis=1)


def _deviation(x: Array, spread: Array) -> Array:
    return np.asarray(np.exp(0.5 * (x @ spread)))


def _regressed(x: Array, y: Array, penalty: float) -> tuple[Array, Array]:
    """Coefficients of a ridge regression, and the error of each row when it is left out.

    That is its error over 1 less its leverage (D. M. Allen, "The relationship between variable
    selection and data augmentation and a method for prediction", Technometrics 16, 1974).

    Args:
        x: its first column is 1, whose coefficient is free, shape (n, columns).
        y: shape (n,).
        penalty: of the squares of the other coefficients.
    """
    penalties = np.full(x.shape[1], penalty)
    penalties[0] = 0.0
    inverse = np.linalg.inv(x.T @ x + np.diag(penalties))
    coefficients = inverse @ (x.T @ y)
    unseen = np.maximum(1 - np.einsum("ij,jk,ik->i", x, inverse, x), LIBRARY_FIT.tiny)
    return coefficients, (y - x @ coefficients) / unseen


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
